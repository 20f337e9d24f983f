//! Encoders and their multiplexer.

use super::{MS, count, set_up_pins, turn, turned_by_hand, wait};
use mesa_hal::sim::{AxisWiring, DriveSource, MotorConfig, SimFpga, UNDRIVEN, gtag, machines};

#[test]
fn encoder_counts_both_ways_and_wraps_at_16_bits() {
    let mut fpga = turned_by_hand();
    turn(&mut fpga, 2, 100_000.0);
    wait(&mut fpga, 10 * MS + 5_000);
    assert_eq!(count(&mut fpga, 2), 1000);
    assert_eq!(count(&mut fpga, 3), 0);
    turn(&mut fpga, 2, -200_000.0);
    wait(&mut fpga, 10 * MS);
    assert_eq!(count(&mut fpga, 2) as i16, -1000);
    fpga.write_register(0x3508, 0);
    assert_eq!(count(&mut fpga, 2), 0, "writing clears");
    wait(&mut fpga, 500 * MS);
    assert_eq!(count(&mut fpga, 2), (-100_000i32) as u16);
    assert_eq!(
        fpga.read_register(0x3608) & 0x8000,
        0,
        "no quadrature error"
    );
}

#[test]
fn time_stamps_give_the_speed_of_a_slow_encoder() {
    let mut fpga = turned_by_hand();
    // 1 MHz: ClockLow / 100.
    fpga.write_register(0x3700, 98);
    turn(&mut fpga, 0, 731.0);
    wait(&mut fpga, 50 * MS);
    let first = fpga.read_register(0x3500);
    wait(&mut fpga, 20 * MS);
    let second = fpga.read_register(0x3500);
    let counts = (second as u16).wrapping_sub(first as u16);
    let ticks = ((second >> 16) as u16).wrapping_sub((first >> 16) as u16);
    let speed = f64::from(counts) / (f64::from(ticks) * 1e-6);
    assert!((speed - 731.0).abs() < 0.2, "{speed}");
    let before = fpga.read_register(0x3800);
    wait(&mut fpga, MS);
    assert_eq!(
        fpga.read_register(0x3800).wrapping_sub(before) & 0xFFFF,
        1000
    );
}

#[test]
fn index_is_latched_just_once() {
    let mut fpga = turned_by_hand();
    turn(&mut fpga, 1, 100_000.0);
    wait(&mut fpga, MS);
    // Latch on the rising edge of the index, just once.
    fpga.write_register(0x3604, 1 << 6 | 1 << 4 | 1 << 3);
    wait(&mut fpga, 2 * MS);
    assert_eq!(
        fpga.read_register(0x3604) >> 4 & 1,
        1,
        "armed until it comes"
    );
    wait(&mut fpga, MS + 5_000);
    let control = fpga.read_register(0x3604);
    // The count before the step that the index came with (FACTS 12.5).
    assert_eq!(control >> 16, 399);
    assert_eq!(control >> 4 & 1, 0);
    wait(&mut fpga, 5 * MS);
    assert_eq!(
        fpga.read_register(0x3604) >> 16,
        399,
        "the second index is ignored"
    );
    assert_eq!(count(&mut fpga, 1), 900);
}

#[test]
fn index_can_clear_the_count_and_be_gated_with_a_and_b() {
    let mut fpga = turned_by_hand();
    turn(&mut fpga, 1, 100_000.0);
    wait(&mut fpga, MS + 5_000);
    let gated_high = 1 << 14 | 1 << 7 | 1 << 6 | 1 << 5 | 1 << 3;
    fpga.write_register(0x3604, gated_high);
    wait(&mut fpga, 4 * MS);
    assert_eq!(count(&mut fpga, 1), 100);
    assert_eq!(fpga.read_register(0x3604) >> 5 & 1, 0);
    // The index comes with A and B high; gated with both low it never comes.
    fpga.write_register(0x3604, gated_high & !(1 << 14));
    wait(&mut fpga, 8 * MS);
    assert_eq!(count(&mut fpga, 1), 900);
    assert_eq!(fpga.read_register(0x3604) >> 5 & 1, 1);
}

#[test]
fn an_inverted_index_is_latched_when_it_falls() {
    let mut fpga = turned_by_hand();
    turn(&mut fpga, 1, 100_000.0);
    wait(&mut fpga, MS);
    fpga.write_register(0x3604, 1 << 6 | 1 << 4);
    wait(&mut fpga, 4 * MS);
    assert_eq!(fpga.read_register(0x3604) >> 16, 400);
}

#[test]
fn in_up_down_mode_a_counts_and_b_is_the_direction() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x3600, 1 << 10);
    turn(&mut fpga, 0, 100_000.0);
    wait(&mut fpga, MS + 5_000);
    // One rising edge of A in four counts, always with B low; the other way round with B high.
    assert_eq!(count(&mut fpga, 0) as i16, -25);
    turn(&mut fpga, 0, -100_000.0);
    wait(&mut fpga, MS);
    assert_eq!(count(&mut fpga, 0) as i16, 0);
}

#[test]
fn probe_latches_at_its_edge_where_there_is_one() {
    for version in [4, 0x84] {
        let mut firmware = machines::firmware_7i97(1);
        let encoders = firmware.module_mut(gtag::MUXED_ENCODER).expect("encoders");
        encoders.version = version;
        let mut fpga = SimFpga::new(firmware);
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Nothing,
            encoder: 0,
            motor: MotorConfig {
                counts_per_unit: 1.0,
                ..MotorConfig::default()
            },
        });
        let outputs: Vec<usize> = (18..30).collect();
        set_up_pins(&mut fpga, &outputs);
        fpga.encoders().expect("encoders").set_probe(false);
        turn(&mut fpga, 0, 100_000.0);
        fpga.write_register(0x3600, 1 << 13 | 1 << 12);
        wait(&mut fpga, MS + 5_000);
        let control = fpga.read_register(0x3600) & 0x3000;
        fpga.encoders().expect("encoders").set_probe(true);
        wait(&mut fpga, MS);
        fpga.encoders().expect("encoders").set_probe(false);
        wait(&mut fpga, MS);
        let latched = fpga.read_register(0x3600) >> 16;
        // Without a probe the bits read 0 whatever was written (FACTS 12.5).
        let expected = if version == 4 { (0, 0) } else { (0x3000, 100) };
        assert_eq!((control, latched), expected, "version {version:#x}");
    }
}

/// Turns an encoder for a millisecond: what it has counted, and whether it says an error.
fn counted_in_a_millisecond(fpga: &mut SimFpga, counts_per_second: f64) -> (i32, bool) {
    let before = count(fpga, 4);
    turn(fpga, 4, counts_per_second);
    wait(fpga, MS);
    turn(fpga, 4, 0.0);
    wait(fpga, MS);
    let counted = count(fpga, 4).wrapping_sub(before) as i16;
    (counted.into(), fpga.read_register(0x3610) & 0x8000 != 0)
}

/// FACTS 12.6: clock / (3 (n + 2)) counts a second with the short filter, / (15 (n + 2)) with the
/// long one; beyond it garbage, and no error.
#[test]
fn too_fast_an_encoder_loses_counts_and_does_not_say_so() {
    let mut fpga = turned_by_hand();
    let rate = fpga.encoders().expect("encoders").sample_rate();
    assert!((rate - 3.125e6).abs() < 1.0, "manual: 7I97, ClockLow/16");
    for (rate, filter, followed, lost) in [
        (14, 0, 2.0e6, 3.0e6),
        (14, 1 << 11, 0.41e6, 0.6e6),
        (6, 0, 4.1e6, 6.0e6),
        (6, 1 << 11, 0.83e6, 1.3e6),
        (11, 0, 2.5e6, 3.2e6),
    ] {
        fpga.write_register(0x3900, rate);
        fpga.write_register(0x3610, 0x8000 | filter);
        // Filters that were long come down to the new length with the first counts.
        let _ = counted_in_a_millisecond(&mut fpga, 50_000.0);
        for direction in [1.0, -1.0] {
            let expected = direction * followed * 1e-3;
            let (counted, error) = counted_in_a_millisecond(&mut fpga, direction * followed);
            assert!((f64::from(counted) - expected).abs() <= 1.0, "{counted}");
            assert!(!error, "rate {rate}, filter {filter:#x}");
            let (counted, error) = counted_in_a_millisecond(&mut fpga, direction * lost);
            let expected = direction * lost * 1e-3;
            assert!((f64::from(counted) - expected).abs() > 200.0, "{counted}");
            assert!(!error, "rate {rate}, filter {filter:#x}");
        }
    }
}

#[test]
fn a_quadrature_error_stays_until_a_1_is_written() {
    let mut fpga = turned_by_hand();
    let step = |fpga: &mut SimFpga, abz| {
        let now = fpga.now();
        let bank = fpga.encoders().expect("encoders");
        bank.set_lines(now, 4, abz);
        wait(fpga, MS);
        fpga.read_register(0x3610) & 0x8000
    };
    assert_eq!(step(&mut fpga, [true, false, false]), 0);
    assert_eq!(step(&mut fpga, [false, true, false]), 0x8000);
    fpga.write_register(0x3510, 0);
    fpga.write_register(0x3610, 0);
    assert_eq!(fpga.read_register(0x3610) & 0x8000, 0x8000, "still there");
    fpga.write_register(0x3610, 0x8000);
    assert_eq!(fpga.read_register(0x3610) & 0x8000, 0, "taken back");
}

/// FACTS 12.11.
#[test]
fn the_rate_register_can_not_be_read_back() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x3900, 6);
    assert_eq!(fpga.read_register(0x3900), UNDRIVEN);
    fpga.write_register(0x3700, 98);
    assert_eq!(fpga.read_register(0x3700) & 0xFFFF, 98);
}

#[test]
fn a_select_line_that_a_pin_inverts_or_holds_shows_other_encoders() {
    for (words, expected) in [
        // Direction, alternate source and invert of the select pin; data.
        ([1, 1, 0, 0], [50, 100]),
        ([1, 1, 1, 0], [100, 50]),
        ([1, 0, 0, 0], [50, 50]),
        ([1, 0, 0, 1], [100, 100]),
        ([0, 0, 0, 0], [100, 100]),
    ] {
        let mut fpga = turned_by_hand();
        for (address, bit) in [0x1104, 0x1204, 0x1404, 0x1004].into_iter().zip(words) {
            fpga.write_register(address, bit << 1);
        }
        turn(&mut fpga, 0, 50_000.0);
        turn(&mut fpga, 1, 100_000.0);
        wait(&mut fpga, MS + 5_000);
        let counted = [count(&mut fpga, 0), count(&mut fpga, 1)];
        assert_eq!(counted, expected, "{words:?}");
    }
}

#[test]
fn without_its_select_line_a_multiplexer_shows_the_odd_encoder_twice() {
    let mut fpga = turned_by_hand();
    set_up_pins(&mut fpga, &[]);
    turn(&mut fpga, 0, 50_000.0);
    turn(&mut fpga, 1, 100_000.0);
    wait(&mut fpga, MS + 5_000);
    assert_eq!((count(&mut fpga, 0), count(&mut fpga, 1)), (100, 100));
}
