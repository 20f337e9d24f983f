//! A board that is read and not written while it waits to be re-armed, as by the component for
//! LinuxCNC.

use mesa_hal::transport::{BusLog, RecordedEntry, Recording};

use super::*;

impl Rig for Recording<Faulty<SimFpga>> {
    fn cut(&mut self) {
        self.inner.cut();
    }

    fn deafen(&mut self) {
        self.inner.deafen();
    }

    fn mend(&mut self) {
        self.inner.mend();
    }
}

impl<B: Rig> Machine<B> {
    /// Follows the board for a minute, in which the axis turns by a multiple of what its counter
    /// has.
    fn follow_for_a_minute(&mut self) {
        for _ in 0..6 {
            for speed in [20.0, -5.0] {
                self.turn(speed);
                for _ in 0..5_000 {
                    assert!(self.driver.follow());
                    self.rest();
                }
            }
        }
        self.turn(0.0);
    }
}

#[test]
fn board_that_is_followed_is_read_and_not_written() {
    for (trouble, is_bitten) in [(Trouble::Cut(75), false), (Trouble::Deaf(300), true)] {
        let bus = Recording::new(embedded(plain()), BusLog::new(1_000_000));
        let mut machine = Machine::new(bus, "followed");
        let (count, motor) = machine.counts();
        machine.turn(20.0);
        machine.cycles(50);
        assert!(!machine.driver.follow(), "of a board that runs");
        machine.happens(trouble);
        assert_eq!(machine.driver.board_state(), BoardState::BusDown);
        let statistics = machine.driver.statistics();
        let (errors, writes) = (statistics.read_errors, statistics.writes);
        // Looks that fail change nothing.
        machine.driver.bus_mut().cut();
        for _ in 0..20 {
            assert!(!machine.driver.follow());
            machine.rest();
        }
        machine.driver.bus_mut().mend();
        machine.driver.bus_mut().log.resume();
        machine.follow_for_a_minute();
        let mut entries = machine.driver.bus().log.entries();
        assert!(entries.len() > 100_000);
        assert!(entries.all(|entry| matches!(entry, RecordedEntry::Read { .. })));
        let statistics = machine.driver.statistics();
        assert_eq!(
            (statistics.read_errors, statistics.writes),
            (errors, writes)
        );
        machine.comes_back();
        machine.stand();
        let (now, motor_now) = machine.counts();
        assert!(motor_now - motor > 100_000.0);
        let missing = motor_now - motor - f64::from(now.wrapping_sub(count));
        assert!(missing.abs() <= 1.0, "{trouble:?}: {missing}");
        assert!(!machine.is_unsure(), "{trouble:?}");
        let bites = machine.driver.statistics().watchdog_bites;
        assert!(bites == 0 || is_bitten, "{trouble:?}");
    }
}

/// The motor stood still when the watchdog released its pins.
#[test]
fn estimate_of_a_bitten_generator_is_that_of_the_first_look() {
    for gap in [0, 300] {
        let mut machine = Machine::new(embedded(plain()), "bitten");
        let (shown, motor) = machine.steps();
        machine.run(Some(8.0));
        machine.cycles(100);
        machine.happens(Trouble::Cut(300));
        machine.wait(gap);
        for _ in 0..20_000 {
            assert!(machine.driver.follow());
            machine.rest();
        }
        machine.comes_back();
        machine.run(None);
        machine.cycles(50);
        assert!(machine.is_step_unsure());
        let (now, motor_now) = machine.steps();
        let wrong = (now - shown) - (motor_now - motor);
        // What it makes in a period, and edges of pins that are released and driven again.
        assert!(wrong.abs() <= 12.0, "{gap}: {wrong}");
    }
}
