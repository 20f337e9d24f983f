//! Circuits around the modules of the simulated FPGA: multiplexers, drives and pins, see FACTS 9.4
//! and 13. The modules themselves are compared with recordings, in `tests/module_conformance`.

use mesa_hal_sim::{AxisWiring, DriveSource, Motor, MotorConfig, SimFpga, machines};

const MS: u64 = 1_000_000;

/// Connects all pins of a connector to their modules: direction and alternate source.
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
            motor: Motor::new(MotorConfig {
                counts_per_unit: 1.0,
                counts_per_revolution: 400,
                ..MotorConfig::default()
            })
            .unwrap(),
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
    fpga.read_register(0x3600 + 4 * encoder) as u16
}

#[test]
fn select_line_that_a_pin_inverts_or_holds_shows_other_encoders() {
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

/// Control of an InMux with a scan of 50.56 us: 16 inputs, 4 * (78 + 1) clocks each; inverted.
const INMUX_SCAN: u32 = 78 << 6 | 1 << 5;

#[test]
fn short_inmux_slots_shift_all_inputs_by_one() {
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

#[test]
fn pwm_gives_volts_while_connected_whether_enabled_or_not() {
    let mut fpga = turned_by_hand();
    // 12 bits at 48 kHz: 200 MHz * n / 65536 / 4096.
    fpga.write_register(0x4300, 64_425);
    fpga.write_register(0x4204, 3);
    let write = |fpga: &mut SimFpga, value: u32| {
        fpga.write_register(0x4104, value << 16);
        wait(fpga, 20);
    };
    write(&mut fpga, 2048);
    let frequency = fpga.pwm().expect("PWM").frequency(1, fpga.now());
    assert!((frequency - 48_000.0).abs() < 1.0, "{frequency}");
    assert_eq!(fpga.analog_output(1).volts, 0.0);
    write(&mut fpga, 3072);
    let signal = fpga.analog_output(1);
    assert_eq!((signal.volts, signal.enabled), (5.0, false));
    fpga.write_register(0x4500, 0x3F);
    assert_eq!(fpga.analog_output(1).volts, 5.0);
    write(&mut fpga, 0);
    assert_eq!(fpga.analog_output(1).volts, -10.0);
    write(&mut fpga, 4095);
    assert!((fpga.analog_output(1).volts - 9.995).abs() < 0.001);
    assert!(fpga.analog_output(1).enabled);
    fpga.write_register(0x4500, 0x3E);
    assert!(
        !fpga.analog_output(1).enabled,
        "ENA0 to ENA3 follow output 0"
    );
    assert!((fpga.analog_output(1).volts - 9.995).abs() < 0.001);
    assert!(fpga.analog_output(4).enabled && fpga.analog_output(5).enabled);
    fpga.write_register(0x4500, 0x3F);
    fpga.write_register(0x0C00, 1);
    wait(&mut fpga, MS);
    let signal = fpga.analog_output(1);
    assert_eq!((signal.volts, signal.enabled), (0.0, false), "bitten");
}

#[test]
fn double_buffered_value_waits_for_the_end_of_the_period() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x4200, 0x23);
    fpga.write_register(0x4100, 3072 << 16);
    wait(&mut fpga, 10 * MS);
    assert_eq!(fpga.analog_output(0).volts, -10.0, "its clock stands");
    fpga.write_register(0x4300, 64_425);
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
fn pwm_modes_and_widths_give_the_specified_duty() {
    let mut fpga = turned_by_hand();
    fpga.write_register(0x4300, 0x8000);
    fpga.write_register(0x4400, 0x8000);
    let mut duty = |mode: u32, value: u32| {
        fpga.write_register(0x4200, mode);
        fpga.write_register(0x4100, value);
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
fn watchdog_bites_if_disabled_while_running_or_fed_before_set() {
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
