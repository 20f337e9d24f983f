//! Keeps the pace of the host, or of the board.

use core::time::Duration;

use super::Pace;
use crate::bus::{Ask, Clock, Image, Instant, RegisterBus, Reply};
use crate::fraction::Fraction;

/// Keeps the pace.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pacer {
    pub pace: Pace,
    pub period: Duration,
    /// What was asked for ahead.
    started: Option<Ask>,
    /// When the last cycle began, ...
    begun: Option<Instant>,
    /// ... and when the last one with inputs did.
    arrived: Option<Instant>,
    /// It came sooner after the one before than periods do.
    was_short: bool,
    /// Reads in a row that failed.
    failures: u32,
    /// The mean of the last phase errors, early or late, in microseconds.
    mean_error_us: Option<f64>,
    /// Reads in a row in which cycle and board ran together.
    locked_reads: u32,
}

/// Reads in a row that have to be in step: more than those in which the phase is set.
const LOCKED: u32 = 120;

/// Weight of one read in the mean of phase errors.
const WEIGHT: f64 = 1.0 / 16.0;

/// How far the mean may be off, as a part of the period.
const TOLERANCE: f64 = 1.0 / 20.0;

/// After this number of failures the board is asked at once: requests that it holds back would stand in a
/// row there, with the writes between them, and outputs would come that many periods late.
const BEHIND: u32 = 2;

/// What the arrival of inputs says of the board's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Beat {
    /// Periods that went by without inputs.
    pub missed: u64,
    /// The clock has not begun this cycle.
    pub is_unpaced: bool,
}

/// What came of a read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer<E> {
    /// It held more than usual.
    pub extra: bool,
    /// When it came: the cycle may begin later.
    pub at: Instant,
    pub result: Result<Reply, E>,
}

impl Pacer {
    pub fn new(pace: Pace, period: Duration) -> Self {
        Self {
            pace,
            period,
            ..Self::default()
        }
    }

    /// What was asked for ahead is of no use any more. Waits for it, because the board holds back
    /// everything that is sent meanwhile.
    pub fn forget_started<B: RegisterBus>(&mut self, bus: &mut B, image: &mut Image<B>) {
        if let Some(started) = self.started.take() {
            // Whatever became of it, nothing waits in the board after it.
            let _ = image.finish(bus, started);
        }
    }

    /// Reads the board: takes what was asked for ahead, or else asks for it.
    pub fn read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        image: &mut Image<B>,
        extra: bool,
    ) -> Answer<B::Error> {
        if self.started.is_none() && self.is_behind() {
            self.rest(bus, self.period);
        }
        let started = match self.started.take() {
            Some(started) => Ok(started),
            None => image.start_read(bus, self.ask(extra)),
        };
        let (extra, result) = match started {
            Ok(started) => (started.extra, image.finish(bus, started)),
            Err(error) => (extra, Err(error)),
        };
        let at = bus.now();
        // A read that failed may have done so without waiting, and a board may answer without
        // waiting: nobody else would wait then. Not longer for one that was answered: inputs that
        // were delayed on the way are followed by some that come soon.
        let least = if result.is_err() {
            self.failures = self.failures.saturating_add(1);
            self.period
        } else {
            self.failures = 0;
            self.period.fraction(1, 2)
        };
        self.rest(bus, least);
        self.begun = Some(bus.now());
        Answer { extra, at, result }
    }

    /// Where the board paces and does not, waits until the cycle before has taken `least`: the
    /// application's loop would spin.
    fn rest<B: RegisterBus + Clock>(&self, bus: &mut B, least: Duration) {
        let (Pace::Board, Some(before)) = (self.pace, self.begun) else {
            return;
        };
        let left = before.after(least).since(bus.now());
        if !left.is_zero() {
            bus.wait(left);
        }
    }

    fn is_behind(&self) -> bool {
        self.pace == Pace::Board && self.failures >= BEHIND
    }

    /// Writes, and asks for the next inputs with it if the board paces. `quiet`: without settings.
    pub fn write<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        image: &mut Image<B>,
        (extra, quiet): (bool, bool),
    ) -> Result<(), B::Error> {
        let ask = self.ask(extra);
        if !ask.held {
            return image.write(bus, quiet);
        }
        self.started = image.start_cycle(bus, ask, quiet)?;
        Ok(())
    }

    /// Asks for inputs ahead. If that fails, the next read asks again, and says why it fails.
    pub fn start_read<B: RegisterBus>(&mut self, bus: &mut B, image: &Image<B>, extra: bool) {
        self.started = image.start_read(bus, self.ask(extra)).ok();
    }

    fn ask(&self, extra: bool) -> Ask {
        let held = self.pace == Pace::Board && !self.is_behind();
        Ask {
            held,
            extra,
            with_writes: false,
        }
    }

    /// Whether cycle and board run together, after a read that found the loop's phase at
    /// `phase_error_us`. See [`CycleReport::locked`](super::CycleReport).
    pub fn lock(&mut self, beat: Beat, slack: Option<Duration>, phase_error_us: f64) -> bool {
        let is_in_step = match self.pace {
            Pace::Board => slack.is_some() && beat == Beat::default(),
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

    /// The board is not running.
    pub fn unlock(&mut self) {
        (self.mean_error_us, self.locked_reads) = (None, 0);
    }

    /// Inputs have arrived, which the board held back for `slack`.
    pub fn arrived(&mut self, now: Instant, slack: Option<Duration>) -> Beat {
        let before = self.arrived.replace(now);
        let (Pace::Board, Some(before)) = (self.pace, before) else {
            return Beat::default();
        };
        let since = now.since(before);
        let period = self.period.as_nanos();
        let rounded = since.as_nanos().saturating_add(period / 2);
        let passed = rounded.checked_div(period).unwrap_or(0);
        // One interval is short when the inputs before were delayed on the way, but not two.
        let is_short = since < self.period.fraction(3, 4);
        let was_short = core::mem::replace(&mut self.was_short, is_short);
        // It waited for longer than a period lasts.
        let stands_still = slack.is_some_and(|slack| slack > self.period.fraction(9, 8));
        Beat {
            missed: u64::try_from(passed.saturating_sub(1)).unwrap_or(u64::MAX),
            is_unpaced: stands_still || (is_short && was_short),
        }
    }
}
