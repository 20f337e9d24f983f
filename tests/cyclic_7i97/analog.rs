//! The analog outputs: voltages, enables, and the PWM behind them.

use super::*;

#[test]
fn analog_outputs_have_12_bits_of_volts_and_no_value_turns_round() {
    let mut machine = board();
    let card = machine.card.clone();
    machine.driver.pins_mut().set(card.enables[0], true);
    for (n, enable) in card.enables.into_iter().enumerate() {
        machine.driver.pins_mut().set(enable, true);
        machine.cycles(2);
        let on = machine.fpga().analog_output(n).enabled;
        assert!(on, "enable {n}");
    }
    let largest = 10.0 - 20.0 / 4096.0;
    for (set, expected) in [
        (2.5, 2.5),
        (-10.0, -10.0),
        (10.0, largest),
        (1e9, largest),
        (f64::NAN, 0.0),
        (-1e300, -10.0),
        (f64::NEG_INFINITY, 0.0),
        (7.0, 7.0),
    ] {
        for output in card.analog_out {
            machine.driver.pins_mut().set(output.value, set);
        }
        machine.cycles(1);
        for n in 0..6 {
            let volts = machine.fpga().analog_output(n).volts;
            assert!(
                (volts - expected).abs() <= 10.0 / 4096.0,
                "{set}: output {n} has {volts}"
            );
        }
    }
    for output in card.analog_out {
        let refused = machine.driver.pins().rejections(output.value);
        assert_eq!((refused.not_finite, refused.out_of_range), (2, 2));
    }
}

#[test]
fn enables_0_to_3_switch_together_and_4_and_5_alone() {
    let mut machine = board();
    let card = machine.card.clone();
    let enabled = |machine: &mut Machine<SimFpga>| {
        [0, 1, 2, 3, 4, 5].map(|n| machine.fpga().analog_output(n).enabled)
    };
    machine.cycles(2);
    assert_eq!(enabled(&mut machine), [false; 6]);
    for (enable, expected) in [
        (0, [true, true, true, true, false, false]),
        (4, [false, false, false, false, true, false]),
        (5, [false, false, false, false, false, true]),
    ] {
        for (n, pin) in card.enables.into_iter().enumerate() {
            machine.driver.pins_mut().set(pin, n == enable);
        }
        machine.cycles(1);
        assert_eq!(enabled(&mut machine), expected, "enable {enable}");
    }
}

#[test]
fn the_pwm_frequency_is_what_the_manual_says_and_can_be_changed() {
    let mut machine = board();
    let hz = |machine: &mut Machine<SimFpga>| machine.fpga().pwm().expect("PWM").frequency(3);
    assert!((hz(&mut machine) - 48_000.0).abs() < 1.0);
    let bank = machine.card.pwm_bank;
    let [output, ..] = machine.card.analog_out;
    let pins = machine.driver.pins_mut();
    pins.set_param(bank.pwm_frequency, 96_000)
        .expect("a frequency");
    pins.set(output.value, 5.0);
    pins.set(output.enable, true);
    machine.cycles(2);
    assert!((hz(&mut machine) - 96_000.0).abs() < 1.0);
    assert!((machine.fpga().analog_output(0).volts - 5.0).abs() < 0.01);
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(6).expect("PWM").version = 1;
    let mut dithers = Machine::new(SimFpga::new(firmware));
    assert!((hz(&mut dithers) - 96_000.0).abs() < 1.0);
    let [output, ..] = dithers.card.analog_out;
    let pins = dithers.driver.pins_mut();
    pins.set(output.value, 1.234_567);
    pins.set(output.enable, true);
    dithers.cycles(1);
    let volts = dithers.fpga().analog_output(0).volts;
    assert!((volts - 1.234_567).abs() < 1e-6, "{volts}");
}
