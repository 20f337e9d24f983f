//! What is set for the encoders, alone and together, and how fast they may turn.

use mesa_hal::sim::SimFpga;

use super::{Machine, board};

#[test]
fn what_all_encoders_have_in_common_can_be_set() {
    let mut machine = board();
    let (bank, [encoder, ..]) = (machine.card.encoder_bank, machine.card.encoders);
    let skew = bank.muxed_skew.expect("version 4");
    let timer = bank.timer_number.expect("there is a DPLL");
    let registers = |machine: &mut Machine<SimFpga>| {
        let fpga = machine.fpga();
        [0x3700, 0x3900, 0x3A00].map(|address| fpga.read_register(address))
    };
    let turn = |machine: &mut Machine<SimFpga>, speed| {
        let motor = machine.fpga().motor(0).expect("an axis");
        motor.turn_by_hand(Some(speed));
        machine.cycles(20);
        let pins = machine.driver.pins();
        (
            pins.read(encoder.velocity).value,
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
    assert_eq!(
        machine.driver.pins().commanded(bank.sample_frequency),
        6_250_000
    );
    // ClockLow/100, ClockLow/16, no latch.
    assert_eq!(registers(&mut machine), [98, 14, 0]);
    let (slow, before) = turn(&mut machine, 1.0);
    let pins = machine.driver.pins_mut();
    pins.set(bank.sample_frequency, 12_500_000);
    pins.set(skew, 50);
    pins.set(bank.hires_timestamp, true);
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

    // After the board has lost its set-up, too.
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
    pins.set(bank.hires_timestamp, false);
    pins.set(bank.sample_frequency, 6_250_000);
    machine.cycles(1);
    assert_eq!(registers(&mut machine), [98, 14, 0]);
}

/// Manual: 7I97, "MAXIMUM ENCODER COUNT RATE".
#[test]
fn encoders_are_followed_up_to_3_mhz_when_their_filter_is_short() {
    let mut machine = board();
    let encoder = machine.card.encoders[5];
    let pins = machine.driver.pins_mut();
    pins.set_param(encoder.filter, false).expect("a switch");
    pins.set(encoder.quad_error_enable, true);
    machine.cycles(2);
    for counts_per_second in [3.0e6, -3.0e6] {
        let motor = machine.fpga().motor(5).expect("an axis");
        let counts = motor.config().counts_per_unit;
        motor.turn_by_hand(Some(counts_per_second / counts));
        machine.cycles(2);
        let read = |machine: &Machine<SimFpga>| {
            let pins = machine.driver.pins();
            (
                pins.read(encoder.rawcounts).value,
                pins.read(encoder.velocity).value,
            )
        };
        let (before, _) = read(&machine);
        machine.cycles(100);
        let (after, velocity) = read(&machine);
        let moved = f64::from(after.wrapping_sub(before));
        assert!((moved / counts_per_second - 0.1).abs() < 0.001, "{moved}");
        assert!(
            (velocity / counts_per_second - 1.0).abs() < 0.001,
            "{velocity}"
        );
    }
    assert!(!machine.driver.pins().read(encoder.quad_error).value);
    let motor = machine.fpga().motor(5).expect("an axis");
    motor.turn_by_hand(Some(4_000.0));
    machine.cycles(3);
    assert!(
        machine.driver.pins().read(encoder.quad_error).value,
        "4 MHz"
    );
}
