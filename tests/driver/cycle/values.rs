//! The cycle on the simulated machine: values arrive at their places, and the planned exchanges are
//! the actual ones.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, start};

#[test]
fn inputs_and_outputs_of_three_remotes_reach_their_terminals() {
    let mut machine = Machine::new();
    assert!(
        machine.driver.missing().is_empty(),
        "{:?}",
        machine.driver.missing()
    );
    machine.cycles(3);
    for input in 0..32 {
        machine
            .device_mut(FIELD)
            .set_input(input, input % 3 == 0)
            .unwrap();
    }
    let (field, analog, outputs) = (
        machine.cards.field,
        machine.cards.analog,
        machine.cards.outputs,
    );
    let pins = machine.driver.pins_mut();
    for (n, output) in field.outputs.iter().enumerate() {
        pins.set(output.pin, n % 2 == 0);
    }
    for (n, output) in analog.analog_out.iter().enumerate() {
        pins.set(output.volts, n as f64 - 2.5);
    }
    pins.set(analog.analogena.pin, true);
    pins.set(analog.spinena.pin, true);
    for (n, output) in outputs.outputs.iter().enumerate() {
        pins.set(output.pin, n % 5 == 0);
    }
    machine.cycles(2);
    let report = machine.cycle();
    assert!(report.is_good(), "{report:?}");
    assert_eq!(report.good, 3);
    for n in 0..16 {
        assert_eq!(
            machine.device(FIELD).world().output(n),
            Some(n % 2 == 0),
            "output {n}"
        );
    }
    for n in 0..6 {
        let volts = machine.device(ANALOG).world().analog_output(n).unwrap();
        assert!(
            (volts - (n as f64 - 2.5)).abs() < 0.003,
            "output {n}: {volts}"
        );
    }
    for n in 0..48 {
        assert_eq!(
            machine.device(OUTPUTS).world().output(n),
            Some(n % 5 == 0),
            "output {n}"
        );
    }
    let pins = machine.driver.pins();
    for (n, input) in field.inputs.iter().enumerate() {
        let reading = pins.read(input.pin);
        assert!(reading.valid && reading.age.cycles == 0);
        assert_eq!(reading.value, n % 3 == 0, "input {n}");
        assert_eq!(pins.read(input.not).value, n % 3 != 0, "input {n}-not");
    }
}

/// Manual: 7I77, "NORMAL MODE OPERATION", last paragraph: the reply to a write is available as soon
/// as COMMAND is clear.
#[test]
fn read_modify_write_sees_the_reply_to_its_own_write() {
    let mut machine = Machine::new();
    machine.cycles(3);
    // A write starts a transfer only when a read has seen the end of the previous one.
    let _ = machine.driver.read().unwrap();
    for n in 0..50 {
        let on = n % 2 == 0;
        machine.device_mut(FIELD).set_input(4, on).unwrap();
        machine.driver.write().unwrap();
        let limit = std::time::Duration::from_micros(300);
        assert!(machine.driver.wait_transfers(limit).unwrap());
        let report = machine.driver.read().unwrap();
        assert_eq!((report.good, report.too_short), (3, 0));
        let input = machine.field_input(4);
        assert_eq!((input.value, input.valid, input.age.cycles), (on, true, 0));
    }
    let port = &machine.driver.ports()[0];
    let (doit, expected) = (&port.statistics().doit, port.expected_time);
    assert!(doit.count() >= 50);
    let median = doit.percentile(50).unwrap();
    assert!(
        median > expected.usual / 2 && median <= expected.usual,
        "{median:?} {expected:?}"
    );
}

#[test]
fn wait_for_transfers_ends_at_its_limit() {
    let mut machine = Machine::new();
    machine.cycles(3);
    let _ = machine.driver.read().unwrap();
    machine.driver.write().unwrap();
    let before = machine.now();
    let limit = std::time::Duration::from_micros(20);
    assert!(!machine.driver.wait_transfers(limit).unwrap());
    assert!(machine.now() - before < 25_000);
}

#[test]
fn serial_ports_and_channels_that_do_not_exist_are_refused() {
    use mesa_hal::RemoteId;
    use mesa_hal::driver::{DriverError, RemoteConfig, SerialConfig};
    use mesa_hal_sim::machines;

    let build = |port, config| {
        start(machines::i7i92_7i77(), |s| {
            s.serial_ports = [(port, config)].into();
        })
    };
    for port in [1, 3, 4, 200, 255] {
        let error = build(port, SerialConfig::default()).expect_err("there is one port");
        let is_it =
            matches!(error, DriverError::NoSuchPort { port: found, ports: 1 } if found == port);
        assert!(is_it, "port {port}: {error}");
    }
    for channel in [8, 100, 255] {
        let config = SerialConfig {
            channels: [(channel, RemoteConfig::default())].into(),
        };
        let error = build(0, config).expect_err("channels are 0 to 7");
        let is_it = matches!(error, DriverError::Missing(ref missing) if missing.remote == Some(RemoteId::new(0, channel).into()));
        assert!(is_it, "channel {channel}: {error}");
    }
}

#[test]
fn firmware_with_more_than_four_serial_ports_runs_four() {
    use mesa_hal::driver::{Driver, DriverError, SerialConfig, Settings};
    use mesa_hal_sim::{SimFpga, gtag, machines};

    let build = |settings| {
        let mut firmware = machines::firmware_serial(&[1; 4]);
        let mut modules = firmware.modules.iter_mut();
        let serial = modules.find(|module| module.gtag == gtag::SSERIAL);
        serial.expect("serial ports").instances = 5;
        Driver::start(SimFpga::new(firmware), settings)
    };
    let driver = build(Settings::default()).expect("four ports");
    assert_eq!(driver.ports().len(), 4);
    let fifth = Settings {
        serial_ports: [(4, SerialConfig::default())].into(),
        ..Settings::default()
    };
    let error = build(fifth).expect_err("it is not used");
    assert!(
        matches!(error, DriverError::NoSuchPort { port: 4, ports: 4 }),
        "{error}"
    );
}
