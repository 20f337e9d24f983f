//! Settings of the encoders, single and shared, and their greatest count rate.

use mesa_hal::hal::PinError;
use mesa_hal_sim::SimFpga;

use crate::boards::board_7i97::{Machine, board};

#[test]
fn settings_common_to_all_encoders_can_be_set() {
    let mut machine = board();
    let frequency = machine.output::<u32>("encoder.muxed-sample-frequency");
    let skew = machine.output::<u32>("encoder.muxed-skew");
    let fine_stamps = machine.output::<bool>("encoder.hires-timestamp");
    let timer = machine.output::<i32>("encoder.timer-number");
    let velocity = machine.input::<f64>("encoder.00.velocity");
    let [encoder, ..] = machine.cards.encoders;
    let registers = |machine: &mut Machine<SimFpga>| {
        let fpga = machine.fpga();
        // The rate register cannot be read back.
        let rate = fpga.encoders().expect("encoders").rate();
        let timer = fpga.read_register(0x3B00);
        [fpga.read_register(0x3800) & 0xFFFF, rate, timer]
    };
    let turn = |machine: &mut Machine<SimFpga>, speed| {
        machine.turn(0, speed);
        machine.cycles(20);
        let pins = machine.driver.pins();
        (
            pins.read(velocity).value,
            pins.read(encoder.rawcounts).value,
        )
    };
    let counts = machine
        .fpga()
        .motor(0)
        .expect("an axis")
        .config()
        .counts_per_unit;
    machine.cycles(2);
    assert_eq!(machine.driver.pins().commanded(frequency), 6_250_000);
    // ClockLow/100, ClockLow/16, no latch.
    assert_eq!(registers(&mut machine), [98, 14, 0]);
    let (slow, before) = turn(&mut machine, 1.0);
    let pins = machine.driver.pins_mut();
    pins.set(frequency, 12_500_000);
    pins.set(skew, 50);
    pins.set(fine_stamps, true);
    pins.set(timer, 1);
    let (fine, after) = turn(&mut machine, 1.0);
    // ClockLow/10, ClockLow/8 and 5 clocks, timer 1.
    assert_eq!(registers(&mut machine), [8, 0x5000_0006, 0x9000]);
    let rate = machine.fpga().encoders().expect("encoders").sample_rate();
    assert!((rate - 6.25e6).abs() < 1.0, "{rate}");
    for velocity in [slow, fine] {
        assert!((velocity / counts - 1.0).abs() < 0.02, "{velocity}");
    }
    assert!(after > before, "it counts on: {before}, {after}");

    // Also after the board has lost its set-up.
    machine.fpga().reload();
    assert_eq!(registers(&mut machine)[2], 0);
    for _ in 0..50 {
        let _ = machine.driver.rearm();
        let _ = machine.cycle();
    }
    assert_eq!(registers(&mut machine), [8, 0x5000_0006, 0x9000]);
    let (again, _) = turn(&mut machine, 1.0);
    assert!((again / counts - 1.0).abs() < 0.02, "{again}");

    let pins = machine.driver.pins_mut();
    pins.set(timer, 9);
    pins.set(skew, 0);
    pins.set(fine_stamps, false);
    pins.set(frequency, 6_250_000);
    machine.cycles(1);
    assert_eq!(registers(&mut machine), [98, 14, 0]);
}

/// Turns encoder 5 for 100 ms at this number of counts per second: the change of its count, the
/// velocity, and true if the speed is reported as near the greatest.
fn turned(machine: &mut Machine<SimFpga>, counts_per_second: f64) -> (f64, f64, bool) {
    let encoder = machine.cards.encoders[5];
    let velocity = machine.input::<f64>("encoder.05.velocity");
    let is_near = machine.input::<bool>("encoder.05.near-max-count-rate");
    let motor = machine.fpga().motor(5).expect("an axis");
    let counts = motor.config().counts_per_unit;
    motor.turn_by_hand(Some(counts_per_second / counts));
    machine.cycles(2);
    let read = |machine: &Machine<SimFpga>, pin| machine.driver.pins().read(pin).value;
    let before = read(machine, encoder.rawcounts);
    machine.cycles(100);
    let moved = read(machine, encoder.rawcounts).wrapping_sub(before);
    let pins = machine.driver.pins();
    let result = (
        f64::from(moved),
        pins.read(velocity).value,
        pins.read(is_near).value,
    );
    machine.fpga().motor(5).expect("an axis").turn_by_hand(None);
    machine.cycles(20);
    result
}

/// Manual: 7I97, "MAXIMUM ENCODER COUNT RATE" promises 3 MHz at ClockLow/16; the gateware follows
/// clock / (3 (n + 2)) with the short filter and clock / (15 (n + 2)) with the long one (FACTS
/// 12.6), and reports no error beyond.
#[test]
fn max_count_rate_is_published_reached_and_reported_when_near() {
    let mut machine = board();
    let frequency = machine.output::<u32>("encoder.muxed-sample-frequency");
    let watched = machine.output::<bool>("encoder.05.quad-error-enable");
    let quad_error = machine.input::<bool>("encoder.05.quad-error");
    let long_filter = machine.param::<bool>("encoder.05.filter");
    let max_count_rate = machine.param::<f64>("encoder.05.max-count-rate");
    machine.driver.pins_mut().set(watched, true);
    for (filter, sample_hz, greatest) in [
        (None, 6_250_000, 100e6 / 48.0),
        (Some(true), 6_250_000, 100e6 / 240.0),
        (Some(false), 10_000_000, 100e6 / 30.0),
        (Some(true), 12_500_000, 100e6 / 120.0),
    ] {
        let pins = machine.driver.pins_mut();
        if let Some(filter) = filter {
            pins.set_param(long_filter, filter).expect("a switch");
        }
        pins.set(frequency, sample_hz);
        machine.cycles(2);
        let told = machine.driver.pins().param(max_count_rate);
        assert!((told / greatest - 1.0).abs() < 1e-9, "{told}, {greatest}");
        // The filters decrease to their new length with the first counts.
        let _ = turned(&mut machine, 10_000.0);
        // Velocity is derived from stamps of a microsecond, of which a cycle has a thousand.
        for speed in [0.8, -0.8, 0.98, -0.98].map(|part| part * greatest) {
            let (moved, velocity, near) = turned(&mut machine, speed);
            assert!((moved / speed - 0.1).abs() < 0.001, "{speed}: {moved}");
            assert!(
                (velocity / speed - 1.0).abs() < 0.003,
                "{speed}: {velocity}"
            );
            assert_eq!(near, speed.abs() > 0.9 * greatest, "{speed} of {greatest}");
        }
        let (moved, ..) = turned(&mut machine, 1.4 * greatest);
        let wrong = (moved / (0.14 * greatest) - 1.0).abs();
        assert!(wrong > 0.2, "beyond it counts are garbage: {moved}");
        assert!(!machine.driver.pins().read(quad_error).value);
    }
}

#[test]
fn quadrature_error_is_reported_until_its_detection_is_disabled() {
    let mut machine = board();
    let watched = machine.output::<bool>("encoder.02.quad-error-enable");
    let quad_error = machine.input::<bool>("encoder.02.quad-error");
    let error = |machine: &mut Machine<SimFpga>| {
        machine.cycles(4);
        let said = machine.driver.pins().read(quad_error).value;
        (said, machine.fpga().read_register(0x3708) & 0x8000 != 0)
    };
    let disturb = |machine: &mut Machine<SimFpga>| {
        machine.fpga().encoders().expect("encoders").disturb(2);
    };
    machine.driver.pins_mut().set(watched, true);
    assert_eq!(error(&mut machine), (false, false));
    disturb(&mut machine);
    assert_eq!(error(&mut machine), (true, true));
    machine.driver.pins_mut().set(watched, false);
    assert_eq!(error(&mut machine), (false, false), "cleared in the board");
    machine.driver.pins_mut().set(watched, true);
    assert_eq!(error(&mut machine), (false, false));
    // Errors from unwatched times are not reported later.
    machine.driver.pins_mut().set(watched, false);
    disturb(&mut machine);
    machine.cycles(4);
    machine.driver.pins_mut().set(watched, true);
    assert_eq!(error(&mut machine), (false, false));
}

#[test]
fn absent_probe_latches_no_count_and_is_counted_as_refused() {
    let mut machine = board();
    let encoder = machine.cards.encoders[0];
    let probe = machine.output::<bool>("encoder.00.probe-enable");
    let latched = machine.input::<i32>("encoder.00.count-latched");
    machine.turn(0, 1.0);
    machine.cycles(10);
    machine.driver.pins_mut().set(probe, true);
    machine.cycles(10);
    let pins = machine.driver.pins();
    assert_eq!(pins.read(latched).value, 0);
    assert!(pins.rejections(probe).out_of_range > 0);
    // The index still works.
    let pins = machine.driver.pins_mut();
    pins.set(encoder.index_enable, true);
    machine.turn(0, 50.0);
    machine.cycles(200);
    assert!(!machine.driver.pins().read(encoder.index_enable).value);
}

#[test]
fn scale_of_0_is_refused_and_the_previous_scale_stays_in_use() {
    let mut machine = board();
    let encoder = machine.cards.encoders[1];
    machine.set_param(encoder.scale, 8.0);
    machine.turn(1, 1.0);
    machine.cycles(10);
    for scale in [0.0, f64::NAN, f64::INFINITY, 1e-310] {
        let refused = machine.driver.pins_mut().set_param(encoder.scale, scale);
        assert!(matches!(refused, Err(PinError::BadScale { .. })), "{scale}");
    }
    let idle = machine.param::<f64>("encoder.01.vel-timeout");
    let refused = machine.driver.pins_mut().set_param(idle, -1.0);
    let refused = refused.expect_err("no time").to_string();
    assert_eq!(
        refused,
        "`hm2_7i97.0.encoder.01.vel-timeout` cannot be set to -1: it takes a finite number (its limits are 0 to 3600); it keeps its value"
    );
    machine.cycles(2);
    let pins = machine.driver.pins();
    let count = f64::from(pins.read(encoder.count).value);
    assert!(count.abs() > 0.0, "it turns");
    assert!((pins.read(encoder.position).value - count / 8.0).abs() < f64::EPSILON);
}

/// Turns axis 0 by hand at a velocity in units per second, for a number of cycles.
fn turn(machine: &mut Machine<SimFpga>, velocity: f64, cycles: usize) {
    machine.turn(0, velocity);
    machine.cycles(cycles);
}

/// Sets the scale of encoder 0 to the counts per unit of its motor, and returns it.
fn scaled(machine: &mut Machine<SimFpga>) -> f64 {
    let motor = machine.fpga().motor(0).expect("an axis");
    let counts = motor.config().counts_per_unit;
    let scale = machine.cards.encoders[0].scale;
    let pins = machine.driver.pins_mut();
    pins.set_param(scale, counts).expect("a scale");
    counts
}

#[test]
fn counts_follow_the_motor_across_many_wraps_of_the_counter() {
    let mut machine = board();
    let encoder = machine.cards.encoders[0];
    let counts = scaled(&mut machine);
    turn(&mut machine, 0.0, 2);
    let at = |machine: &mut Machine<SimFpga>| machine.fpga().motor(0).expect("an axis").counts();
    let start = at(&mut machine);
    let first = machine.driver.pins().read(encoder.rawcounts).value;
    for velocity in [700.0, -350.0, 2_000.0] {
        turn(&mut machine, velocity, 500);
        turn(&mut machine, 0.0, 1);
        let moved = at(&mut machine) - start;
        let pins = machine.driver.pins();
        let counted = f64::from(pins.read(encoder.rawcounts).value - first);
        assert!((counted - moved).abs() <= 1.0, "{counted} and {moved}");
        let position = pins.read(encoder.position).value;
        assert!((position - moved / counts).abs() < 0.003, "{position}");
    }
}

#[test]
fn velocity_is_right_from_0_1_to_thousands_of_counts_per_cycle() {
    for velocity in [0.1, -0.45, 3.0, 250.0, -1_500.0] {
        let mut machine = board();
        scaled(&mut machine);
        let pin = machine.input::<f64>("encoder.00.velocity");
        turn(&mut machine, velocity, 400);
        let measured = machine.driver.pins().read(pin).value;
        let error = (measured - velocity).abs();
        assert!(error < velocity.abs() * 0.01, "{velocity}: {measured}");
        turn(&mut machine, 0.0, 600);
        let measured = machine.driver.pins().read(pin).value;
        assert!(measured.abs() < 1e-12, "{velocity}: {measured}");
    }
}

#[test]
fn index_enable_finds_the_index_at_every_speed() {
    for velocity in [5.0, -5.0, 900.0] {
        let mut machine = board();
        scaled(&mut machine);
        let encoder = machine.cards.encoders[0];
        turn(&mut machine, 0.0, 2);
        turn(&mut machine, velocity, 10);
        machine.driver.pins_mut().set(encoder.index_enable, true);
        let mut cycles = 0;
        while machine.driver.pins().read(encoder.index_enable).value {
            machine.cycles(1);
            cycles += 1;
            assert!(cycles < 2_000, "no index at {velocity}");
        }
        turn(&mut machine, 0.0, 1);
        let count = machine.driver.pins().read(encoder.count).value;
        let counts = machine.fpga().motor(0).expect("an axis").counts();
        // Zero is at a multiple of the 4000 counts of a revolution.
        let off = (counts - f64::from(count)).rem_euclid(4_000.0);
        let is_there = off <= 2.0 || off >= 3_998.0;
        assert!(is_there, "{velocity}: count {count} at {counts}");
    }
}
