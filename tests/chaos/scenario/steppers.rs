//! Stepper motors: what they do, and what is known about it.

use std::time::Duration;

use mesa_hal::driver::{BoardState, Driver, Pace, SerialPort};
use mesa_hal_sim::FaultKind;

use super::super::application::{Application, Jolts};
use super::super::journal::What;
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{LONGEST_WATCHDOG, MILLI};
use super::Scenario;

/// Longest time until all motors are where they were commanded to.
const ARRIVE_IN: u64 = 500 * MILLI;

/// Events of the board for its motors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StepperWatch {
    /// Bites, resets and set-ups since the last look.
    edges: u32,
    /// The board has bitten or was reset since the last look.
    is_lost: bool,
    /// It has at any time.
    was_lost: bool,
    /// It was reset since the last look.
    is_reset: bool,
}

impl StepperWatch {
    /// Takes an event of the board.
    pub(super) fn happened(&mut self, what: &What, is_before_set_up: bool) {
        let is_lost = matches!(what, What::Bite | What::Reset);
        self.edges += u32::from(is_lost || matches!(what, What::Opened | What::Closed));
        self.is_lost |= is_lost && !is_before_set_up;
        self.was_lost |= is_lost;
        self.is_reset |= matches!(what, What::Reset);
    }
}

impl Scenario {
    /// Asks for a period that the driver refuses: everything is safe until it is re-armed.
    pub(super) fn is_refused_a_period<B: Host>(&mut self, driver: &mut Driver<B>) -> Checked {
        if !self.plan.steppers.is_refused || self.plan.pace != Pace::Host {
            return Ok(());
        }
        let now = self.sim.now();
        let refused = driver.set_period(Duration::from_secs(1));
        self.stage.tell(now, format!("period of 1 s: {refused:?}"));
        ensure(refused.is_err(), Promise::Works, now, || {
            "a period of 1 s is taken".to_owned()
        })?;
        let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
        let groups = remotes.map(|remote| remote.pins.group);
        for group in groups.chain([driver.group()]) {
            let state = driver.pins().group_state(group);
            ensure(
                state.is_some_and(|state| !state.armed),
                Promise::Safe,
                now,
                || format!("{group:?} is armed after a period was refused"),
            )?;
        }
        Ok(())
    }

    /// After a read: `good` if it succeeded.
    pub(super) fn steppers<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &mut Application,
        good: bool,
    ) -> Checked {
        if self.plan.steppers.count == 0 {
            return Ok(());
        }
        let watch = self.steppers;
        (self.steppers.edges, self.steppers.is_lost) = (0, false);
        self.steppers.is_reset = false;
        // Without replies it goes on writing until the bus is down.
        let unheard = if self.plan.loses_replies() {
            4 * u64::from(self.plan.extras.bus_error_limit)
        } else {
            0
        };
        // Nothing tells a host that stands still when a watchdog bites sooner than its time.
        let has = |kind| self.plan.faults.iter().any(|fault| fault.kind == kind);
        let unseen = if has(FaultKind::FpgaWatchdog) && self.plan.host_stands_still() {
            LONGEST_WATCHDOG
        } else {
            0
        };
        let is_calm = !watch.was_lost
            && self.stage.begun().is_empty()
            && self.stage.happened().is_empty()
            && self.plan.spares_its_host()
            && self.is_armed;
        let jolts = Jolts {
            edges: watch.edges,
            is_lost: watch.is_lost || self.watch.is_some(),
            is_reset: watch.is_reset,
            mistaken_by: (unheard + 2) * self.plan.period + self.plan.lateness() + unseen,
            is_calm,
            has_old_writes: self.plan.faults.iter().any(|fault| {
                matches!(
                    fault.kind,
                    FaultKind::NetworkDuplicate | FaultKind::NetworkLate
                )
            }),
        };
        let (motors, at) = self.sim.steppers();
        let took = self.took + at.saturating_sub(self.sim.now());
        application.check_steppers(driver, &motors, (took, at), (jolts, good))
    }

    /// With all faults over, the motors go where they are commanded to.
    pub(super) fn steppers_arrive<B: Host>(&mut self, process: &mut super::Process<B>) -> Checked {
        let until = self.sim.now() + ARRIVE_IN;
        while self.plan.steppers.count > 0 {
            let Err(why) = process
                .application
                .steppers_have_arrived(&process.driver, &self.sim.steppers().0)
            else {
                break;
            };
            let now = self.sim.now();
            ensure(now < until, Promise::ComesBack, now, || why)?;
            self.cycle(process, false)?;
            let is_down = process.driver.board_state() != BoardState::Running;
            ensure(!is_down, Promise::ComesBack, now, || {
                "the board is down although all is well".to_owned()
            })?;
        }
        Ok(())
    }

    /// The process has ended: the motors stand still.
    pub(super) fn steppers_stand(&mut self) -> Checked {
        if self.plan.steppers.count == 0 {
            return Ok(());
        }
        let steps = |scenario: &Self| -> Vec<i64> {
            let (motors, _) = scenario.sim.steppers();
            motors
                .iter()
                .map(mesa_hal_sim::Stepper::commanded)
                .collect()
        };
        let before = steps(self);
        self.sim.pass(50 * MILLI);
        let now = self.sim.now();
        let after = steps(self);
        ensure(before == after, Promise::Safe, now, || {
            format!("the motors go from {before:?} to {after:?} after the process ended")
        })
    }
}
