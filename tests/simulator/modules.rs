//! The modules of the simulated FPGA behave as FACTS 9.4 and 13 say.

use mesa_hal::sim::{AxisWiring, DriveSource, MotorConfig, SimFpga, UNDRIVEN, gtag, machines};

const MS: u64 = 1_000_000;

/// All pins of a connector to their modules: direction and alternate source.
fn set_up_pins(fpga: &mut SimFpga, outputs: &[usize]) {
    for port in 0..3u16 {
        let word = outputs
            .iter()
            .filter(|&&pin| pin / 17 == usize::from(port))
            .fold(0, |word, &pin| word | 1 << (pin % 17));
        fpga.write_register(0x1200 + 4 * port, word);
        fpga.write_register(0x1100 + 4 * port, word);
    }
}

fn wait(fpga: &mut SimFpga, nanos: u64) {
    let to = fpga.now() + nanos;
    fpga.advance_to(to);
}

/// A 7I97 whose motors are turned by hand, all module outputs set up.
fn turned_by_hand() -> SimFpga {
    let mut fpga = machines::i7i97(1);
    for encoder in 0..6 {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Nothing,
            encoder,
            motor: MotorConfig {
                counts_per_unit: 1.0,
                counts_per_revolution: 400,
                ..MotorConfig::default()
            },
        });
    }
    let outputs: Vec<usize> = (0..9).chain(18..30).chain(32..34).collect();
    set_up_pins(&mut fpga, &outputs);
    fpga
}

fn turn(fpga: &mut SimFpga, axis: usize, counts_per_second: f64) {
    let motor = fpga.motor(axis).expect("axis");
    motor.turn_by_hand(Some(counts_per_second));
}

fn count(fpga: &mut SimFpga, encoder: u16) -> u16 {
    fpga.read_register(0x3500 + 4 * encoder) as u16
}

#[test]
fn watchdog_bites_two_clocks_after_its_time_and_makes_all_pins_inputs_one_later() {
    let mut fpga = machines::i7i92_7i77();
    fpga.write_register(0x1104, 0x1FFFF);
    fpga.write_register(0x1304, 0x3);
    fpga.write_register(0x1004, 0);
    fpga.write_register(0x0C00, 499_999);
    wait(&mut fpga, 4 * MS);
    fpga.write_register(0x0E00, 0x5A00_0000);
    // 499,999 + 2 clocks of 10 ns.
    wait(&mut fpga, 5 * MS + 9);
    assert_eq!(fpga.read_register(0x0D00), 0);
    wait(&mut fpga, 1);
    assert_eq!(fpga.read_register(0x0D00), 1);
    wait(&mut fpga, 9);
    assert_eq!(fpga.read_register(0x1104), 0x1FFFF);
    assert!(!fpga.pin_level(20));
    wait(&mut fpga, 1);
    assert_eq!(fpga.read_register(0x1104), 0);
    assert_eq!(fpga.read_register(0x1004), 0x1FFFF, "pull-ups");

    fpga.write_register(0x0D00, 0);
    fpga.write_register(0x1104, 1);
    wait(&mut fpga, 6 * MS);
    assert_eq!(fpga.read_register(0x0D00), 0, "it sleeps until the cookie");
    fpga.write_register(0x0E00, 0x5A00_0000);
    wait(&mut fpga, 2 * MS);
    assert_eq!(fpga.read_register(0x0C00), 299_999, "what is left");
    assert_eq!(fpga.read_register(0x1104), 1);
    wait(&mut fpga, 3 * MS + 20);
    assert_eq!(fpga.read_register(0x0D00), 1);
    assert_eq!(fpga.read_register(0x1104), 0);
}

#[test]
fn watchdog_that_was_never_set_is_silent_and_wrong_cookies_do_not_feed_it() {
    let mut fpga = machines::i7i92_7i77();
    wait(&mut fpga, 1_000 * MS);
    fpga.write_register(0x0C00, 0x8000_0000);
    wait(&mut fpga, 1_000 * MS);
    assert_eq!(fpga.read_register(0x0D00), 0, "it did not run");
    fpga.write_register(0x0C00, 99_999);
    wait(&mut fpga, MS / 2);
    fpga.write_register(0x0E00, 0x5B00_0000);
    wait(&mut fpga, MS / 2 + 20);
    assert_eq!(fpga.read_register(0x0D00), 1);
    fpga.write_register(0x0D00, 0);
    fpga.write_register(0x0C00, 0x8000_0001);
    fpga.write_register(0x0E00, 0x5A00_0000);
    wait(&mut fpga, 1_000 * MS);
    assert_eq!(fpga.read_register(0x0D00), 0, "it did not run any more");
}

#[test]
fn watchdog_bites_when_it_is_disabled_while_it_runs_or_fed_before_it_was_set() {
    let disabled = |fpga: &mut SimFpga| {
        fpga.write_register(0x0C00, 99_999);
        fpga.write_register(0x0C00, 0x8000_0000);
    };
    let fed_too_early = |fpga: &mut SimFpga| fpga.write_register(0x0E00, 0x5A00_0000);
    for cause in [disabled, fed_too_early] {
        let mut fpga = machines::i7i92_7i77();
        fpga.write_register(0x1104, 0x1FFFF);
        cause(&mut fpga);
        wait(&mut fpga, 30);
        assert_eq!(fpga.read_register(0x0D00), 1);
        assert_eq!(fpga.read_register(0x1104), 0);
    }
}

#[test]
fn older_firmware_starts_with_the_status_of_the_watchdog_set() {
    for starts_bitten in [false, true] {
        let mut firmware = machines::firmware_7i97(1);
        firmware.starts_bitten = starts_bitten;
        let mut fpga = SimFpga::new(firmware);
        assert_eq!(fpga.read_register(0x0D00), u32::from(starts_bitten));
        fpga.write_register(0x0D00, 0);
        assert_eq!(fpga.read_register(0x0D00), 0);
        fpga.reload();
        assert_eq!(fpga.read_register(0x0D00), u32::from(starts_bitten));
    }
}

#[test]
fn open_drain_pulls_low_whatever_the_direction_and_never_high() {
    let mut fpga = machines::i7i92_7i77();
    fpga.drive_pin(18, Some(false));
    fpga.write_register(0x1304, 0x7);
    for direction in [0, 0x7] {
        fpga.write_register(0x1104, direction);
        fpga.write_register(0x1004, 0x6);
        let levels = [17, 18, 19].map(|pin| fpga.driven_level(pin));
        assert_eq!(levels, [Some(false), Some(false), None]);
    }
}

#[test]
fn pins_follow_data_invert_open_drain_and_the_outside() {
    let mut fpga = machines::i7i92_7i77();
    fpga.drive_pin(17, Some(false));
    fpga.drive_pin(18, Some(false));
    assert_eq!(fpga.read_register(0x1004), 0x1FFFC);
    fpga.write_register(0x1104, 0x7);
    fpga.write_register(0x1004, 0x3);
    assert_eq!(fpga.read_register(0x1004), 0x1FFFB, "outputs win");
    fpga.write_register(0x1304, 0x1);
    assert_eq!(
        fpga.read_register(0x1004),
        0x1FFFA,
        "open drain lets go of a 1"
    );
    fpga.write_register(0x1404, 0x6);
    assert_eq!(fpga.read_register(0x1004), 0x1FFFC);
}

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

#[test]
fn a_pwm_gives_volts_while_connected_whether_enabled_or_not() {
    let mut fpga = turned_by_hand();
    // 12 bits at 48 kHz: 200 MHz * n / 65536 / 4096.
    fpga.write_register(0x4200, 64_425);
    fpga.write_register(0x4104, 3);
    let write = |fpga: &mut SimFpga, value: u32| {
        fpga.write_register(0x4004, value << 16);
        wait(fpga, 20);
    };
    write(&mut fpga, 2048);
    let frequency = fpga.pwm().expect("PWM").frequency(1, fpga.now());
    assert!((frequency - 48_000.0).abs() < 1.0, "{frequency}");
    assert_eq!(fpga.analog_output(1).volts, 0.0);
    write(&mut fpga, 3072);
    let signal = fpga.analog_output(1);
    assert_eq!((signal.volts, signal.enabled), (5.0, false));
    fpga.write_register(0x4400, 0x3F);
    assert_eq!(fpga.analog_output(1).volts, 5.0);
    write(&mut fpga, 0);
    assert_eq!(fpga.analog_output(1).volts, -10.0);
    write(&mut fpga, 4095);
    assert!((fpga.analog_output(1).volts - 9.995).abs() < 0.001);
    assert!(fpga.analog_output(1).enabled);
    fpga.write_register(0x4400, 0x3E);
    assert!(
        !fpga.analog_output(1).enabled,
        "ENA0 to ENA3 follow output 0"
    );
    assert!((fpga.analog_output(1).volts - 9.995).abs() < 0.001);
    assert!(fpga.analog_output(4).enabled && fpga.analog_output(5).enabled);
    fpga.write_register(0x4400, 0x3F);
    fpga.write_register(0x0C00, 1);
    wait(&mut fpga, MS);
    let signal = fpga.analog_output(1);
    assert_eq!((signal.volts, signal.enabled), (0.0, false), "bitten");
}

#[test]
fn a_value_that_is_double_buffered_waits_for_the_end_of_the_period() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x4100, 0x23);
    fpga.write_register(0x4000, 3072 << 16);
    wait(&mut fpga, 10 * MS);
    assert_eq!(fpga.analog_output(0).volts, -10.0, "its clock stands");
    fpga.write_register(0x4200, 64_425);
    wait(&mut fpga, 20_000);
    assert_eq!(fpga.analog_output(0).volts, -10.0);
    wait(&mut fpga, 1_000);
    assert_eq!(fpga.analog_output(0).volts, 5.0);
}

#[test]
fn module_pins_that_are_plain_outputs_switch_drives_on() {
    let mut fpga = turned_by_hand();
    for port in 0..3 {
        fpga.write_register(0x1200 + 4 * port, 0);
    }
    for axis in 0..6 {
        let signal = fpga.analog_output(axis);
        assert_eq!((signal.volts, signal.enabled), (-10.0, true), "{axis}");
    }
}

#[test]
fn pwm_modes_and_widths_give_the_duty_they_say() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x4200, 0x8000);
    fpga.write_register(0x4300, 0x8000);
    let mut duty = |mode: u32, value: u32| {
        fpga.write_register(0x4100, mode);
        fpga.write_register(0x4000, value);
        wait(&mut fpga, 20);
        let pwm = fpga.pwm().expect("PWM");
        let duty = pwm.duty(0, fpga.io(), fpga.now()).expect("connected");
        (duty, pwm.frequency(0, fpga.now()))
    };
    let quarter = |bits: u32| 1 << (bits - 2) << 16;
    for (width, bits) in [(0, 9), (1, 10), (2, 11), (3, 12)] {
        let rate = 100e6 / f64::from(1 << bits);
        assert_eq!(duty(width, quarter(bits)), (0.25, rate));
        assert_eq!(duty(width | 1 << 2, quarter(bits)), (0.25, rate / 2.0));
    }
    assert_eq!(duty(0, 512 << 16).0, 1.0, "never more than all of the time");
    assert_eq!(duty(0b11_000, 1024 << 16), (0.25, 100e6), "PDM");
    let reverse = 1 << 31 | quarter(9);
    assert_eq!(duty(0b01_000, quarter(9)).0, 0.0, "direction on this pin");
    assert_eq!(duty(0b01_000, reverse).0, 1.0);
    assert_eq!(duty(0b10_000, reverse).0, 0.25, "up");
    assert_eq!(
        duty(0b10_000, quarter(9)).0,
        0.0,
        "down is on the other pin"
    );
    assert_eq!(
        duty(1 << 6, quarter(9) | 0xFFFF).0,
        0.25,
        "version 0 does not dither"
    );
    fpga.write_register(0x1400, 1);
    let duty = fpga.pwm().expect("PWM").duty(0, fpga.io(), fpga.now());
    assert_eq!(duty, Some(0.75), "inverted pin");
}

#[test]
fn pwm_of_version_1_dithers() {
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(gtag::PWM).expect("PWM").version = 1;
    let mut fpga = SimFpga::new(firmware);
    set_up_pins(&mut fpga, &[0]);
    fpga.write_register(0x4200, 64_425);
    fpga.write_register(0x4100, 1 << 6 | 3);
    fpga.write_register(0x4000, 2048 << 16 | 0x8000);
    wait(&mut fpga, 20);
    let volts = fpga.analog_output(0).volts;
    assert!((volts - 0.5 / 2048.0 * 10.0).abs() < 1e-9, "{volts}");
}

#[test]
fn newer_firmware_with_inm_and_outm_behaves_alike() {
    let mut fpga = machines::i7i97_inm_outm(1);
    assert_eq!(fpga.read_register(0x8500) & 0x1F, 15);
    assert_eq!(fpga.read_register(0x8800), 0, "no current flows");
    fpga.set_input(12, true);
    // 16 inputs of 40 ns.
    for invert in [0, 1 << 5] {
        fpga.write_register(0x8500, invert);
        wait(&mut fpga, 2 * 640);
        assert_eq!(fpga.read_register(0x8800), 1 << 12, "invert {invert:x}");
        assert_eq!(fpga.read_register(0x8700), 1 << 12, "no filter set");
    }
    fpga.write_register(0xB000, 0b100);
    assert!(!fpga.isolated_output(2), "the pin is no output yet");
    set_up_pins(&mut fpga, &[21]);
    assert!(fpga.isolated_output(2) && fpga.pin_level(21));
    assert_eq!(fpga.read_register(0xB000), 0b100);
}

#[test]
fn a_pwm_drives_its_motor_and_the_watchdog_stops_it() {
    let mut fpga = machines::i7i97(1);
    let motor = MotorConfig::default();
    fpga.wire_axis(AxisWiring {
        source: DriveSource::Pwm { unit: 5 },
        encoder: 5,
        motor,
    });
    let outputs: Vec<usize> = (0..9).chain(18..30).collect();
    set_up_pins(&mut fpga, &outputs);
    fpga.write_register(0x4200, 0xFFFF);
    fpga.write_register(0x4114, 3);
    fpga.write_register(0x4014, 3072 << 16);
    fpga.write_register(0x4400, 1 << 5);
    fpga.write_register(0x0C00, 10_000_000 - 1);
    wait(&mut fpga, 99 * MS);
    let speed = fpga.motor(5 - 5).expect("axis").velocity();
    assert!((speed - 50.0).abs() < 1e-3, "{speed}");
    let position = fpga.motor(0).expect("axis").counts();
    // The filter takes three samples, 0.05 counts at this speed (FACTS 12.6).
    let behind = position.floor() - f64::from(count(&mut fpga, 5));
    assert!(behind == 0.0 || behind == 1.0, "{behind}");
    wait(&mut fpga, 101 * MS);
    assert_eq!(fpga.read_register(0x0D00), 1);
    assert!(fpga.motor(0).expect("axis").velocity().abs() < 1e-6);
}

/// Control of an InMux with a scan of 50.56 us: 16 inputs, 4 * (78 + 1) clocks each; inverted.
const INMUX_SCAN: u32 = 78 << 6 | 1 << 5;

#[test]
fn inmux_filters_for_the_scans_it_is_told() {
    let mut fpga = turned_by_hand();
    // 5 scans short, 50 long.
    fpga.write_register(0x8000, 50 << 22 | 5 << 16 | INMUX_SCAN);
    assert_eq!(fpga.read_register(0x8000) & 0x1F, 15);
    fpga.write_register(0x8100, 1 << 9);
    wait(&mut fpga, MS);
    assert_eq!(fpga.read_register(0x8200), 0);
    fpga.set_input(8, true);
    fpga.set_input(9, true);
    wait(&mut fpga, 60_000);
    assert_eq!(fpga.read_register(0x8300), 0x300);
    // Raw within a scan, then counted 5 times, and seen the next time: 6 to 7 scans.
    wait(&mut fpga, 243_000);
    assert_eq!(fpga.read_register(0x8200), 0);
    wait(&mut fpga, 52_000);
    assert_eq!(fpga.read_register(0x8200), 0x100);
    wait(&mut fpga, 2_220_000);
    assert_eq!(fpga.read_register(0x8200), 0x100);
    wait(&mut fpga, 60_000);
    assert_eq!(fpga.read_register(0x8200), 0x300);
    fpga.set_input(8, false);
    wait(&mut fpga, 200_000);
    fpga.set_input(8, true);
    wait(&mut fpga, 200_000);
    assert_eq!(
        fpga.read_register(0x8200),
        0x300,
        "a short pulse does not get through"
    );
    // Without global invert, the opto-isolators show.
    fpga.write_register(0x8000, 78 << 6);
    wait(&mut fpga, 100_000);
    assert_eq!(fpga.read_register(0x8300), 0xFCFF);
}

#[test]
fn inmux_slots_that_are_too_short_for_the_multiplexer_shift_all_inputs_by_one() {
    for (divisor, expected) in [(7, 1 << 4), (6, 1 << 3), (5, 1 << 3)] {
        let mut fpga = turned_by_hand();
        fpga.write_register(0x8000, divisor << 6 | 1 << 5);
        fpga.set_input(4, true);
        wait(&mut fpga, MS);
        let slot = 40 * (divisor + 1);
        assert_eq!(fpga.read_register(0x8300), expected, "slots of {slot} ns");
    }
}

#[test]
fn an_input_that_chatters_adds_up_in_its_filter() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x8000, 8 << 16 | INMUX_SCAN);
    wait(&mut fpga, MS);
    // Two scans on and one off, which a filter that wants 8 in a row never lets through.
    for n in 0..27 {
        fpga.set_input(0, n % 3 != 2);
        wait(&mut fpga, 50_560);
    }
    assert_eq!(fpga.read_register(0x8200), 1);
}

#[test]
fn inmux_without_its_address_pins_reads_one_input_everywhere() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x8000, INMUX_SCAN);
    fpga.set_input(3, true);
    wait(&mut fpga, 110_000);
    assert_eq!(fpga.read_register(0x8300), 0x0008);
    set_up_pins(&mut fpga, &[]);
    wait(&mut fpga, 110_000);
    assert_eq!(fpga.read_register(0x8300), 0);
    fpga.set_input(15, true);
    wait(&mut fpga, 110_000);
    assert_eq!(fpga.read_register(0x8300), 0xFFFF);
}

#[test]
fn mpg_counters_count_once_or_four_times_a_cycle_and_up_when_b_leads() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x8000, INMUX_SCAN);
    fpga.write_register(0x8400, 0x0000_0100);
    for _ in 0..10 {
        for (a, b) in [(false, true), (true, true), (true, false), (false, false)] {
            for pair in [0, 2] {
                fpga.set_input(pair, a);
                fpga.set_input(pair + 1, b);
            }
            wait(&mut fpga, MS);
        }
    }
    assert_eq!(fpga.read_register(0x8400), 0x0000_280A);
    for _ in 0..13 {
        for (a, b) in [(true, false), (true, true), (false, true), (false, false)] {
            fpga.set_input(0, a);
            fpga.set_input(1, b);
            wait(&mut fpga, MS);
        }
    }
    assert_eq!(fpga.read_register(0x8400), 0x0000_28FD, "10 - 13 is 0xFD");
    fpga.write_register(0x8400, 0x0000_0001);
    assert_eq!(fpga.read_register(0x8400), 0x0000_28FD, "modes keep counts");
}

#[test]
fn ssr_outputs_need_their_drive_and_their_pins() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x7D00, 0b10_0001);
    assert!(!fpga.isolated_output(0), "no drive yet");
    fpga.write_register(0x7E00, 1 << 12 | 0x30);
    let frequency = fpga.ssr().expect("SSR").drive_frequency();
    assert!((frequency - 1e6).abs() < 1.0);
    let outputs: Vec<bool> = (0..6).map(|n| fpga.isolated_output(n)).collect();
    assert_eq!(outputs, [true, false, false, false, false, true]);
    set_up_pins(&mut fpga, &[19, 20, 21, 22, 23, 24]);
    assert!(!fpga.isolated_output(0), "no AC reference");
}

/// A DPLL set up for 1 kHz by the formulas of FACTS 13.8, with the limit and time constant given.
fn dpll_at_1_khz(limit: u32, time_constant: u32) -> SimFpga {
    let mut fpga = machines::i7i97(1);
    assert_eq!(fpga.read_register(0x7300) & 0xFF, 42);
    let prescale = ((1u64 << 30) as f64 * 100e6 / (2f64.powi(42) * 1000.0)) as u32;
    let base = (1000.0 * 2f64.powi(42) * f64::from(prescale) / 100e6) as u32;
    fpga.write_register(0x7000, base);
    fpga.write_register(0x7200, prescale << 24 | limit);
    fpga.write_register(0x7300, time_constant << 16);
    let period = fpga.dpll().expect("DPLL").period().expect("runs");
    assert!((period - 1e6).abs() < 1.0);
    wait(&mut fpga, MS);
    fpga
}

fn fraction(word: u32) -> f64 {
    f64::from(word as i32) / 4_294_967_296.0
}

#[test]
fn dpll_follows_the_cycle_of_its_host_and_says_how_late_it_is() {
    let mut fpga = dpll_at_1_khz(0x0040_0000, 0xA000);
    fpga.write_register(0x7100, 0);
    wait(&mut fpga, 10 * MS + 100_000);
    let first = fraction(fpga.read_register(0x7600));
    assert!((first - 0.1).abs() < 0.001, "100 us late: {first}");
    // It rings, with two seconds a period: FACTS 12.4.
    let mut crossed = None;
    let mut error = first;
    for n in 0..3_000 {
        wait(&mut fpga, MS);
        error = fraction(fpga.read_register(0x7600));
        if error < 0.0 && crossed.is_none() {
            crossed = Some(n);
        }
    }
    assert!(
        crossed.is_some_and(|n| (400..600).contains(&n)),
        "{crossed:?}"
    );
    assert!(error.abs() < 0.03, "{error}");
}

#[test]
fn a_timer_rises_before_the_reference_by_its_register() {
    // Nobody syncs, so that it runs free.
    let mut fpga = dpll_at_1_khz(0x0040_0000, 0xA000);
    fpga.write_register(0x7100, 0);
    fpga.write_register(0x7400, 0xE666_1999);
    let begin = fpga.now();
    let edge = |timer: u8| {
        let dpll = fpga.dpll().expect("a DPLL");
        dpll.next_edge(begin + 5 * MS / 2, timer).expect("it runs") - begin
    };
    let near = |edge: u64, expected: u64| assert!(edge.abs_diff(expected) < 2_000, "{edge}");
    near(edge(0), 3_000_000);
    near(edge(1), 2_900_000);
    near(edge(2), 3_100_000);
}

#[test]
fn leds_are_the_top_bits() {
    let mut fpga = machines::i7i97(1);
    fpga.write_register(0x0200, 0xA000_00FF);
    let lit: Vec<bool> = (0..4).map(|led| fpga.leds().is_lit(led)).collect();
    assert_eq!(lit, [true, false, true, false]);
}
