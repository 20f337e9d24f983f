//! A reset of the board is reported as a reset however long it lasts, also when the bus was given
//! up before the board was back. The truth is the reset of the simulated FPGA.

use std::time::Duration;

use crate::common::ethernet::{SimLink, WIRE, connect};
use crate::common::machine::{World, start};
use mesa_hal::UdpBus;
use mesa_hal::driver::{BoardState, Driver, EventKind, Events};
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
fn reset_is_reported_as_a_reset_however_long_it_lasts() {
    for away in [1, 4, 8, 12, 30, 300] {
        for offset in [0, 5_000, 200_000, 500_000, 900_000] {
            let fpga = machines::six_axes_7i97(Motor::default());
            let ended = run(fpga, |fpga| fpga.reset_for(away * MS + offset));
            check(ended, away > 10, &format!("{away} ms and {offset} ns"));
        }
    }
}

#[test]
fn ethernet_board_reset_is_reported_as_a_reset_at_any_length() {
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
fn bus_that_was_down_is_not_reported_as_a_reset() {
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

/// A board in cycles of 5 ms, which is set up again at once after any fault, and its losses.
struct Kept<B: World> {
    driver: Driver<B>,
    events: Events,
}

impl<B: World> Kept<B> {
    fn start(bus: B, watchdog: u64) -> Self {
        let driver = start(bus, |settings| {
            settings.period = Duration::from_millis(5);
            settings.watchdog = Some(Duration::from_millis(watchdog));
        });
        let driver = driver.expect("the board is complete");
        let events = driver.events();
        let mut kept = Self { driver, events };
        kept.run(20);
        kept
    }

    fn run(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.cycle(0);
        }
    }

    /// A cycle in which the host pauses between read and write.
    fn cycle(&mut self, pause: u64) {
        let _ = self.driver.read();
        if self.driver.board_state() != BoardState::Running {
            let _ = self.driver.rearm();
        }
        let period = self.driver.period();
        let bus = self.driver.bus_mut();
        bus.wait(Duration::from_nanos(pause));
        let _ = self.driver.write();
        self.driver.bus_mut().wait(period);
    }

    /// Resets and bites that were reported, and counted.
    fn losses(&mut self) -> [u64; 2] {
        let told: Vec<_> = self.events.by_ref().map(|event| event.kind).collect();
        let count = |kind| told.iter().filter(|told| **told == kind).count() as u64;
        let told = [EventKind::BoardReset, EventKind::WatchdogBitten].map(count);
        let counted = self.driver.statistics();
        assert_eq!(told, [counted.resets, counted.watchdog_bites]);
        told
    }
}

/// A board that is reset restarts its counters of packets as well, so that a write that is lost
/// with it is uncertain.
#[test]
fn ethernet_reset_below_watchdog_time_is_one_reset_and_no_bite() {
    for (watchdog, longest) in [(50, 30), (800, 300)] {
        for away in [0, 1, 3, 6, 10, 30, 100, 300] {
            for offset in [0, 1_000_000, 2_500_000, 4_900_000] {
                if away > longest {
                    continue;
                }
                let fpga = machines::six_axes_7i97(Motor::default());
                let mut kept = Kept::start(connect(SimLink::new(fpga)), watchdog);
                let link = kept.driver.bus_mut().link();
                let now = link.time();
                link.resets.push((now + offset, away * MS));
                kept.run(400);
                let what = format!("{away} ms, watchdog {watchdog} ms, {offset} ns");
                assert_eq!(kept.losses(), [1, 0], "{what}");
                assert_eq!(kept.driver.board_state(), BoardState::Running, "{what}");
            }
        }
    }
}

#[test]
fn bite_while_the_host_paused_within_a_cycle_is_no_reset() {
    for (watchdog, pause) in [(20, 21), (20, 500), (800, 801), (800, 2000)] {
        let fpga = machines::six_axes_7i97(Motor::default());
        let mut kept = Kept::start(fpga, watchdog);
        kept.cycle(pause * MS);
        kept.run(400);
        assert_eq!(kept.losses(), [0, 1], "{pause} ms");
        let fpga = machines::six_axes_7i97(Motor::default());
        let mut kept = Kept::start(connect(SimLink::new(fpga)), watchdog);
        kept.cycle(pause * MS);
        kept.run(400);
        assert_eq!(kept.losses(), [0, 1], "{pause} ms, on Ethernet");
    }
}
