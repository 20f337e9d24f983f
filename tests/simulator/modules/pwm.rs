//! PWM generators.

use super::{MS, count, set_up_pins, turned_by_hand, wait};
use mesa_hal::sim::{AxisWiring, DriveSource, MotorConfig, SimFpga, gtag, machines};

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
