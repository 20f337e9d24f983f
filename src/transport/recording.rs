//! A bus wrapper that logs accesses.

use alloc::collections::VecDeque;
use core::fmt;

use crate::bus::{
    Access, AccessList, BusError, BusErrorKind, BusLayer, ClockedBus, Direction, Instant, Reply,
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
pub enum RecordedEntry {
    /// A register was read.
    Read {
        /// Time at which the exchange ended.
        at: Instant,
        /// The register.
        address: u16,
        /// Its word.
        word: u32,
    },
    /// A register was written.
    Written {
        /// Time at which the exchange ended.
        at: Instant,
        /// The register.
        address: u16,
        /// The word.
        word: u32,
    },
    /// An exchange failed. It is not known whether its writes were executed.
    Failed {
        /// Time at which the exchange ended.
        at: Instant,
        /// The register of its first access.
        address: u16,
        /// The kind of the error.
        kind: BusErrorKind,
        /// Number of accesses of the exchange.
        accesses: usize,
    },
}

impl fmt::Display for RecordedEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Read { at, .. } | Self::Written { at, .. } | Self::Failed { at, .. }) = self;
        let nanos = at.as_nanos();
        write!(f, "{}.{:02} host ", nanos / 1_000, nanos % 1_000 / 10)?;
        match self {
            Self::Read { address, word, .. } => write!(f, "read {address:#06X} {word:#010X}"),
            Self::Written { address, word, .. } => write!(f, "write {address:#06X} {word:#010X}"),
            Self::Failed {
                address,
                kind,
                accesses,
                ..
            } => write!(f, "failed {address:#06X} ; {kind:?}, accesses={accesses}"),
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
    #[cfg(feature = "std")]
    pub fn write_to(&self, mut out: impl std::io::Write) -> std::io::Result<()> {
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

    fn push(&mut self, entry: RecordedEntry) {
        let is_full = self.entries.len() >= self.capacity;
        self.dropped.tally(is_full.into());
        if !is_full || self.entries.pop_front().is_some() {
            self.entries.push_back(entry);
        }
    }
}

impl<B: ClockedBus> Recording<B> {
    /// Logs an exchange that has the given `result`, and returns that result.
    fn record<T>(
        &mut self,
        accesses: &[Access],
        words: &[u32],
        result: Result<T, BusError>,
    ) -> Result<T, BusError> {
        let at = self.inner.now();
        if let Err(error) = &result {
            self.push(RecordedEntry::Failed {
                at,
                address: accesses.first().map_or(0, |first| first.address),
                kind: error.kind(),
                accesses: accesses.len(),
            });
            return result;
        }
        for access in accesses {
            let addresses = (access.address..=u16::MAX).step_by(4);
            let values = words.get(access.words()).unwrap_or_default();
            for (address, &word) in addresses.zip(values) {
                self.push(match access.direction {
                    Direction::Read => RecordedEntry::Read { at, address, word },
                    Direction::Write => RecordedEntry::Written { at, address, word },
                });
            }
        }
        result
    }
}

/// The inner bus's clock provides the time stamps of the log.
impl<B: ClockedBus> BusLayer for Recording<B> {
    type Inner = B;

    fn inner(&self) -> &B {
        &self.inner
    }

    fn inner_mut(&mut self) -> &mut B {
        &mut self.inner
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let result = self.inner.exchange(accesses, words);
        self.record(accesses, words, result)
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        let result = self.inner.start(list, words);
        result.or_else(|error| self.record(list.as_ref(), words, Err(error)))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        let result = self.inner.finish(list, words);
        self.record(list.as_ref(), words, result)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let result = self.inner.write_all(accesses, words);
        self.record(accesses, words, result)
    }
}
