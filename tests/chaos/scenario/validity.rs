//! Validity: what is not known any more is not valid, and what nothing has failed for is.

use mesa_hal::driver::{BoardState, Driver};
use mesa_hal_sim::{FaultKind, Place};

use super::super::application::Application;
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{Plan, Planned};
use super::Scenario;

/// What the checks of validity remember.
#[derive(Debug, Default)]
pub(super) struct Validity {
    /// Cycles in a row whose read has failed.
    missed: u32,
    /// Of each remote: it was valid since it runs and the board does.
    was_valid: Vec<bool>,
}

/// Whether nothing fails on a wire, in a remote, and on the board: all that happens is that the host
/// does not hear or is not heard.
fn is_sound(plan: &Plan) -> bool {
    let is_missed = |fault: &Planned| {
        let place = fault.kind.place();
        let is_host = matches!(fault.kind, FaultKind::HostLate);
        (matches!(place, Place::Network | Place::Bus) || is_host) && !fault.in_build
    };
    !plan.has_deeds() && plan.faults.iter().all(is_missed)
}

impl Scenario {
    /// After a read, which was `good` or not.
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
