//! A reset of the board is reported as a reset however long it lasts, also when the bus was given
//! up before the board was back. The truth is the reset of the simulated FPGA.

use crate::common::ethernet::{SimLink, WIRE, connect};
use crate::common::machine::{World, start};
use mesa_hal::UdpBus;
use mesa_hal::driver::{BoardState, Driver, EventKind};
use mesa_hal_sim::{Motor, machines};

const MS: u64 = 1_000_000;

/// Runs cycles of 1 ms; a fault begins with the 100th.
fn run<B: World>(bus: B, begin: impl FnOnce(&mut B)) -> (Driver<B>, Vec<EventKind>) {
    let driver = start(bus, |settings| settings.bus_error_limit = 10);
    let mut driver = driver.expect("the board is complete");
    let mut events = driver.events();
    let mut begin = Some(begin);
    for n in 0..700 {
        if let Some(begin) = begin.take_if(|_| n == 100) {
            begin(driver.bus_mut());
        }
        let _ = driver.read();
        let _ = driver.write();
        let period = driver.period();
        driver.bus_mut().wait(period);
    }
    let told = events.by_ref().map(|event| event.kind);
    let about = |kind: &EventKind| matches!(kind, EventKind::BusDown | EventKind::BoardReset);
    let told = told.filter(about).collect();
    (driver, told)
}

fn check<B: World>((driver, told): (Driver<B>, Vec<EventKind>), is_long: bool, what: &str) {
    let expected = [EventKind::BusDown, EventKind::BoardReset];
    assert_eq!(told, expected[usize::from(!is_long)..], "{what}");
    let counted = driver.statistics();
    let counted = (counted.resets, counted.bus_down);
    assert_eq!(counted, (1, u64::from(is_long)), "{what}");
    assert_eq!(driver.board_state(), BoardState::Reset, "{what}");
}

#[test]
fn a_reset_is_reported_as_a_reset_however_long_it_lasts() {
    for away in [1, 4, 8, 12, 30, 300] {
        for offset in [0, 5_000, 200_000, 500_000, 900_000] {
            let fpga = machines::six_axes_7i97(Motor::default());
            let ended = run(fpga, |fpga| fpga.reset_for(away * MS + offset));
            check(ended, away > 10, &format!("{away} ms and {offset} ns"));
        }
    }
}

#[test]
fn a_reset_of_a_board_on_ethernet_is_reported_as_a_reset_however_long_it_lasts() {
    for away in [1, 30, 300] {
        let bus = connect(SimLink::new(machines::six_axes_7i97(Motor::default())));
        let ended = run(bus, |bus: &mut UdpBus<SimLink>| {
            let link = bus.link();
            let now = link.time();
            link.resets.push((now, away * MS));
        });
        check(ended, away > 10, &format!("{away} ms"));
    }
}

/// A bus that is down while the board keeps its set-up is no reset, whatever its watchdog does.
#[test]
fn a_bus_that_was_down_is_not_reported_as_a_reset() {
    for down in [20, 60, 300] {
        let bus = connect(SimLink::new(machines::six_axes_7i97(Motor::default())));
        let (driver, told) = run(bus, |bus: &mut UdpBus<SimLink>| {
            let link = bus.link();
            let until = link.time() + down * MS;
            link.to_board = Box::new(move |now, _| {
                let delay = (now >= until).then_some(WIRE);
                delay.into_iter().collect()
            });
        });
        assert_eq!(told, [EventKind::BusDown], "{down} ms");
        assert_eq!(driver.statistics().resets, 0);
    }
}
