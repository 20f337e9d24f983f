//! Validity: unknown values are not valid, and values without a failure are.

use mesa_hal::driver::{BoardState, Driver};
use mesa_hal_sim::{FaultKind, FaultPlace};

use super::super::application::Application;
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{Plan, Planned};
use super::Scenario;

/// State of the validity checks.
#[derive(Debug, Default)]
pub(super) struct Validity {
    /// Number of consecutive cycles whose read has failed.
    missed: u32,
    /// For each remote: valid at least once since it and the board have been running.
    was_valid: Vec<bool>,
}

impl Validity {
    /// The driver has read the board outside of the cycle: the row of failed reads is over.
    pub(super) fn was_read(&mut self) {
        self.missed = 0;
    }
}

/// True if nothing fails on a wire, in a remote, or on the board: the only faults are lost packets
/// to or from the host.
fn is_sound(plan: &Plan) -> bool {
    let is_missed = |fault: &Planned| {
        let place = fault.kind.place();
        let is_host = matches!(fault.kind, FaultKind::HostLate);
        (matches!(place, FaultPlace::Network | FaultPlace::Bus) || is_host) && !fault.in_build
    };
    !plan.has_deeds() && plan.faults.iter().all(is_missed)
}

impl Scenario {
    /// After a read: `good` if it succeeded.
    pub(super) fn validity<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
        good: bool,
    ) -> Checked {
        let now = self.sim.now();
        let stale_after = self.plan.extras.stale_after;
        let Validity { missed, was_valid } = &mut self.validity;
        *missed = if good { 0 } else { *missed + 1 };
        if *missed >= stale_after {
            let missed = *missed;
            let board = driver.pins().group_state(driver.group());
            let board_is_valid = board.is_some_and(|state| state.valid);
            ensure(!board_is_valid, Promise::Inputs, now, || {
                format!("the board's own inputs are valid after {missed} reads that failed")
            })?;
            let mut running = application.running(driver);
            let valid = running.find(|(_, state)| state.valid);
            ensure(valid.is_none(), Promise::Inputs, now, || {
                format!("{valid:?} is valid after {missed} reads that failed")
            })?;
        }
        was_valid.resize(self.plan.remotes(), false);
        let runs = driver.board_state() == BoardState::Running;
        let mut before = std::mem::replace(was_valid, vec![false; self.plan.remotes()]);
        if !runs {
            return Ok(());
        }
        for (number, state) in application.running(driver) {
            let is_fresh = state.age.cycles < stale_after.into();
            let is_lost = before[number] && is_fresh && !state.valid;
            ensure(
                !is_lost || !is_sound(&self.plan),
                Promise::Missed,
                now,
                || {
                    format!(
                        "remote {number} is not valid after {} cycles without news, and nothing has \
                         failed but the way of the host to the board",
                        state.age.cycles
                    )
                },
            )?;
            was_valid[number] = state.valid || before[number] && is_fresh;
        }
        before.clear();
        Ok(())
    }
}
