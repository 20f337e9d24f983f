//! No pin is driven after the end of a driver, however it ends.

use std::time::Duration;

use crate::common::ethernet::{self, WIRE};
use crate::common::machine::start;
use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::discovery::RemoteTable;
use mesa_hal::driver::{Driver, DriverError, GpioConfig, Presence, RemoteConfig, SerialConfig};
use mesa_hal_sim::{Motor, SimFpga, machines};

const PINS: usize = 51;

fn fpga() -> SimFpga {
    machines::six_axes_7i97(Motor::default())
}

fn millis(n: u64) -> Duration {
    Duration::from_millis(n)
}

fn driven(fpga: &SimFpga) -> Vec<usize> {
    let is_driven = |pin: &usize| fpga.driven_level(*pin).is_some();
    (0..PINS).filter(is_driven).collect()
}

/// A GPIO with open drain is driven whatever its direction: FACTS 12.2.
#[test]
fn no_pin_is_driven_after_any_end_of_the_driver() {
    const NONE: RemoteTable = RemoteTable::new("card", *b"NONE", &[]);
    let open_drain = GpioConfig {
        output: true,
        open_drain: true,
        ..GpioConfig::default()
    };
    let mut simulated = fpga();
    {
        let mut driver = start(&mut simulated, |s| {
            s.gpio = vec![(40, open_drain), (41, open_drain)];
        })
        .expect("the board is complete");
        for _ in 0..5 {
            let _ = driver.read().expect("the bus does not fail");
            driver.write().expect("the bus does not fail");
            driver.bus_mut().wait(millis(1));
        }
        assert!(!driven(driver.bus()).is_empty());
    }
    simulated.wait(millis(1));
    assert!(simulated.watchdog().has_bitten());
    assert_eq!(driven(&simulated), []);
    let required = RemoteConfig {
        kind: Some(&NONE),
        presence: Presence::Required,
        ..RemoteConfig::default()
    };
    let missing = SerialConfig {
        channels: [(0, required)].into(),
    };
    let built = start(&mut simulated, |s| {
        s.gpio = vec![(40, open_drain)];
        s.serial_ports = [(0, missing)].into();
    });
    assert!(matches!(built, Err(DriverError::Missing(_))));
    drop(built);
    simulated.wait(millis(1));
    assert_eq!(driven(&simulated), [], "the driver was not built");
}

#[test]
fn no_pin_is_driven_after_shutdown_on_a_lossy_network() {
    let built = Driver::start(ethernet::bus(fpga()), Settings::default());
    let mut driver = built.expect("the board is complete");
    for _ in 0..5 {
        let _ = driver.read().expect("a good network");
        driver.write().expect("a good network");
        driver.bus_mut().wait(millis(1));
    }
    let mut n = 0;
    driver.bus_mut().link().to_board = Box::new(move |_, _| {
        n += 1;
        if n % 3 == 0 { vec![WIRE] } else { vec![] }
    });
    let before = driver.bus_mut().now();
    let (mut bus, _) = driver.shutdown();
    let took = bus.now().since(before);
    bus.wait(millis(1));
    let gateware = bus.link().board.gateware_mut();
    assert!(gateware.watchdog().has_bitten());
    assert_eq!(driven(gateware), []);
    assert!(took < Duration::from_secs(5), "{took:?}");
}
