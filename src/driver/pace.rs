//! Pacing of the cycle by the host or by the board.

use core::time::Duration;

use super::Pace;
use super::cycle::{CycleWrite, Outcome};
use crate::bus::{BusError, Clock, Exchanges, Instant, ReadRequest, RegisterBus, Words};
use crate::fraction::Fraction;

/// Pacing of the cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ExchangePacer {
    pub pace: Pace,
    pub period: Duration,
    /// The read that was requested ahead, and when.
    started: Option<(ReadRequest, Instant)>,
    /// Begin of the last cycle, where the board paces.
    begun: Option<Instant>,
    /// Consecutive failed reads.
    failures: u32,
}

/// Number of failures after which reads are not held back any more: held requests would queue up in
/// the board, with the writes between them, and outputs would be late by that many periods.
const MAX_FAILURES: u32 = 2;

impl ExchangePacer {
    pub fn new(pace: Pace, period: Duration) -> Self {
        Self {
            pace,
            period,
            ..Self::default()
        }
    }

    /// Discards the read that was requested ahead. Waits for its reply, because the board holds
    /// back everything that is sent meanwhile.
    pub fn forget_started<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        exchanges: &Exchanges,
        words: &mut Words,
    ) {
        if let Some((started, _)) = self.started.take() {
            // After any outcome, nothing waits in the board any more.
            let _ = exchanges.finish(bus, words, started);
        }
    }

    /// Reads the board: takes the read that was requested ahead, or else requests one.
    pub fn read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        exchanges: &Exchanges,
        words: &mut Words,
        extra: bool,
    ) -> Outcome {
        if self.started.is_none() && self.is_behind() {
            self.rest(bus, self.period);
        }
        let (started, from) = if let Some((started, from)) = self.started.take() {
            (Ok(started), from)
        } else {
            let from = bus.now();
            (exchanges.start_read(bus, words, self.ask(extra)), from)
        };
        let (extra, result) = match started {
            Ok(started) => (started.extra, exchanges.finish(bus, words, started)),
            Err(error) => (extra, Err(error)),
        };
        let at = bus.now();
        // A failed read may return without waiting, and a board may answer without waiting: the
        // pace is then kept here. After a good read only for half a period, because inputs that
        // were delayed on the way are followed by early ones.
        let least = if result.is_err() {
            self.failures = self.failures.saturating_add(1);
            self.period
        } else {
            self.failures = 0;
            self.period.fraction(1, 2)
        };
        if self.pace == Pace::Board {
            self.rest(bus, least);
            self.begun = Some(bus.now());
        }
        Outcome {
            at,
            extra,
            ..Outcome::new(from, result)
        }
    }

    /// Waits until the previous cycle has taken `least`, where the board paces but does not wait:
    /// the application's loop would spin otherwise.
    fn rest<B: RegisterBus + Clock>(&self, bus: &mut B, least: Duration) {
        let Some(before) = self.begun else {
            return;
        };
        let left = before.after(least).since(bus.now());
        if !left.is_zero() {
            bus.wait(left);
        }
    }

    fn is_behind(&self) -> bool {
        self.pace == Pace::Board && self.failures >= MAX_FAILURES
    }

    /// Writes, and requests the next inputs with the write if the board paces.
    pub fn write<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        exchanges: &mut Exchanges,
        words: &mut Words,
        form: CycleWrite,
    ) -> Result<(), BusError> {
        let ask = self.ask(form.extra);
        if !ask.held {
            return exchanges.write(bus, words, form.writes);
        }
        let from = bus.now();
        let started = exchanges.start_cycle(bus, words, ask, form.writes)?;
        self.started = started.map(|started| (started, from));
        Ok(())
    }

    /// Requests inputs ahead. If that fails, the next read requests them again, and returns the
    /// error.
    pub fn start_read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        exchanges: &Exchanges,
        words: &Words,
        extra: bool,
    ) {
        let from = bus.now();
        let started = exchanges.start_read(bus, words, self.ask(extra));
        self.started = started.ok().map(|started| (started, from));
    }

    fn ask(&self, extra: bool) -> ReadRequest {
        let held = self.pace == Pace::Board && !self.is_behind();
        ReadRequest {
            held,
            extra,
            after: None,
        }
    }
}
