//! The pins of a serial channel on which nothing answers are plain I/O, with the settings of
//! LinuxCNC.

use std::time::Duration;

use mesa_eth::Config;
use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{Driver, RemoteState, SerialPort};
use mesa_hal_sim::{SimFpga, gtag, machines};

/// Pins of RX and TX of a channel, and of TXEN where it has one.
fn pins_of(channel: u8) -> Vec<usize> {
    let firmware = machines::firmware_7i92_7i77();
    let pins = [0x01, 0x81, 0x91].map(|pin| firmware.pin(gtag::SSERIAL, 0, pin + channel));
    pins.into_iter().flatten().collect()
}

/// A 7I92 with a 7I72 on channel 2 alone, which has TXEN.
fn with_a_7i72(settings: Settings) -> Driver<SimFpga> {
    let mut fpga = machines::i7i92_7i77();
    machines::plug_7i72(&mut fpga, 0, 2);
    Driver::start(fpga, settings).expect("a 7I92")
}

fn cycles(driver: &mut Driver<SimFpga>, count: u32) {
    for _ in 0..count {
        let _ = driver.read().expect("the board is there");
        driver.write().expect("the board is there");
        driver.bus_mut().wait(Duration::from_millis(1));
    }
}

fn is_free(driver: &Driver<SimFpga>, pin: usize) -> bool {
    let name = format!("hm2_7i92.0.gpio.{pin:03}.out");
    driver.pins().output::<bool>(&name).is_ok()
}

fn set(driver: &mut Driver<SimFpga>, pin: usize, out: bool) {
    let name = |end: &str| format!("hm2_7i92.0.gpio.{pin:03}.{end}");
    let pins = driver.pins_mut();
    let is_output = pins.parameter::<bool>(&name("is_output")).expect("free");
    let output = pins.output::<bool>(&name("out")).expect("free");
    pins.set_param(is_output, true).expect("a flag");
    pins.set(output, out);
}

fn runs(driver: &Driver<SimFpga>) -> bool {
    let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
    let states: Vec<RemoteState> = remotes.map(|remote| remote.state).collect();
    states == [RemoteState::Running]
}

#[test]
fn pins_of_channels_without_an_answer_are_plain_io() {
    let settings = Config::parse("sserial_port_0=00000000")
        .expect("a word")
        .settings;
    let mut driver = with_a_7i72(settings);
    let aliases: Vec<_> = driver.pins().aliases().collect();
    let has_alias = |alias: &str| aliases.iter().any(|(name, _)| name.contains(alias));
    assert!(has_alias(".sserial.00.tx2.") && has_alias(".sserial.00.txen2."));
    assert!(!has_alias(".tx0.") && !has_alias(".txen1."));
    for channel in [0, 1] {
        for pin in pins_of(channel) {
            assert!(is_free(&driver, pin), "pin {pin}");
            assert!(!driver.bus_mut().is_driven(pin), "an input at first");
        }
    }
    assert_eq!([0, 1, 2].map(|channel| pins_of(channel).len()), [2, 2, 3]);
    assert!(pins_of(2).iter().all(|pin| !is_free(&driver, *pin)));
    cycles(&mut driver, 20);
    assert!(runs(&driver), "the card beside them");
    for level in [true, false, true] {
        for pin in pins_of(0) {
            set(&mut driver, pin, level);
        }
        cycles(&mut driver, 3);
        for pin in pins_of(0) {
            assert_eq!(driver.bus_mut().driven_level(pin), Some(level), "pin {pin}");
        }
    }
    assert!(runs(&driver), "the card beside them");
}

#[test]
fn pins_that_were_given_back_stay_so_after_a_reset() {
    let mut driver = with_a_7i72(Config::parse("").expect("no word").settings);
    let tx = pins_of(0)[1];
    cycles(&mut driver, 20);
    set(&mut driver, tx, true);
    cycles(&mut driver, 3);
    driver.bus_mut().reload();
    for _ in 0..3_000 {
        let _ = driver.rearm();
        let _ = driver.read();
        let _ = driver.write();
        driver.bus_mut().wait(Duration::from_millis(1));
    }
    assert!(runs(&driver), "the card is back");
    // Arming has made the driver forget what was set before.
    set(&mut driver, tx, true);
    cycles(&mut driver, 3);
    assert_eq!(driver.bus_mut().driven_level(tx), Some(true));
    for pin in pins_of(1) {
        assert!(!driver.bus_mut().is_driven(pin), "pin {pin}");
    }
}

/// An application may wait for a card that is plugged in later.
#[test]
fn channels_keep_their_pins_with_the_settings_of_an_application() {
    let driver = with_a_7i72(Settings::default());
    for channel in 0..3 {
        assert!(pins_of(channel).iter().all(|pin| !is_free(&driver, *pin)));
    }
}
