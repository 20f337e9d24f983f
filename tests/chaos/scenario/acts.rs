//! Acts during a fault: `rearm_when_running` covers what was known when it was given, and nothing
//! later.

use mesa_hal::driver::{BoardState, Driver};

use super::super::application::Application;
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::Scenario;

/// Acts of an application that gives one for each fault, once it has seen the fault.
#[derive(Clone, Debug, Default)]
pub(super) struct Acts {
    /// Number of faults that had begun at the last act.
    covered: usize,
    /// At the last act no bus was there: the number of resets that had been reported by then.
    without_bus: Option<u32>,
    /// The groups that were not armed at the last look.
    waiting: Vec<usize>,
}

impl Scenario {
    /// Re-arms, once for each fault, some time after something was lost by it.
    pub(super) fn acts_early<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
    ) -> Checked {
        if !self.plan.later.acts_early || !self.is_armed || !self.side.one_in(8) {
            return Ok(());
        }
        let begun = self.stage.begun().len();
        let is_lost = !application.waiting(driver).is_empty();
        if begun <= self.acts.covered || !is_lost {
            return Ok(());
        }
        let is_down = driver.board_state() == BoardState::BusDown;
        self.acts.without_bus = is_down.then_some(self.what_is_told.resets_heard);
        self.rearm_when_running(driver, application)?;
        self.acts.covered = begun;
        Ok(())
    }

    /// True if an act was given for the last fault, and no other one is needed.
    pub(super) fn has_acted(&self) -> bool {
        let begun = self.stage.begun().len();
        self.plan.later.acts_early && begun > 0 && begun == self.acts.covered
    }

    /// At the end of a cycle: while the faults that have begun are covered by an act, all groups
    /// are armed or come, and each is armed when it runs; without an act, none is armed that was
    /// not.
    pub(super) fn acts_cover<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
    ) -> Checked {
        if !self.plan.later.acts_early || !self.is_armed {
            return Ok(());
        }
        let now = self.sim.now();
        // While an FPGA has no configuration, nothing answers: that it was reset is found
        // afterwards, and ends the act.
        let (acts, resets) = (&mut self.acts, self.what_is_told.resets_heard);
        let is_found = acts.without_bus.take_if(|before| *before < resets);
        if is_found.is_some() {
            acts.covered = acts.covered.saturating_sub(1);
        }
        let waiting = application.waiting(driver);
        let before = std::mem::replace(&mut self.acts.waiting, waiting);
        let waiting = &self.acts.waiting;
        let coming = application.pending_groups(driver);
        let running = application.running_groups(driver);
        let mut armed = before.iter().filter(|group| !waiting.contains(group));
        if !self.has_acted() {
            return ensure(armed.next().is_none(), Promise::Safe, now, || {
                format!("{before:?} waited, now only {waiting:?} wait, and there was no act for it")
            });
        }
        ensure(
            armed.all(|group| running.contains(group)),
            Promise::Safe,
            now,
            || format!("{before:?} waited, now only {waiting:?} wait, and only {running:?} run"),
        )?;
        let mut left = waiting.iter().filter(|group| !coming.contains(group));
        ensure(left.next().is_none(), Promise::ComesBack, now, || {
            format!("{waiting:?} wait, of which only {coming:?} come, after an act")
        })
    }
}
