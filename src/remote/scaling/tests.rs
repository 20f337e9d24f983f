//! Tests of the scaling.
// Exact comparison: both ends must be met, not approached.
#![allow(clippy::float_cmp)]

use super::*;
use proptest::prelude::*;

fn unsigned(bits: u8, min: f64, max: f64) -> Scaling {
    Scaling::new(bits, false, min, max)
}

fn signed(bits: u8, min: f64, max: f64) -> Scaling {
    Scaling::new(bits, true, min, max)
}

#[test]
fn known_values_of_the_field() {
    let volts = signed(13, -10.0, 10.0);
    for (value, raw) in [
        (5.0, 2047),
        (10.0, 4095),
        (-10.0, 0x1000),
        (-5.0, 0x1800),
        (0.0, 0),
        (-1e-12, 0),
    ] {
        assert_eq!(volts.raw(value), raw, "{value} V");
    }
    assert_eq!(volts.value(0x1000), -10.0);
    assert_eq!(volts.value(0x0800), 5.0);

    let field_voltage = unsigned(8, 0.0, 36.3);
    assert_eq!(field_voltage.value(255), 36.3);
    assert_eq!(field_voltage.value(0), 0.0);
    assert!((field_voltage.value(169) - 24.057).abs() < 0.001);
}

#[test]
fn both_ends_are_exact_at_every_width() {
    for bits in 1..=64 {
        let mask = u64::MAX >> (64 - u32::from(bits));
        let numbers = unsigned(bits, 0.0, 36.3);
        assert_eq!(numbers.raw(36.3), mask);
        assert_eq!(numbers.raw(0.0), 0);
        assert_eq!((numbers.value(mask), numbers.value(0)), (36.3, 0.0));

        let numbers = signed(bits, -10.0, 10.0);
        assert_eq!(numbers.raw(10.0), mask >> 1, "{bits} bits");
        assert_eq!(numbers.raw(-10.0), (mask >> 1) + 1, "{bits} bits");
        assert_eq!(numbers.value((mask >> 1) + 1), -10.0);
        assert_eq!(numbers.value(0), 0.0);

        let offset = unsigned(bits, -3.0, 7.0);
        assert_eq!((offset.raw(-3.0), offset.raw(7.0)), (0, mask));
        assert_eq!((offset.value(0), offset.value(mask)), (-3.0, 7.0));
    }
}

/// The limits as stored in a record: 32-bit floats.
fn in_record(limits: [i128; 2]) -> [f64; 2] {
    limits.map(|limit| f64::from(limit as f32))
}

#[test]
fn number_with_the_limits_of_its_own_bits_is_its_own_value() {
    for bits in [1, 8, 24, 31, 32, 64] {
        let mask = u64::MAX >> (64 - u32::from(bits));
        let [min, max] = in_record([0, i128::from(mask)]);
        let numbers = unsigned(bits, min, max);
        assert_eq!(numbers.max, mask as f64, "{bits} bits");
        for raw in [0, 1, 0x1200_0001, 0x7FFF_FFFF, mask >> 1, mask - 1, mask] {
            let raw = raw & mask;
            assert_eq!(numbers.value(raw), raw as f64, "{bits} bits");
            if raw < 1 << 53 || raw == mask {
                assert_eq!(numbers.raw(raw as f64), raw, "{bits} bits");
            }
        }
        assert_eq!(numbers.raw(-1.0), 0);
        assert_eq!(numbers.raw(mask as f64 + 4096.0), mask);

        let half = 1_i128 << (bits - 1);
        for limits in [[-half, half - 1], [-half, half]] {
            let [min, max] = in_record(limits);
            let numbers = signed(bits, min, max);
            for number in [-half, -half / 3, -1, 0, half / 3, half - 1] {
                let raw = number as u64 & mask;
                assert_eq!(numbers.value(raw), number as f64, "{bits} bits");
                if number.abs() < 1 << 53 {
                    assert_eq!(numbers.raw(number as f64), raw, "{bits} bits");
                }
            }
            assert_eq!(numbers.raw(half as f64), (half - 1) as u64);
            assert_eq!(numbers.raw(2.0 * half as f64), (half - 1) as u64);
        }
    }
    let unit_number = unsigned(32, 0.0, 4_294_967_296.0);
    assert_eq!(unit_number.value(0x1200_0001), 301_989_889.0);
    assert_eq!(unit_number.raw(301_989_889.0), 0x1200_0001);
}

#[test]
fn limits_near_those_of_the_bits_are_a_scale_all_the_same() {
    // 2^24 - 1 is exact as a 32-bit float, so 2^24 is a genuine scale.
    let numbers = unsigned(24, 0.0, 16_777_216.0);
    assert!(!numbers.is_whole());
    assert_eq!(numbers.value(0xFF_FFFF), 16_777_216.0);
    assert!(!signed(16, -32767.0, 32767.0).is_whole());
    assert!(!signed(32, 0.0, 4_294_967_296.0).is_whole());
}

#[test]
fn equal_limits_mean_0_to_1() {
    let numbers = unsigned(8, 5.0, 5.0);
    assert_eq!((numbers.value(0), numbers.value(255)), (0.0, 1.0));
    let numbers = signed(8, 0.0, 0.0);
    assert_eq!((numbers.value(0x80), numbers.value(0)), (-1.0, 0.0));
}

#[test]
fn out_of_range_values_become_an_end_and_non_finite_ones_zero() {
    let volts = signed(13, -10.0, 10.0);
    assert_eq!(volts.raw(1e300), 4095);
    assert_eq!(volts.raw(-11.0), 0x1000);
    assert_eq!(volts.raw(f64::NAN), 0);
    let far = unsigned(8, 4.0, 20.0);
    assert_eq!(far.raw(f64::INFINITY), 0, "4 is nearest to zero");
}

#[test]
fn limits_that_make_no_sense_mean_0_to_1() {
    assert_eq!(unsigned(8, f64::NAN, 1.0), unsigned(8, 0.0, 1.0));
    assert_eq!(signed(8, f64::MIN, f64::MAX), signed(8, -1.0, 1.0));
}

#[test]
fn signs_extend_at_every_width() {
    for bits in 1..=64 {
        let lowest = 1_u64 << (bits - 1);
        assert_eq!(sign_extend(lowest, bits), i64::MIN >> (64 - bits));
        assert_eq!(sign_extend(lowest - 1, bits), (lowest - 1) as i64);
    }
}

proptest! {
    #[test]
    fn unsigned_raw_values_come_back_as_they_were(bits in 1..=48u8, seed in any::<u64>(), max in 1e-3..1e6_f64) {
        let raw = seed >> (64 - bits);
        for min in [0.0, -max / 3.0] {
            let scaling = unsigned(bits, min, max);
            prop_assert_eq!(scaling.raw(scaling.value(raw)), raw);
        }
    }

    #[test]
    fn signed_raw_values_come_back_as_they_were_or_one_step_lower(bits in 2..=52u8, seed in any::<u64>(), max in 1e-3..1e6_f64) {
        let raw = seed >> (64 - bits);
        let scaling = signed(bits, -max, max);
        let before = sign_extend(raw, bits);
        let after = sign_extend(scaling.raw(scaling.value(raw)), bits);
        prop_assert!((0..=1).contains(&(before - after)), "{} {}", before, after);
    }

    #[test]
    fn raw_values_round_trip_with_rounding_to_nearest(bits in 1..=48u8, seed in any::<u64>(), max in 1e-3..1e6_f64) {
        let raw = seed >> (64 - bits);
        for scaling in [
            // LinuxCNC's method up to 31 bits does not round to the nearest.
            signed(bits.max(32), -max, max),
            signed(bits, -max, max / 3.0),
            unsigned(bits, 0.0, max),
            Scaling::whole(bits, true),
        ] {
            prop_assert_eq!(scaling.raw(scaling.value(raw)), raw, "{:?}", scaling);
        }
    }

    #[test]
    fn value_on_the_wire_is_no_further_off_than_promised(bits in 2..=32u8, fraction in -1.0..1.0f64, max in 1e-3..1e6_f64) {
        let step = max / (1_u64 << (bits - 1)) as f64;
        // An error of one step from dropping low bits, and two parts of 2^31 from the fraction
        // before it.
        let most = step * (1.0 + 1.0 / (1_u64 << (32 - bits)) as f64);
        let numbers = signed(bits, -max, max);
        let value = fraction * max;
        let back = numbers.value(numbers.raw(value));
        prop_assert!((back - value).abs() <= most * (1.0 + 1e-6), "{} {}", value, back);
        let numbers = unsigned(bits, 0.0, max);
        let back = numbers.value(numbers.raw(value.abs()));
        prop_assert!((back - value.abs()).abs() <= step / 2.0 * 1.001);
    }

    #[test]
    fn no_value_and_no_limits_make_bits_outside_the_width(
        bits in 1..=64u8, min in any::<f64>(), max in any::<f64>(), value in any::<f64>(), raw in any::<u64>(),
    ) {
        for scaling in [signed(bits, min, max), unsigned(bits, min, max)] {
            prop_assert_eq!(scaling.raw(value) & !scaling.mask(), 0);
            let _ = scaling.value(raw);
        }
    }

    #[test]
    fn larger_value_never_has_a_smaller_raw_value(bits in 1..=64u8, a in -12.0..12.0f64, b in -12.0..12.0f64) {
        let scaling = signed(bits, -10.0, 10.0);
        let raw = |v: f64| sign_extend(scaling.raw(v), bits);
        prop_assert!(raw(a.min(b)) <= raw(a.max(b)));
    }
}
