//! Keeps the pace of the host, or of the board.

use core::time::Duration;

use super::Pace;
use crate::bus::{Ask, Clock, Exchanges, Instant, RegisterBus, Words};
use crate::fraction::Fraction;

/// Keeps the pace.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pacer {
    pub pace: Pace,
    pub period: Duration,
    /// What was asked for ahead.
    started: Option<Ask>,
    /// When the last cycle began.
    begun: Option<Instant>,
    /// Reads in a row that failed.
    failures: u32,
}

/// After this number of failures the board is asked at once: requests that it holds back would stand in a
/// row there, with the writes between them, and outputs would come that many periods late.
const BEHIND: u32 = 2;

/// What came of a read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer<E> {
    /// It held more than usual.
    pub extra: bool,
    /// When it came: the cycle may begin later.
    pub at: Instant,
    pub result: Result<(), E>,
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
    pub fn forget_started<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        exchanges: &Exchanges<B>,
        words: &mut Words,
    ) {
        if let Some(started) = self.started.take() {
            // Whatever became of it, nothing waits in the board after it.
            let _ = exchanges.finish(bus, words, started);
        }
    }

    /// Reads the board: takes what was asked for ahead, or else asks for it.
    pub fn read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        exchanges: &Exchanges<B>,
        words: &mut Words,
        extra: bool,
    ) -> Answer<B::Error> {
        if self.started.is_none() && self.is_behind() {
            self.rest(bus, self.period);
        }
        let started = match self.started.take() {
            Some(started) => Ok(started),
            None => exchanges.start_read(bus, words, self.ask(extra)),
        };
        let (extra, result) = match started {
            Ok(started) => (started.extra, exchanges.finish(bus, words, started)),
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
        exchanges: &mut Exchanges<B>,
        words: &mut Words,
        (extra, quiet): (bool, bool),
    ) -> Result<(), B::Error> {
        let ask = self.ask(extra);
        if !ask.held {
            return exchanges.write(bus, words, quiet);
        }
        self.started = exchanges.start_cycle(bus, words, ask, quiet)?;
        Ok(())
    }

    /// Asks for inputs ahead. If that fails, the next read asks again, and says why it fails.
    pub fn start_read<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        exchanges: &Exchanges<B>,
        words: &Words,
        extra: bool,
    ) {
        self.started = exchanges.start_read(bus, words, self.ask(extra)).ok();
    }

    fn ask(&self, extra: bool) -> Ask {
        let held = self.pace == Pace::Board && !self.is_behind();
        Ask {
            held,
            extra,
            with_writes: false,
        }
    }
}
