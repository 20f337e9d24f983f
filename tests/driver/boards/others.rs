//! Boards other than the usual two: a 7I97 with a 7I77 on P1, older firmware of a 7I80, a 7I97T, a
//! 5I25 with old serial firmware, and 7I84 and 7I76 on a serial port.

use std::time::Duration;

use crate::common::machine::start;
use mesa_hal::RemoteId;
use mesa_hal::boards::{AttachError, I7i76, I7i77, I7i97};
use mesa_hal::driver::RemarkKind;
use mesa_hal::hal::{AnalogOut, Counter, Pins};
use mesa_hal::modules::encoder::Encoders;
use mesa_hal::{Clock, Driver, Settings};
use mesa_hal_sim::devices::{FieldIo, SignalValue, find, find_mut};
use mesa_hal_sim::wire::RemoteEnd;
use mesa_hal_sim::{Motor, SimFpga, gtag, machines};

fn started(fpga: SimFpga) -> Driver<SimFpga> {
    Driver::start(fpga, Settings::default()).expect("the machine is complete")
}

fn cycles(driver: &mut Driver<SimFpga>, count: usize) {
    for _ in 0..count {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(Duration::from_millis(1));
    }
}

/// Volts that differ from axis to axis, of both signs.
fn volts(axis: usize) -> f64 {
    let size = 1.0 + 0.25 * axis as f64;
    if axis.is_multiple_of(2) { size } else { -size }
}

/// Enables every axis, sets its volts for 0.2 s, and checks every motor and every encoder.
fn move_all(driver: &mut Driver<SimFpga>, axes: &[(AnalogOut, Counter)]) {
    cycles(driver, 3);
    for (axis, (output, _)) in axes.iter().enumerate() {
        output.enable(driver.pins_mut(), true);
        output.set(driver.pins_mut(), volts(axis));
    }
    cycles(driver, 200);
    for (axis, (output, _)) in axes.iter().enumerate() {
        let signal = driver.bus_mut().drive_signal(axis).expect("a drive");
        assert!(signal.enabled, "axis {axis}");
        let error = (signal.volts - volts(axis)).abs();
        assert!(error < 0.01, "axis {axis}: {} V", signal.volts);
        output.set(driver.pins_mut(), 0.0);
    }
    cycles(driver, 100);
    let _ = driver.read().expect("the bus does not fail");
    for (axis, (_, encoder)) in axes.iter().enumerate() {
        let motor = driver.bus_mut().motor(axis).expect("an axis");
        let truth = motor.counts();
        // 10 units/s per volt, 1000 counts per unit, for 0.2 s and the time that accesses take.
        let expected = volts(axis) * 2000.0;
        assert!(
            (truth / expected - 1.0).abs() < 0.05,
            "axis {axis}: {truth}"
        );
        let count = driver.pins().read(encoder.rawcounts);
        assert!(count.valid, "axis {axis}");
        let error = (f64::from(count.value) - truth).abs();
        assert!(error <= 2.0, "axis {axis}: {} of {truth}", count.value);
    }
}

fn terminal(pins: &Pins, encoder: &Counter) -> (String, String) {
    let info = pins.info(encoder.rawcounts).expect("a pin");
    (info.name.clone(), info.place.terminal.clone())
}

/// Encoders 6 to 11 are on the card, whose channels follow the board's own.
#[test]
fn all_twelve_axes_of_a_7i97_with_a_7i77_move() {
    let mut driver = started(machines::twelve_axes_7i97(|_| Motor::default()));
    assert_eq!(driver.firmware().warnings, [""; 0]);
    let board: I7i97 = driver.attach_board().expect("a 7I97");
    let card: I7i77 = driver.attach_card((0, 1)).expect("a 7I77");
    let on_board = board.analog_out.into_iter().zip(board.encoders);
    let on_card = card.analog.analog_out.into_iter().zip(card.encoders);
    let axes: Vec<_> = on_board.chain(on_card).collect();
    let pins = driver.pins();
    for (n, (_, encoder)) in axes.iter().enumerate() {
        let (name, terminals) = terminal(pins, encoder);
        assert_eq!(name, format!("hm2_7i97.0.encoder.{n:02}.rawcounts"));
        let block = ["TB1", "TB2", "7I77 TB3", "7I77 TB4"][n / 3];
        let first = format!("{block} pin {}, ", 8 * (n % 3) + 1);
        assert!(terminals.starts_with(&first), "{n}: {terminals}");
    }
    move_all(&mut driver, &axes);
}

#[test]
fn each_card_on_a_7i92_has_its_own_encoders() {
    let mut fpga = SimFpga::new(machines::firmware_7i92_7i77x2());
    for first in [0, 3] {
        machines::plug_7i77(&mut fpga, 0, first);
        let encoders = 2 * first;
        machines::wire_7i77(&mut fpga, 0, first + machines::ANALOG, encoders, |_| {
            Motor::default()
        });
    }
    let mut driver = started(fpga);
    let cards = [0, 3].map(|first| driver.attach_card::<I7i77>((0, first)).expect("a 7I77"));
    let axes = cards.map(|card| card.analog.analog_out.into_iter().zip(card.encoders));
    let axes: Vec<_> = axes.into_iter().flatten().collect();
    assert_eq!(
        terminal(driver.pins(), &axes[6].1).0,
        "hm2_7i92.0.encoder.06.rawcounts"
    );
    move_all(&mut driver, &axes);
    // Channel 1 belongs to a card, but is not its first.
    for (port, channel) in [(0, 1), (1, 0), (0, 6)] {
        let error = driver
            .attach_card::<I7i77>((port, channel))
            .expect_err("no card");
        assert!(matches!(error, AttachError::NoConnector { .. }), "{error}");
        let text = error.to_string();
        assert!(
            text.contains("not the first channel of a connector with the pins of a 7I77"),
            "{text}"
        );
    }
}

/// A board without the card's pins, and a card of which a part is missing.
#[test]
fn card_that_is_not_there_is_no_card() {
    let driver = started(machines::six_axes_7i97(Motor::default()));
    let error = driver
        .attach_card::<I7i77>((0, 0))
        .expect_err("remotes alone");
    assert!(matches!(error, AttachError::NoConnector { .. }), "{error}");
    let mut fpga = machines::i7i92_with_cards();
    let _ = fpga.plug(0, machines::ANALOG, None);
    let driver = started(fpga);
    let error = driver
        .attach_card::<I7i77>((0, 0))
        .expect_err("no analog part");
    assert!(
        matches!(
            error,
            AttachError::NoRemote {
                remote: RemoteId { channel: 1, .. },
                ..
            }
        ),
        "{error}"
    );
}

/// Muxed encoders of version 3 at 3500, PWM at 4000, serial ports at 5A00.
#[test]
fn firmware_of_2016_is_driven_at_its_descriptor_addresses() {
    let mut driver = started(machines::six_axes_7i80_of_2016(Motor::default()));
    assert_eq!(driver.firmware().warnings, [""; 0]);
    let card: I7i77 = driver.attach_card((0, 0)).expect("a 7I77");
    let axes = card.analog.analog_out.into_iter().zip(card.encoders);
    move_all(&mut driver, &axes.collect::<Vec<_>>());
    let pwm = |name: &str| format!("hm2_7i80.0.pwmgen.00.{name}");
    let value = driver.pins().output(&pwm("value")).expect("a pin");
    let enable = driver.pins().output(&pwm("enable")).expect("a pin");
    driver.pins_mut().set(value, 0.5);
    driver.pins_mut().set(enable, true);
    cycles(&mut driver, 2);
    let counters = driver.bus_mut().counters();
    assert_eq!(counters.unknown_writes, 0, "every write has met a register");
    let enables = driver.bus_mut().read_register(0x4400);
    assert_eq!(enables & 1, 1, "the enable register of PWM");
}

/// 160 MHz and dither: 75 kHz keep 11 bits. FACTS 9.6.
#[test]
fn a_7i97t_is_a_7i97_with_another_clock() {
    let mut fpga = machines::i7i97t(1);
    machines::wire_7i97(&mut fpga, |_| Motor::default());
    let mut driver = started(fpga);
    assert_eq!(driver.firmware().warnings, [""; 0]);
    assert!(driver.firmware().idrom.is_7i97t());
    let hz = driver
        .pins()
        .parameter::<u32>("hm2_7i97.0.pwmgen.pwm_frequency");
    let hz = hz.map(|hz| driver.pins().param(hz));
    assert_eq!(hz.ok(), Some(75_000));
    let board: I7i97 = driver.attach_board().expect("a 7I97");
    let axes: Vec<_> = board.analog_out.into_iter().zip(board.encoders).collect();
    move_all(&mut driver, &axes);
    let usual = started(machines::i7i97(1));
    assert!(!usual.firmware().idrom.is_7i97t());
}

/// A port of six channels takes 270 us for a STOPALL at 33 MHz, and wipes its registers after that.
#[test]
fn all_twelve_axes_of_a_5i25_with_two_7i77_have_their_encoders() {
    let mut fpga = machines::i5i25_7i77x2();
    for first in [0, 3] {
        machines::plug_7i77(&mut fpga, 0, first);
    }
    let mut driver = started(fpga);
    assert_eq!(driver.name(), "hm2_5i25.0");
    cycles(&mut driver, 10);
    for first in [0, 3] {
        let card: I7i77 = driver.attach_card((0, first)).expect("a 7I77");
        let names = card
            .encoders
            .iter()
            .map(|encoder| terminal(driver.pins(), encoder).0);
        let numbers = (0..6).map(|n| format!("hm2_5i25.0.encoder.{:02}.rawcounts", 2 * first + n));
        assert!(names.eq(numbers), "channel {first}");
        let input = format!("hm2_5i25.0.7i77.0.{first}.input-03");
        let input = driver.pins().input::<bool>(&input).expect("an input");
        assert!(driver.pins().read(input).valid, "channel {first}");
    }
}

/// A 5I25 of 2012 printed SSLBP 1.38: FACTS 2.3.
#[test]
fn old_serial_firmware_is_reported_in_a_remark() {
    for (minor, is_old) in [(38, true), (43, false)] {
        let mut firmware = machines::firmware_5i25_7i77();
        firmware.sslbp_minor = minor;
        let mut fpga = SimFpga::new(firmware);
        machines::plug_7i77(&mut fpga, 0, 0);
        let driver = started(fpga);
        let kind = RemarkKind::OldSslbp { major: 1, minor };
        let mut remarks = driver.remarks().iter();
        assert_eq!(remarks.any(|remark| remark.kind == kind), is_old);
        let said = driver.remarks().iter().map(ToString::to_string);
        let said: Vec<_> = said.filter(|text| text.contains("SSLBP 1.38")).collect();
        assert_eq!(said.len(), usize::from(is_old), "{said:?}");
    }
}

type Plug = fn() -> Box<dyn RemoteEnd>;

/// Modes, pins and unit numbers: FACTS 8.7.
#[test]
fn relatives_of_the_7i77_have_the_pins_of_their_modes() {
    let i7i84: Plug = || Box::new(FieldIo::i7i84().expect("7I84"));
    let i7i76: Plug = || Box::new(FieldIo::i7i76().expect("7I76"));
    let i7i76e: Plug = || Box::new(FieldIo::i7i76e().expect("7I76E"));
    let spindle = ["spinout", "spinena", "spindir"];
    for (plug, card, modes, own, class) in [
        (
            i7i84,
            "7i84",
            [
                "",
                "analogin3 fieldvoltage",
                "analogin0 enc0.count enc1.count",
            ],
            &[][..],
            0x84,
        ),
        (
            i7i76,
            "7i76",
            [
                "",
                "analogin3",
                "analogin0 fieldvoltage enc0.count enc1.count",
            ],
            &spindle[..],
            0x10,
        ),
        (
            i7i76e,
            "7i76",
            ["", "analogin3", "analogin0 fieldvoltage enc0.count"],
            &spindle[..],
            0x1A,
        ),
    ] {
        for (mode, names) in modes.iter().enumerate() {
            let mut fpga = SimFpga::new(machines::firmware_serial(&[1]));
            fpga.plug(0, 0, Some(plug()));
            let config = format!("{mode}xxxxxxx").parse().expect("modes");
            let mut driver = start(fpga, |s| s.serial_ports = [(0, config)].into()).expect(card);
            assert!(driver.remarks().is_empty(), "{:?}", driver.remarks());
            let remote = driver.remote((0, 0)).expect("a remote").descriptor;
            assert_eq!(remote.unit_number >> 24, class);
            let full = |name: &str| format!("hm2_7i80.0.{card}.0.0.{name}");
            for name in names.split_whitespace().chain(own.iter().copied()) {
                assert!(driver.pins().has(&full(name)), "{}", full(name));
            }
            assert_eq!(driver.pins().has(&full("enc0.count")), mode == 2);
            let output = driver
                .pins()
                .output::<bool>(&full("output-15"))
                .expect("a pin");
            let input = driver
                .pins()
                .input::<bool>(&full("input-31"))
                .expect("a pin");
            cycles(&mut driver, 3);
            driver.pins_mut().set(output, true);
            let end = driver.bus_mut().remote_mut(0, 0).expect("a remote");
            let device = find_mut(end).expect("a device");
            device.set_input(31, true).expect("32 inputs");
            assert!(device.set_input(32, true).is_err());
            cycles(&mut driver, 3);
            assert!(driver.pins().read(input).value);
            let end = driver.bus().remote(0, 0).expect("a remote");
            let outputs = find(end).expect("a device").outputs();
            let on: Vec<_> = outputs
                .iter()
                .filter(|(_, on)| *on == SignalValue::Bool(true))
                .collect();
            assert_eq!(on, [&("output-15".to_owned(), SignalValue::Bool(true))]);
        }
    }
}

#[test]
fn spindle_of_a_7i76_has_its_voltage_while_it_is_enabled() {
    let mut fpga = SimFpga::new(machines::firmware_serial(&[1]));
    fpga.plug(0, 0, Some(Box::new(FieldIo::i7i76().expect("7I76"))));
    let mut driver = started(fpga);
    let I7i76 { spindle, .. } = driver.attach((0, 0)).expect("a 7I76");
    let name = driver
        .pins()
        .info(spindle.volts)
        .expect("a pin")
        .name
        .clone();
    assert_eq!(name, "hm2_7i80.0.7i76.0.0.spinout");
    cycles(&mut driver, 3);
    // A share of the 10 V at its potentiometer's terminals.
    spindle.set(driver.pins_mut(), 40.0);
    let volts = |driver: &Driver<SimFpga>| {
        let end = driver.bus().remote(0, 0).expect("a remote");
        let outputs = find(end).expect("a device").outputs();
        let found = outputs.iter().find(|(name, _)| name == "spinout");
        match found.expect("a spindle").1 {
            SignalValue::Volts(volts) => volts,
            other => panic!("no voltage: {other:?}"),
        }
    };
    cycles(&mut driver, 3);
    assert_eq!(volts(&driver), 0.0);
    spindle.enable(driver.pins_mut(), true);
    cycles(&mut driver, 3);
    assert!((volts(&driver) - 4.0).abs() < 0.01, "{}", volts(&driver));
    driver.bus_mut().wait(Duration::from_millis(100));
    assert_eq!(volts(&driver), 0.0, "its watchdog has bitten");
}

#[test]
fn handles_of_a_7i76_are_those_of_a_7i76e_and_of_no_7i84() {
    let mut fpga = SimFpga::new(machines::firmware_serial(&[2]));
    fpga.plug(0, 0, Some(Box::new(FieldIo::i7i76e().expect("7I76E"))));
    fpga.plug(0, 1, Some(Box::new(FieldIo::i7i84().expect("7I84"))));
    let mut driver = started(fpga);
    let card: I7i76 = driver.attach((0, 0)).expect("a 7I76E");
    assert!(card.field_voltage.is_none(), "mode 0 does not transfer it");
    driver.pins_mut().set(card.outputs[15].pin, true);
    driver.pins_mut().set(card.spindir.pin, true);
    cycles(&mut driver, 5);
    let end = driver.bus().remote(0, 0).expect("a remote");
    let outputs = find(end).expect("a device").outputs();
    let is_on = |wanted: &str| {
        let found = outputs.iter().find(|(name, _)| name == wanted);
        found.map(|(_, value)| *value) == Some(SignalValue::Bool(true))
    };
    assert!(is_on("output-15") && is_on("spindir"), "{outputs:?}");
    let other = driver.attach::<I7i76>((0, 1));
    assert!(
        matches!(other, Err(AttachError::Identity { .. })),
        "{other:?}"
    );
}

/// The stock firmware of a 7I92 lists PWM with 0 instances: nothing to drive.
#[test]
fn descriptor_without_instances_is_no_module() {
    let fpga = machines::i7i92_with_cards();
    let listed = &fpga.firmware().modules;
    assert!(
        listed
            .iter()
            .any(|module| (module.gtag, module.instances) == (gtag::PWM, 0))
    );
    let driver = started(fpga);
    assert_eq!(driver.firmware().warnings, [""; 0]);
    assert_eq!(driver.modules::<Encoders>().count(), 1);
    let names = driver.pins().infos().iter().map(|info| info.name.as_str());
    assert_eq!(
        names.clone().filter(|name| name.contains("pwmgen")).count(),
        0
    );
    assert!(
        names
            .clone()
            .any(|name| name == "hm2_7i92.0.dpll.01.timer-us")
    );
}
