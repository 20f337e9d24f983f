//! Detection, from the arrival of inputs, that cycle and board run together.

use core::time::Duration;

use super::Pace;
use crate::bus::Instant;
use crate::fraction::Fraction;

/// Arrival of inputs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ArrivalClock {
    pace: Pace,
    period: Duration,
    /// Arrival of the last inputs.
    arrived: Option<Instant>,
    /// The last interval was clearly shorter than a period.
    was_short: bool,
    /// Mean of the last phase errors, early or late, in microseconds.
    mean_error_us: Option<f64>,
    /// Consecutive reads in which cycle and board ran together.
    locked_reads: u32,
}

/// Number of consecutive reads that have to be in step: more than those in which the phase is set.
const LOCKED: u32 = 120;

/// Weight of one read in the mean of phase errors.
const WEIGHT: f64 = 1.0 / 16.0;

/// Tolerance of the mean, as a part of the period.
const TOLERANCE: f64 = 1.0 / 20.0;

/// State of the board's clock, from the arrival of inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tick {
    /// Periods that passed without inputs.
    pub missed: u64,
    /// The clock has not begun this cycle.
    pub is_unpaced: bool,
}

impl ArrivalClock {
    pub fn new(pace: Pace, period: Duration) -> Self {
        Self {
            pace,
            period,
            ..Self::default()
        }
    }

    /// True if cycle and board run together, after a read that found the loop's phase at
    /// `phase_error_us`. See [`CycleReport::locked`](super::CycleReport).
    pub fn lock(&mut self, beat: Tick, slack: Option<Duration>, phase_error_us: f64) -> bool {
        let is_in_step = match self.pace {
            Pace::Board => slack.is_some() && beat == Tick::default(),
            Pace::Host => {
                let error = libm::fabs(phase_error_us);
                let before = self.mean_error_us.unwrap_or(error);
                let mean = before + (error - before) * WEIGHT;
                self.mean_error_us = Some(mean);
                mean <= self.period.as_secs_f64() * 1e6 * TOLERANCE
            }
        };
        let reads = self.locked_reads.saturating_add(1);
        self.locked_reads = if is_in_step { reads } else { 0 };
        self.locked_reads >= LOCKED
    }

    /// Resets the lock, because the board is not running.
    pub fn unlock(&mut self) {
        (self.mean_error_us, self.locked_reads) = (None, 0);
    }

    /// Evaluates the arrival of inputs, which the board held back for `slack`.
    pub fn arrived(&mut self, now: Instant, slack: Option<Duration>) -> Tick {
        let before = self.arrived.replace(now);
        let (Pace::Board, Some(before)) = (self.pace, before) else {
            return Tick::default();
        };
        let since = now.since(before);
        debug_assert!(!self.period.is_zero(), "refused at the start");
        let period = self.period.as_nanos();
        let rounded = since.as_nanos().saturating_add(period / 2);
        let passed = rounded.checked_div(period).unwrap_or(0);
        // Inputs that were delayed on the way make the next interval short, but not two in a row.
        let is_short = since < self.period.fraction(3, 4);
        let was_short = core::mem::replace(&mut self.was_short, is_short);
        // The board waited for longer than a period.
        let stands_still = slack.is_some_and(|slack| slack > self.period.fraction(9, 8));
        Tick {
            missed: u64::try_from(passed.saturating_sub(1)).unwrap_or(u64::MAX),
            is_unpaced: stands_still || (is_short && was_short),
        }
    }
}
