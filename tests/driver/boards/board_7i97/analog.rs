//! The analog outputs: voltages, enables, and the PWM behind them.

use mesa_hal::boards::PwmTable;
use mesa_hal::driver::PwmConfig;
use mesa_hal::hal::Value;
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::{SimPinDescriptor, gtag};

use super::*;
use crate::common::watch::Watch;

#[test]
fn no_drive_has_a_voltage_or_enable_during_set_up() {
    // Left by a program at 9.5 V and enabled; its watchdog has bitten.
    let mut used = machines::i7i97(1);
    used.write_register(0x4300, 64_425);
    for generator in 0..6 {
        used.write_register(0x4200 + 4 * generator, 0x23);
        used.write_register(0x4100 + 4 * generator, 0x0F80_0000);
    }
    used.write_register(0x4500, 0x3F);
    used.write_register(0x1200, 0x1FF);
    used.advance_to(1_000_000);
    for mut fpga in [machines::i7i97(1), used] {
        // A bus fast enough for the whole set-up to fit into a period of the PWM.
        fpga.set_access_cost(20);
        let watch = Watch::now(&mut fpga);
        let mut machine = started(fpga);
        machine.cycles(5);
        assert_eq!(watch.seen().volts, []);
    }
}

/// Sets a parameter of each of the six generators.
fn set_all<T: Value>(driver: &mut Driver<SimFpga>, name: &str, value: T) {
    for n in 0..6 {
        let name = format!("hm2_9i99.0.pwmgen.{n:02}.{name}");
        let pins = driver.pins_mut();
        let param = pins.parameter(&name).expect("a parameter");
        pins.set_param(param, value).expect("a value that it takes");
    }
}

fn set_hz(driver: &mut Driver<SimFpga>, name: &str, hz: u32) {
    let pins = driver.pins_mut();
    let param = pins.parameter(&format!("hm2_9i99.0.pwmgen.{name}"));
    let set = pins.set_param(param.expect("a parameter"), hz);
    set.expect("a frequency");
}

/// A 7I97 whose generators do not begin in offset mode, so that 0 would be -10 V for them.
const WITHOUT_OFFSET: BoardTable = BoardTable {
    name: "9I99",
    pwm: PwmTable {
        is_offset: false,
        ..i7i97::BOARD.pwm
    },
    ..BoardTable::CONNECTORS
};

/// Changes a generator's settings after the first set-up.
type Change = fn(&mut Driver<SimFpga>);

#[test]
fn no_drive_has_a_voltage_while_any_pwm_set_up_is_restored() {
    let offset: Change = |driver| set_all(driver, "offset-mode", true);
    let other_width: Change = |driver| set_hz(driver, "pwm_frequency", 96_000);
    let pdm: Change = |driver| {
        set_all(driver, "output-type", 3);
        set_hz(driver, "pdm_frequency", 6_000_000);
    };
    for changes in [
        vec![offset],
        vec![offset, other_width],
        vec![offset, pdm],
        vec![offset, other_width, pdm],
    ] {
        let mut firmware = machines::firmware_7i97(1);
        firmware.board = *b"MESA9I99";
        let mut fpga = SimFpga::new(firmware);
        fpga.set_access_cost(20);
        let settings = Settings {
            boards: vec![&WITHOUT_OFFSET],
            ..Settings::default()
        };
        let mut driver = Driver::start(fpga, settings).expect("a 9I99");
        let cycles = |driver: &mut Driver<SimFpga>, count| {
            for _ in 0..count {
                let _ = driver.read();
                driver.write().expect("the bus does not fail");
                driver.bus_mut().wait(Duration::from_millis(1));
            }
        };
        cycles(&mut driver, 2);
        for change in &changes {
            change(&mut driver);
        }
        let drive = |driver: &mut Driver<SimFpga>, volts: f64| {
            for n in 0..6 {
                let name = format!("hm2_9i99.0.pwmgen.{n:02}.");
                let pins = driver.pins_mut();
                let value = pins.output(&format!("{name}value")).expect("a pin");
                let enable = pins.output(&format!("{name}enable")).expect("a pin");
                pins.set(value, volts);
                pins.set(enable, true);
            }
            cycles(driver, 2);
            for n in 0..6 {
                let has = driver.bus().analog_output(n).volts;
                assert!((has - volts).abs() < 0.02, "drive {n}: {has}, not {volts}");
            }
        };
        drive(&mut driver, 5.0);
        for is_bite in [false, true] {
            if is_bite {
                driver.bus_mut().wait(Duration::from_millis(20));
            } else {
                driver.bus_mut().reload();
            }
            cycles(&mut driver, 2);
            assert_ne!(driver.board_state(), BoardState::Running);
            let watch = Watch::now(driver.bus_mut());
            let _ = driver.rearm().expect("the bus does not fail");
            cycles(&mut driver, 5);
            assert_eq!(driver.board_state(), BoardState::Running);
            assert_eq!(watch.seen().volts, [], "bite: {is_bite}");
            let _ = driver.rearm().expect("the bus does not fail");
            drive(&mut driver, -7.0);
        }
    }
}

#[test]
fn analog_outputs_have_12_bits_of_volts_and_never_wrap() {
    let mut machine = board();
    let card = machine.cards;
    for output in card.analog_out {
        machine.driver.pins_mut().set(output.enable, true);
    }
    machine.cycles(2);
    for n in 0..6 {
        assert!(machine.fpga().analog_output(n).enabled, "drive {n}");
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
            machine.driver.pins_mut().set(output.volts, set);
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
        let refused = machine.driver.pins().rejections(output.volts);
        assert_eq!((refused.not_finite, refused.out_of_range), (2, 2));
    }
}

/// Signals at the drives: volts, and true if the switch is closed.
fn drives(machine: &mut Machine<SimFpga>) -> [(f64, bool); 6] {
    [0, 1, 2, 3, 4, 5].map(|n| {
        let signal = machine.fpga().analog_output(n);
        (signal.volts, signal.enabled)
    })
}

#[test]
fn enables_0_to_3_switch_together_and_4_and_5_alone() {
    let mut machine = board();
    let card = machine.cards;
    machine.cycles(2);
    assert_eq!(drives(&mut machine), [(0.0, false); 6]);
    let enables = [card.enable_0_to_3, card.enable_4, card.enable_5];
    for (enable, expected) in [
        (0, [true, true, true, true, false, false]),
        (1, [false, false, false, false, true, false]),
        (2, [false, false, false, false, false, true]),
    ] {
        for (n, pin) in enables.into_iter().enumerate() {
            machine.driver.pins_mut().set(pin, n == enable);
        }
        machine.cycles(1);
        let switches = drives(&mut machine).map(|(_, on)| on);
        assert_eq!(switches, expected, "enable {enable}");
    }
}

#[test]
fn disabled_axis_alone_has_0_volts_and_its_value_returns() {
    for full_scale in [true, false] {
        let mut machine = board();
        let card = machine.cards;
        for (n, output) in card.analog_out.into_iter().enumerate() {
            let volts = if full_scale { 10.0 } else { n as f64 - 6.0 };
            machine.driver.pins_mut().set(output.volts, volts);
            machine.driver.pins_mut().set(output.enable, true);
        }
        machine.cycles(2);
        let before = drives(&mut machine);
        assert!(before.iter().all(|&(volts, on)| volts != 0.0 && on));
        for disabled in 0..6 {
            let enable = card.analog_out[disabled].enable;
            machine.driver.pins_mut().set(enable, false);
            machine.cycles(1);
            let mut expected = before;
            // The switch of drives 0 to 3 follows generator 0.
            let group = match disabled {
                0 => 0..4,
                1..=3 => 0..0,
                _ => disabled..disabled + 1,
            };
            for drive in &mut expected[group] {
                *drive = (0.0, false);
            }
            expected[disabled].0 = 0.0;
            assert_eq!(drives(&mut machine), expected, "axis {disabled} disabled");
            machine.driver.pins_mut().set(enable, true);
            machine.cycles(1);
            assert_eq!(drives(&mut machine), before);
        }
    }
}

#[test]
fn pdm_frequency_is_the_rate_of_its_steps() {
    let mut machine = board();
    let card = machine.cards;
    let [output, ..] = card.analog_out;
    let frequency = machine.param::<u32>("pwmgen.pdm_frequency");
    let pins = machine.driver.pins_mut();
    pins.set_param(frequency, 6_000_000).expect("a frequency");
    let output_type = pins.parameter("hm2_7i97.0.pwmgen.00.output-type");
    pins.set_param(output_type.expect("a parameter"), 3_i32)
        .expect("PDM");
    pins.set(output.enable, true);
    machine.cycles(2);
    // Half scale: the pin is high in every other step.
    let from = SimFpga::now(machine.fpga());
    let mut edges = 0;
    let mut level = machine.fpga().pin_level(0);
    for time in (from..from + 100_000).step_by(5) {
        machine.fpga().advance_to(time);
        let now = machine.fpga().pin_level(0);
        edges += u32::from(now != level);
        level = now;
    }
    assert!((599..=601).contains(&edges), "{edges} steps in 100 us");
}

#[test]
fn pwm_frequency_matches_the_manual_and_can_be_changed() {
    let mut machine = board();
    let hz = |machine: &mut Machine<SimFpga>| {
        let fpga = machine.fpga();
        fpga.pwm().expect("PWM").frequency(3, SimFpga::now(fpga))
    };
    assert!((hz(&mut machine) - 48_000.0).abs() < 1.0);
    let frequency = machine.param::<u32>("pwmgen.pwm_frequency");
    let [output, ..] = machine.cards.analog_out;
    let pins = machine.driver.pins_mut();
    pins.set_param(frequency, 96_000).expect("a frequency");
    pins.set(output.volts, 5.0);
    pins.set(output.enable, true);
    machine.cycles(2);
    assert!((hz(&mut machine) - 96_000.0).abs() < 1.0);
    assert!((machine.fpga().analog_output(0).volts - 5.0).abs() < 0.01);
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(6).expect("PWM").version = 1;
    let mut dithers = started(SimFpga::new(firmware));
    assert!((hz(&mut dithers) - 96_000.0).abs() < 1.0);
    let [output, ..] = dithers.cards.analog_out;
    let pins = dithers.driver.pins_mut();
    pins.set(output.volts, 1.234_567);
    pins.set(output.enable, true);
    dithers.cycles(1);
    let volts = dithers.fpga().analog_output(0).volts;
    assert!((volts - 1.234_567).abs() < 1e-6, "{volts}");
}

/// A 7I97 whose firmware has two additional PWM generators, on expansion pins: output, direction.
fn with_spindles() -> SimFpga {
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(gtag::PWM).expect("PWM").instances = 8;
    for (n, unit, function) in [(34, 6, 0x81), (35, 6, 0x82), (36, 7, 0x81), (37, 7, 0x82)] {
        firmware.pins[n] = SimPinDescriptor::new(gtag::PWM, unit, function);
    }
    let mut fpga = SimFpga::new(firmware);
    fpga.set_access_cost(20);
    fpga
}

/// The part of a period of 48 kHz in which an I/O pin is high.
fn high_part(fpga: &mut SimFpga, pin: usize) -> f64 {
    let from = SimFpga::now(fpga);
    let times = (from..from + 10 * 20_833).step_by(100);
    let count = times.clone().count() as f64;
    let high = times.filter(|&time| {
        fpga.advance_to(time);
        fpga.pin_level(pin)
    });
    high.count() as f64 / count
}

#[test]
fn expansion_pin_generators_are_off_and_plain_until_configured() {
    let mut driver = Driver::start(with_spindles(), Settings::default()).expect("a 7I97");
    let pins = driver.pins();
    let param = |n: u8, name: &str| {
        let id = pins.id(&format!("hm2_7i97.0.pwmgen.{n:02}.{name}"));
        pins.read_any(id.expect("a pin")).value.to_string()
    };
    let card = ["true", "10", "1"].map(String::from);
    let plain = ["false", "1", "1"].map(String::from);
    for n in 0..8 {
        let found = ["offset-mode", "scale", "output-type"].map(|name| param(n, name));
        assert_eq!(
            found,
            if n < 6 { card.clone() } else { plain.clone() },
            "{n}"
        );
    }
    let value = pins.output::<f64>("hm2_7i97.0.pwmgen.06.value");
    let info = pins.info(value.expect("a pin")).expect("a pin");
    assert_eq!((&*info.unit, info.limits), ("", Some((-1.0, 1.0))));
    for cycle in 0..3 {
        for pin in 34..38 {
            assert!(
                high_part(driver.bus_mut(), pin) < 1e-9,
                "pin {pin}, cycle {cycle}"
            );
        }
        let _ = driver.read();
        driver.write().expect("the bus does not fail");
    }
}

#[test]
fn generator_starts_with_its_settings_and_absent_one_is_refused() {
    let config = |output_type, offset_mode, scale| PwmConfig {
        output_type: Some(output_type),
        offset_mode: Some(offset_mode),
        scale: Some(scale),
    };
    let with = |pwm: &[(u8, PwmConfig)]| Settings {
        pwm: pwm.iter().copied().collect(),
        ..Settings::default()
    };
    let settings = with(&[(6, config(2, false, 24_000.0)), (7, config(1, true, -5.0))]);
    let mut driver = Driver::start(with_spindles(), settings).expect("a 7I97");
    let _ = driver.read();
    for (n, value) in [(6, 18_000.0), (7, 2.5)] {
        let pins = driver.pins_mut();
        let name = |name| format!("hm2_7i97.0.pwmgen.{n:02}.{name}");
        let output = pins.output(&name("value")).expect("a pin");
        let enable = pins.output(&name("enable")).expect("a pin");
        pins.set(output, value);
        pins.set(enable, true);
    }
    driver.write().expect("the bus does not fail");
    driver.bus_mut().wait(Duration::from_micros(100));
    let fpga = driver.bus_mut();
    // Up/down: positive values on the second pin; a negative scale reverses that.
    for (pin, part) in [(34, 0.0), (35, 0.75), (36, 0.25)] {
        let found = high_part(fpga, pin);
        assert!((found - part).abs() < 0.01, "pin {pin}: {found}");
    }
    let refused = Driver::start(with_spindles(), with(&[(8, PwmConfig::default())]));
    let error = refused.expect_err("8 generators");
    assert_eq!(error.advice(), Some(advice::SET_PWM));
    assert!(error.to_string().contains('8'), "{error}");
}

#[test]
fn pwm_frequency_beyond_the_clock_is_refused_and_7i97t_has_own() {
    for hz in [0, 390_620, 4_000_000_000] {
        let settings = Settings {
            pwm_hz: Some(hz),
            ..Settings::default()
        };
        let refused = Driver::start(machines::i7i97(1), settings).err();
        let error = refused.expect("no such frequency");
        assert_eq!(error.advice(), Some(advice::SET_PWM_FREQUENCY));
        assert!(error.to_string().contains("1 to 390619 Hz"), "{error}");
    }
    for (version, hz) in [(0, 48_000), (1, 75_000)] {
        let mut firmware = machines::firmware_7i97(1);
        firmware.clock_high = 160_000_000;
        firmware.module_mut(6).expect("PWM").version = version;
        let driver = Driver::start(SimFpga::new(firmware), Settings::default());
        let driver = driver.expect("a 7I97T");
        let pins = driver.pins();
        let frequency = pins.parameter::<u32>("hm2_7i97.0.pwmgen.pwm_frequency");
        assert_eq!(pins.param(frequency.expect("PWM")), hz);
    }
}
