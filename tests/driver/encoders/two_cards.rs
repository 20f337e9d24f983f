//! Two 7I77 on one board, and settings for encoders that a firmware does not have.

use crate::common::machine::start;
use std::collections::BTreeMap;

use std::time::Duration;

use mesa_hal::Settings;
use mesa_hal::driver::{Driver, DriverError};
use mesa_hal::hal::Pins;
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::RegisterError;
use mesa_hal::modules::encoder::{EncoderPins, Encoders};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::{
    AxisWiring, DriveSource, Motor, MotorConfig, SimFirmware, SimFpga, gtag, machines,
};

fn with_motors(firmware: SimFirmware, cards: usize) -> SimFpga {
    let mut fpga = SimFpga::new(firmware);
    for card in 0..cards {
        machines::plug_7i77(&mut fpga, 0, 3 * card);
    }
    let encoders = fpga.encoders().map_or(0, |bank| bank.encoders());
    for encoder in 0..encoders {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Nothing,
            encoder,
            motor: Motor::new(MotorConfig {
                counts_per_unit: 1.0,
                ..MotorConfig::default()
            })
            .unwrap(),
        });
    }
    fpga
}

fn encoders(driver: &Driver<SimFpga>) -> Vec<EncoderPins> {
    let module = driver.modules::<Encoders>().next().expect("encoders");
    module.pins().collect()
}

/// Turns each motor at a speed of its own; returns the count of each encoder, and of each motor.
fn counted(driver: &mut Driver<SimFpga>, encoders: &[EncoderPins]) -> Vec<(i64, i64)> {
    let _ = driver.read().expect("the bus does not fail");
    driver.write().expect("the bus does not fail");
    for n in 0..encoders.len() {
        let speed = if n % 2 == 0 { 1.0 } else { -1.0 } * 10_000.0 * (n + 1) as f64;
        let motor = driver.bus_mut().motor(n).expect("an axis");
        motor.turn_by_hand(Some(speed));
    }
    for _ in 0..50 {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        mesa_hal::bus::Clock::wait(driver.bus_mut(), Duration::from_millis(1));
    }
    for n in 0..encoders.len() {
        let motor = driver.bus_mut().motor(n).expect("an axis");
        motor.turn_by_hand(Some(0.0));
    }
    mesa_hal::bus::Clock::wait(driver.bus_mut(), Duration::from_millis(1));
    let _ = driver.read().expect("the bus does not fail");
    let each = encoders.iter().enumerate();
    each.map(|(n, encoder)| {
        let count = driver.pins().read(encoder.counter.rawcounts).value;
        let motor = driver.bus_mut().motor(n).expect("an axis");
        (count.into(), motor.counts().floor() as i64)
    })
    .collect()
}

#[test]
fn all_twelve_encoders_of_two_cards_count_their_own_shafts() {
    let fpga = with_motors(machines::firmware_7i92_7i77x2(), 2);
    let mut driver = Driver::start(fpga, Settings::default()).expect("two cards");
    let encoders = encoders(&driver);
    assert_eq!(encoders.len(), 12);
    for (n, (count, truth)) in counted(&mut driver, &encoders).into_iter().enumerate() {
        assert!((count - truth).abs() <= 1, "encoder {n}: {count}, {truth}");
        assert!(truth.abs() > 400, "encoder {n} has turned");
    }
}

fn terminals(pins: &Pins) -> Vec<String> {
    let infos = pins.infos().iter();
    let encoders = infos.filter(|info| info.name.ends_with(".rawcounts"));
    let found: BTreeMap<_, _> = encoders
        .map(|info| (&info.name, info.place.terminal.clone()))
        .collect();
    found.into_values().collect()
}

#[test]
fn each_card_has_its_own_terminals_and_what_is_no_card_has_none() {
    let fpga = with_motors(machines::firmware_7i92_7i77x2(), 2);
    let driver = Driver::start(fpga, Settings::default()).expect("two cards");
    let found = terminals(driver.pins());
    assert_eq!(found.len(), 12);
    for n in 0..6 {
        let block = if n < 3 { "TB3" } else { "TB4" };
        let first = format!("{block} pin {}", 8 * (n % 3) + 1);
        assert!(found[n].starts_with(&first), "{n}: {}", found[n]);
        assert_eq!(found[n], found[n + 6], "the same place on the second card");
    }
    // The same encoders, at the pins of another module.
    let mut firmware = machines::firmware_7i92_7i77();
    firmware.pins.swap(3, 20);
    let fpga = with_motors(firmware, 0);
    let driver = Driver::start(fpga, Settings::default()).expect("encoders");
    assert!(terminals(driver.pins()).iter().all(String::is_empty));
}

#[test]
fn more_encoders_than_there_are_is_refused_and_fewer_are_used() {
    let build = |count| {
        let fpga = with_motors(machines::firmware_7i92_7i77(), 1);
        start(fpga, |s| s.instances = [(Gtag::ENCODER, count)].into())
    };
    let error = build(7).map(drop).expect_err("there are six");
    assert!(matches!(
        error,
        DriverError::Register(RegisterError::Setting { .. })
    ));
    let text = error.to_string();
    assert!(text.contains("encoder 7, expected at most 6"), "{text}");
    assert_eq!(error.advice(), Some(advice::SET_INSTANCES));
    let driver = build(3).expect("three of six");
    assert_eq!(encoders(&driver).len(), 3);
}

#[test]
fn multiplexed_encoders_with_a_probe_are_known_and_latch_on_it() {
    for version in [0x83, 0x84] {
        let mut firmware = machines::firmware_7i97(1);
        let module = firmware.module_mut(gtag::MUXED_ENCODER).expect("encoders");
        module.version = version;
        let mut driver = Driver::start(with_motors(firmware, 0), Settings::default())
            .unwrap_or_else(|error| panic!("version {version:#x}: {error}"));
        let encoders = encoders(&driver);
        let bank = driver.modules::<Encoders>().next().expect("encoders");
        assert_eq!(bank.muxed_skew().is_some(), version == 0x84);
        let pins = driver.pins_mut();
        pins.set(encoders[0].probe_invert, true);
        pins.set(encoders[0].probe_enable, true);
        driver
            .bus_mut()
            .encoders()
            .expect("a bank")
            .set_probe(false);
        let _ = counted(&mut driver, &encoders);
        let latched = |driver: &Driver<SimFpga>| {
            let pins = driver.pins();
            (
                pins.read(encoders[0].count_latched).value,
                pins.rejections(encoders[0].probe_enable).out_of_range,
            )
        };
        assert_eq!(latched(&driver), (0, 0), "not yet");
        driver.bus_mut().encoders().expect("a bank").set_probe(true);
        let _ = driver.read().expect("the bus does not fail");
        let truth = driver.bus_mut().motor(0).expect("an axis").counts().floor() as i32;
        assert!((latched(&driver).0 - truth).abs() <= 1, "{truth}");
    }
}
