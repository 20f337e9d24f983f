//! Conversions from frequencies and fractions of full scale to registers.

/// The PDM rate register: clock*n/65536. PDM always has 12 bits, and takes 4096 ticks for a full
/// cycle.
pub(super) fn pdm_word(clock_hz: u32, hz: u32) -> u16 {
    to_rate(f64::from(hz) * 65_536.0 / f64::from(clock_hz))
}

/// The highest frequency of PDM in Hz that a clock allows.
pub(super) fn fastest_pdm(clock_hz: u32) -> u32 {
    (u64::from(clock_hz).saturating_mul(u16::MAX.into()) >> 16) as u32
}

/// The master rate register, and the width of the duty that belongs to it.
///
/// PWMClock = clock*n/65536; PWM rate = PWMClock/2^bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct PwmRate {
    /// The register.
    pub rate: u16,
    /// Bits of the duty: 9 to 12.
    pub bits: u8,
}

impl PwmRate {
    /// The highest frequency in Hz that a clock allows, with 9 bits of duty.
    pub(super) fn fastest(clock_hz: u32) -> u32 {
        (u64::from(clock_hz).saturating_mul(u16::MAX.into()) >> 25) as u32
    }

    /// Returns the rate with the widest duty that gives `hz`; a frequency that the hardware cannot
    /// reach becomes the nearest that it can, and NaN becomes the slowest.
    pub fn new(clock_hz: u32, hz: f64) -> Self {
        let rate_of =
            |bits: u8| libm::round(hz * f64::from(1_u32 << bits) * 65_536.0 / f64::from(clock_hz));
        let fits = |bits: &u8| rate_of(*bits) <= f64::from(u16::MAX);
        let bits = [12, 11, 10].into_iter().find(fits).unwrap_or(9);
        Self {
            rate: to_rate(rate_of(bits)),
            bits,
        }
    }
}

/// At least 1, since 0 would stop the outputs at their current level. `NaN` becomes 1 as well.
fn to_rate(rate: f64) -> u16 {
    (libm::round(rate).clamp(0.0, f64::from(u16::MAX)) as u16).max(1)
}

/// Distance of the largest dithered duty from full scale, in steps. The carry of the fraction is
/// added to the duty without saturation, and outlives a load: with a larger duty, a step to full
/// scale has one period of 0 %. Mesa's VHDL, `dpwmpdmgenh`.
const DITHER_HEADROOM: f64 = 1.0625;
/// Least number of bits that a dithered duty has at its usual frequency.
pub(super) const DITHER_BITS: u8 = 11;
/// The output type with a duty of 12 bits.
pub(super) const PDM: i32 = 3;
/// Mode bit: a change of a value waits for the end of a period.
pub(super) const DOUBLE_BUFFERED: u32 = 1 << 5;
const DITHER: u32 = 1 << 6;

/// Conversion from fractions of full scale to duties.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PwmShape {
    /// Bits of the duty: 9 to 12.
    pub bits: u8,
    /// Use of the output pins: see [`PwmPins::output_type`](super::PwmPins::output_type).
    pub output_type: i32,
    /// 0 is half scale, and direction is not used. Needed by the 7I97.
    pub offset: bool,
    /// Uses the fraction of the duty too: only with module version 1.
    pub dither: bool,
}

impl PwmShape {
    /// Returns the mode register: bits 1..0 width, 4..3 output, 5 double buffered, 6 dither. Values
    /// are always double buffered.
    pub const fn mode(&self) -> u32 {
        let output = match self.output_type {
            2 => 2,
            PDM => 3,
            4 => 1,
            _ => 0,
        };
        let dither = if self.dither { DITHER } else { 0 };
        self.bits.saturating_sub(9) as u32 & 3 | output << 3 | DOUBLE_BUFFERED | dither
    }

    /// Returns the value register: bits 27..16 duty, 15..0 fraction, bit 31 direction. The pin's
    /// rules keep `fraction` within -1 to 1; the duty saturates, so that it never wraps.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn encode(&self, fraction: f64) -> u32 {
        let steps = f64::from(1_u32 << (self.bits & 15));
        let (duty, is_negative) = if self.offset {
            (fraction * steps / 2.0 + steps / 2.0, false)
        } else {
            (fraction.abs() * (steps - 1.0), fraction < 0.0)
        };
        let largest = if self.dither {
            steps - DITHER_HEADROOM
        } else {
            steps - 1.0
        };
        // Whole steps, or with dither 16 more bits of fraction.
        let word = if self.dither {
            (duty.min(largest) * 65_536.0 + 0.5) as u32
        } else {
            ((duty + 0.5).min(largest) as u32) << 16
        };
        word | u32::from(is_negative) << 31
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CLOCK: u32 = 200_000_000;

    fn shape(dither: bool) -> PwmShape {
        PwmShape {
            bits: PwmRate::new(CLOCK, 48_000.0).bits,
            output_type: 1,
            offset: true,
            dither,
        }
    }

    #[test]
    fn rates_of_the_7i97_manual_are_reached_with_the_widest_duty() {
        let slow = PwmRate::new(CLOCK, 48_000.0);
        assert_eq!((slow.bits, slow.rate), (12, 64_425));
        let fast = PwmRate::new(CLOCK, 96_000.0);
        assert_eq!((fast.bits, fast.rate), (11, 64_425));
        // One step of 4096 at each tick, as in LinuxCNC.
        assert_eq!(pdm_word(CLOCK, 6_000_000), 1_966);
    }

    #[test]
    fn duty_that_dithers_ends_where_its_carry_can_not_wrap() {
        for (bits, largest) in [(12, 0x0FFE_F000), (11, 0x07FE_F000), (9, 0x01FE_F000)] {
            let shape = PwmShape {
                bits,
                ..shape(true)
            };
            assert_eq!(shape.encode(1.0), largest);
            let signed = PwmShape {
                offset: false,
                ..shape
            };
            assert_eq!(signed.encode(-1.0), largest | 1 << 31);
        }
    }

    #[test]
    fn fastest_rate_is_the_last_that_is_reached() {
        let fastest = PwmRate::fastest(CLOCK);
        assert_eq!(fastest, 390_619);
        let rate = |hz: u32| PwmRate::new(CLOCK, hz.into()).rate;
        assert_eq!((rate(fastest), rate(fastest + 6)), (65_535, 65_535));
        assert!(rate(fastest - 6) < 65_535);
    }

    #[test]
    fn rates_out_of_reach_become_the_nearest() {
        let fastest = PwmRate {
            rate: u16::MAX,
            bits: 9,
        };
        assert_eq!(PwmRate::new(CLOCK, 1e9), fastest);
        assert_eq!(PwmRate::new(CLOCK, -5.0).rate, 1);
        assert_eq!(PwmRate::new(CLOCK, f64::NAN).rate, 1);
        assert_eq!(to_rate(f64::INFINITY), u16::MAX);
    }

    #[test]
    fn mode_layout_matches_the_register_list() {
        assert_eq!(shape(false).mode(), 0x23);
        let up_down = PwmShape {
            bits: 9,
            output_type: 2,
            ..shape(true)
        };
        assert_eq!(up_down.mode(), 0x70);
        let pdm = PwmShape {
            output_type: 3,
            ..shape(false)
        };
        assert_eq!(pdm.mode(), 0x3B);
    }

    #[test]
    fn offset_mode_has_zero_at_half_scale_and_never_wraps() {
        let word = |fraction| shape(false).encode(fraction);
        assert_eq!(word(0.0), 0x0800_0000);
        assert_eq!(word(0.5), 0x0C00_0000);
        assert_eq!(word(1.0), 0x0FFF_0000);
        assert_eq!(word(-1.0), 0);
        assert_eq!(word(1e300), 0x0FFF_0000);
        assert_eq!(word(f64::NEG_INFINITY), 0);
    }

    #[test]
    fn sign_and_magnitude_use_bit_31() {
        let signed = PwmShape {
            offset: false,
            ..shape(false)
        };
        assert_eq!(signed.encode(1.0), 0x0FFF_0000);
        assert_eq!(signed.encode(-1.0), 0x8FFF_0000);
        assert_eq!(signed.encode(0.0), 0);
    }

    /// The fraction that a word represents.
    fn decode(shape: PwmShape, word: u32) -> f64 {
        let steps = f64::from(1_u32 << shape.bits);
        let duty = f64::from(word & 0x0FFF_FFFF) / 65_536.0;
        if shape.offset {
            (duty - steps / 2.0) / (steps / 2.0)
        } else {
            let sign = if word >> 31 == 1 { -1.0 } else { 1.0 };
            sign * duty / (steps - 1.0)
        }
    }

    proptest! {
        #[test]
        fn values_come_back_within_half_a_step(
            fraction in -1.0f64..=1.0,
            offset: bool,
            dither: bool,
            bits in 9u8..=12,
        ) {
            let shape = PwmShape { bits, offset, ..shape(dither) };
            let steps = f64::from(1_u32 << bits);
            let step = if offset { 2.0 / steps } else { 1.0 / (steps - 1.0) };
            // The upper end of offset mode is one step below full scale.
            let fraction = if offset { fraction.min(1.0 - step) } else { fraction };
            // With dither the duty ends 1/16 of a step earlier.
            let end = 1.0 - step * if offset { 1.0625 } else { 0.0625 };
            let fraction = if dither { fraction.clamp(if offset { -1.0 } else { -end }, end) } else { fraction };
            let step = if dither { step / 65_536.0 } else { step };
            let back = decode(shape, shape.encode(fraction));
            prop_assert!((back - fraction).abs() <= step * 0.500_001);
        }

        #[test]
        fn any_value_gives_a_duty_within_the_width(fraction: f64, offset: bool, dither: bool) {
            let shape = PwmShape { offset, bits: 10, ..shape(dither) };
            prop_assert!((shape.encode(fraction) & 0x7FFF_FFFF) >> 16 < 1024);
        }
    }
}
