//! A bus wrapper that logs accesses.

use core::fmt;
use core::time::Duration;
use std::collections::VecDeque;
use std::io;

use crate::bus::{
    Access, AccessList, BoardIdentity, BusError, BusErrorKind, BusStatistics, Clock, Direction,
    Effort, Hold, Instant, RegisterBus, Reply,
};
use crate::tally::Tally;

/// Keeps the last accesses of a bus, each with its time, register and value.
///
/// The written log has the format of the host lines in the gateware transcripts: time in us,
/// direction, address, value. The log has a fixed size; when it is full, the oldest entries are
/// dropped and counted.
///
/// # Real time
/// Adds the cost of one log entry for each word and of one clock reading. Allocates only when it is
/// created.
#[derive(Debug)]
pub struct Recording<B> {
    /// The inner bus.
    pub inner: B,
    /// The log, oldest entry first.
    pub entries: VecDeque<RecordedEntry>,
    capacity: usize,
    /// Number of entries that were dropped for newer ones.
    pub dropped: u64,
}

/// An entry of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct RecordedEntry {
    /// Time at which the exchange ended.
    pub at: Instant,
    /// The register; the first one for an exchange that failed.
    pub address: u16,
    /// The event.
    pub event: RecordedEvent,
}

/// Events in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RecordedEvent {
    /// The register was read and had this word.
    Read(u32),
    /// The word was written to the register.
    Written(u32),
    /// The exchange failed. It is not known whether its writes were executed.
    Failed {
        /// The kind of the error.
        kind: BusErrorKind,
        /// Number of accesses of the exchange.
        accesses: usize,
    },
}

impl fmt::Display for RecordedEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (nanos, address) = (self.at.as_nanos(), self.address);
        write!(f, "{}.{:02} host ", nanos / 1_000, nanos % 1_000 / 10)?;
        match self.event {
            RecordedEvent::Read(word) => write!(f, "read {address:#06X} {word:#010X}"),
            RecordedEvent::Written(word) => write!(f, "write {address:#06X} {word:#010X}"),
            RecordedEvent::Failed { kind, accesses } => {
                write!(f, "failed {address:#06X} ; {kind:?}, accesses={accesses}")
            }
        }
    }
}

impl<B> Recording<B> {
    /// Records the last `capacity` words that are transferred over `inner`.
    pub fn new(inner: B, capacity: usize) -> Self {
        Self {
            inner,
            entries: VecDeque::with_capacity(capacity),
            capacity,
            dropped: 0,
        }
    }

    /// Writes the log as text, oldest entry first.
    pub fn write_to(&self, mut out: impl io::Write) -> io::Result<()> {
        let (kept, dropped) = (self.entries.len(), self.dropped);
        writeln!(
            out,
            "# {kept} accesses, {dropped} earlier ones dropped; time in us"
        )?;
        for entry in &self.entries {
            writeln!(out, "{entry}")?;
        }
        Ok(())
    }

    fn push(&mut self, at: Instant, address: u16, event: RecordedEvent) {
        let is_full = self.entries.len() >= self.capacity;
        self.dropped.tally(is_full.into());
        if !is_full || self.entries.pop_front().is_some() {
            self.entries.push_back(RecordedEntry { at, address, event });
        }
    }
}

impl<B: RegisterBus + Clock> Recording<B> {
    /// Logs an exchange that has the given `result`, and returns that result.
    fn record<T>(
        &mut self,
        accesses: &[Access],
        words: &[u32],
        result: Result<T, B::Error>,
    ) -> Result<T, B::Error> {
        let at = self.inner.now();
        if let Err(error) = &result {
            let event = RecordedEvent::Failed {
                kind: error.kind(),
                accesses: accesses.len(),
            };
            self.push(at, accesses.first().map_or(0, |first| first.address), event);
            return result;
        }
        for access in accesses {
            let event = match access.direction {
                Direction::Read => RecordedEvent::Read,
                Direction::Write => RecordedEvent::Written,
            };
            let addresses = (access.address..=u16::MAX).step_by(4);
            let values = words.get(access.words()).unwrap_or_default();
            for (address, &value) in addresses.zip(values) {
                self.push(at, address, event(value));
            }
        }
        result
    }
}

/// The inner bus's clock provides the time stamps of the log.
impl<B: RegisterBus + Clock> RegisterBus for Recording<B> {
    type Error = B::Error;

    fn can_hold(&self) -> bool {
        self.inner.can_hold()
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), B::Error> {
        let result = self.inner.exchange(accesses, words);
        self.record(accesses, words, result)
    }

    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<AccessList, B::Error> {
        self.inner.prepare(accesses, hold)
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), B::Error> {
        let result = self.inner.start(list, words);
        result.or_else(|error| self.record(list.as_ref(), words, Err(error)))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, B::Error> {
        let result = self.inner.finish(list, words);
        self.record(list.as_ref(), words, result)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), B::Error> {
        let result = self.inner.write_all(accesses, words);
        self.record(accesses, words, result)
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        self.inner.set_cycle(period, deadline);
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, B::Error> {
        self.inner.board(effort)
    }

    fn statistics(&self) -> BusStatistics {
        self.inner.statistics()
    }
}

impl<B: Clock> Clock for Recording<B> {
    fn now(&mut self) -> Instant {
        self.inner.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.inner.wait(duration);
    }

    fn sleep(&mut self, duration: Duration) {
        self.inner.sleep(duration);
    }
}
