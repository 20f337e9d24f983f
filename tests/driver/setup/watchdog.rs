//! The watchdogs' times and the period are consistent, and the board's watchdog bites only on
//! silence.

use std::time::Duration;

use crate::common::ethernet::{self, cut, good};
use crate::common::machine::start;
use crate::common::watch::Watch;
use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver, DriverError};
use mesa_hal::hostmot2::Gtag;
use mesa_hal_sim::{Motor, SimFpga, machines};

const PINS: usize = 51;

fn fpga() -> SimFpga {
    machines::six_axes_7i97(Motor::default())
}

fn millis(n: u64) -> Duration {
    Duration::from_millis(n)
}

#[test]
fn board_watchdog_too_short_for_period_is_refused_with_numbers() {
    let result = start(fpga(), |s| s.watchdog = Some(Duration::from_micros(1_900)));
    let Err(error @ DriverError::WatchdogTooShort { needed, .. }) = result else {
        panic!("built");
    };
    assert_eq!(needed, millis(2));
    let text = error.to_string();
    assert!(
        text.contains("1.9 ms") && text.contains("2 x 1 ms = 2 ms"),
        "{text}"
    );
    assert!(start(fpga(), |s| s.watchdog = Some(millis(2))).is_ok());
}

#[test]
fn remote_watchdog_too_short_for_period_is_refused_with_numbers() {
    let built = |period| {
        start(fpga(), |s| {
            s.instances = [(Gtag::HM2DPLL, 0)].into();
            s.period = millis(period);
        })
    };
    let Err(error @ DriverError::WatchdogTooShort { watchdog, .. }) = built(26) else {
        panic!("built");
    };
    assert_eq!(watchdog, millis(50));
    let text = error.to_string();
    assert!(
        text.contains("NVWatchDogTimeout") && text.contains("2 x 26 ms = 52 ms"),
        "{text}"
    );
    assert!(built(25).is_ok());
}

#[test]
fn no_period_panics_and_what_can_not_be_kept_is_refused() {
    for period in [
        Duration::ZERO,
        Duration::MAX,
        Duration::from_secs(1),
        Duration::from_nanos(1),
    ] {
        let result = start(fpga(), |s| s.period = period);
        assert!(
            matches!(result, Err(DriverError::BadPeriod { .. })),
            "{period:?}"
        );
    }
}

#[test]
fn watchdog_and_deadline_follow_the_period() {
    for (period, watchdog, deadline) in [
        (250, 5_000, 200),
        (1_000, 5_000, 800),
        (4_000, 20_000, 3_200),
    ] {
        let built = start(ethernet::bus(fpga()), |s| {
            s.period = Duration::from_micros(period);
        });
        let mut driver = built.expect("the board is complete");
        for _ in 0..3 {
            let _ = driver.read().expect("a good network");
            driver.write().expect("a good network");
            driver.bus_mut().wait(Duration::from_micros(period));
        }
        let pins = driver.pins();
        let time = pins
            .parameter("hm2_7i97.0.watchdog.timeout_ns")
            .expect("a parameter");
        assert_eq!(pins.param::<u32>(time), watchdog * 1000, "{period} us");
        let time = driver
            .bus_mut()
            .link()
            .board
            .gateware_mut()
            .read_register(0x0C00);
        assert!(
            time < watchdog * 100 && time > watchdog * 50,
            "{period} us: {time}"
        );
        driver.bus_mut().link().to_board = cut();
        let before = driver.bus_mut().now();
        driver.read().expect_err("nothing comes");
        let waited = driver.bus_mut().now().since(before);
        assert_eq!(waited.as_micros(), deadline, "{period} us");
        driver.bus_mut().link().to_board = good();
    }
}

/// Another program has left the board in the worst state.
#[test]
fn board_left_running_and_driven_is_set_up_without_a_bite() {
    let mut fpga = machines::i7i97(1);
    machines::wire_7i97(&mut fpga, |_| Motor::default());
    fpga.write_register(0x0C00, 4_000_000);
    for port in 0..3 {
        fpga.write_register(0x1000 + 4 * port, 0x1_FFFF);
        fpga.write_register(0x1300 + 4 * port, 0x1_FFFF);
        fpga.write_register(0x1400 + 4 * port, 0x1_0000);
        fpga.write_register(0x1100 + 4 * port, 0x1_FFFF);
    }
    fpga.write_register(0x0D00, 1);
    let watch = Watch::now(&mut fpga);
    let mut driver = Driver::start(fpga, Settings::default()).expect("the board is complete");
    for n in 0..50 {
        let report = driver.read().expect("the bus does not fail");
        assert_eq!(report.board, BoardState::Running, "cycle {n}");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(millis(1));
        assert!(!driver.bus().watchdog().has_bitten(), "cycle {n}");
    }
    assert_eq!(watch.seen().switched_on, [""; 0]);
    assert_eq!(
        driver.bus_mut().read_register(0x1108),
        0,
        "no GPIO is an output"
    );
    assert!((34..PINS).all(|pin| driver.bus().driven_level(pin).is_none()));
}

#[test]
fn bite_right_after_rearming_is_seen() {
    let mut driver = Driver::start(fpga(), Settings::default()).expect("the board is complete");
    for silence in [1, 2, 4, 6] {
        for _ in 0..5 {
            let _ = driver.rearm().expect("the bus does not fail");
            let _ = driver.read().expect("the bus does not fail");
            driver.write().expect("the bus does not fail");
            driver.bus_mut().wait(millis(1));
        }
        assert_eq!(driver.board_state(), BoardState::Running);
        driver.bus_mut().wait(millis(20));
        let _ = driver.read().expect("the bus does not fail");
        assert_eq!(driver.board_state(), BoardState::WatchdogBitten);
        let _ = driver.rearm().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(millis(silence));
        let has_bitten = driver.bus().watchdog().has_bitten();
        assert_eq!(has_bitten, silence > 4, "after {silence} ms");
        let report = driver.read().expect("the bus does not fail");
        let expected = if has_bitten {
            BoardState::WatchdogBitten
        } else {
            BoardState::Running
        };
        assert_eq!(report.board, expected, "after {silence} ms");
    }
}
