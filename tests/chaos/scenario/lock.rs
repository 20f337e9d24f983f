//! The DPLL: times at which it must or cannot be locked to the reads, and the consequences.

use mesa_hal::driver::{BoardState, CycleReport, Pace};
use mesa_hal_sim::{FaultKind, FaultPlace};

use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{Board, LOCKED_AFTER, Planned};
use super::Scenario;

/// Number of reads from which on the phase is left to the loop.
const LEFT_AFTER: u64 = 95;

/// Number of reads of different lateness after which it can no longer be locked.
const UNLOCKED_AFTER: u64 = 60;

/// History of the reads.
#[derive(Debug, Default)]
pub(super) struct Lock {
    /// Start of the last read.
    before: Option<u64>,
    /// Number of consecutive good reads at equal intervals.
    even: u64,
    /// Number of consecutive reads at unequal intervals.
    uneven: u64,
    /// The request was sent ahead.
    is_ahead: bool,
    /// The driver sets the phase no more, which it does after a set-up.
    is_left: bool,
    /// The reads have got another phase since: the loop takes seconds to follow (FACTS 12.4).
    has_jumped: bool,
}

impl Scenario {
    /// After a read that began at `started`: checks the driver's report of the DPLL's lock.
    pub(super) fn locks(
        &mut self,
        report: Option<CycleReport>,
        started: u64,
        is_wild: bool,
    ) -> Checked {
        let now = self.sim.now();
        let (plan, lock) = (&self.plan, &mut self.lock);
        let is_locked = report.is_some_and(|report| report.locked);
        ensure(!is_locked || plan.has_dpll(), Promise::Told, now, || {
            "a DPLL that is not there is in step".to_owned()
        })?;
        let before = lock.before.replace(started);
        let interval = before.map_or(0, |before| started - before);
        // A request that is sent ahead reaches the board at another time.
        let is_ahead = plan.extras.reads_ahead && is_wild;
        let is_same = std::mem::replace(&mut lock.is_ahead, is_ahead) == is_ahead;
        let is_even = interval.abs_diff(plan.period) * 100 < plan.period && is_same;
        let runs = report.is_some_and(|report| report.board == BoardState::Running);
        lock.has_jumped = runs && (lock.has_jumped || lock.is_left && !is_even);
        lock.is_left = runs && (lock.is_left || lock.even > LEFT_AFTER);
        lock.even = if is_even && runs { lock.even + 1 } else { 0 };
        if report.is_some() && plan.more.is_latched {
            // Before the lock, a sample is not reliable: it may be the previous one. And a single
            // read can be late at any time.
            self.sampled_before = if is_locked && lock.even > LOCKED_AFTER / 2 {
                plan.period / 4 + plan.period * 3 / 20
            } else {
                3 * plan.period
            };
        }
        let is_jittering = is_wild && now >= self.jitters_from;
        lock.uneven = if is_jittering { lock.uneven + 1 } else { 0 };
        // Packets delayed by the network arrive at other intervals than they were sent.
        let is_delayed = |fault: &Planned| {
            fault.kind.place() == FaultPlace::Network || fault.kind == FaultKind::FpgaResetLong
        };
        let is_sound = plan.pace == Pace::Host && !plan.faults.iter().any(is_delayed);
        if !is_sound || !plan.has_dpll() {
            return Ok(());
        }
        let (even, uneven) = (lock.even, lock.uneven);
        // A write that is preceded by settings which drive pins is later than others. If such a
        // write is the last one that sets the phase, the loop takes seconds to lock.
        let may = plan.habits.settings_one_in > 0 || plan.extras.reads_ahead;
        let may = may || !plan.spares_the_board();
        // The same holds for the drive of the isolated outputs.
        let may = may || plan.board == Board::I7i97 && plan.more.tunes_one_in > 0;
        let may = may || lock.has_jumped;
        let is_right = is_locked || even < LOCKED_AFTER || may;
        ensure(is_right, Promise::Told, now, || {
            format!("the DPLL is not in step after {even} reads at equal intervals")
        })?;
        ensure(
            !is_locked || uneven < UNLOCKED_AFTER,
            Promise::Told,
            now,
            || format!("the DPLL is in step after {uneven} reads at unequal intervals"),
        )
    }
}
