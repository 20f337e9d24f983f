//! A layer around a bus that keeps what went over it.

use alloc::collections::{VecDeque, vec_deque};
use core::fmt;

use super::register_map::RegisterMap;
use crate::bus::{
    Access, AccessList, BusError, BusErrorKind, BusLayer, ClockedBus, Direction, Instant, Reply,
};
use crate::hostmot2::HostMot2;
use crate::tally::Tally;

/// Keeps the last words that went over a bus, each with its time, register and value: what happened
/// before a fault.
///
/// ```
/// use mesa_hal::transport::{BusLog, RecordedEntry, Recording};
/// use mesa_hal::{Driver, Settings};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// // The last 5,000 words, 200 of them after the first exchange that fails.
/// let log = BusLog::new(5_000).freezing_on(RecordedEntry::is_fault, 200);
/// let bus = Recording::new(machines::i7i92_7i77(), log);
/// let mut driver = Driver::start(bus, Settings::default())?;
/// # for _ in 0..3 {
/// let _ = driver.read();
/// let _ = driver.write();
/// # }
/// let firmware = driver.firmware().clone();
/// let log = &mut driver.bus_mut().log;
/// if log.is_frozen() {
///     println!("{}", log.text(&firmware));
///     log.resume();
/// }
/// # Ok(())
/// # }
/// ```
///
/// # Real time
/// One clock reading for each exchange, and the cost of an entry for each word; nothing while the
/// log is frozen, or has no room. No allocation.
#[derive(Debug)]
pub struct Recording<B> {
    /// The inner bus.
    pub inner: B,
    /// What went over it.
    pub log: BusLog,
}

/// The last words that went over a bus, oldest first.
///
/// `Display` has the format of the host lines in the gateware transcripts: time in us, direction,
/// address, value; [`text`](Self::text) has the names of registers as well. When the log is full,
/// the oldest entries are dropped and counted.
///
/// # Real time
/// No function allocates but [`new`](Self::new).
#[derive(Clone, Debug)]
pub struct BusLog {
    entries: VecDeque<RecordedEntry>,
    capacity: usize,
    dropped: u64,
    trigger: Option<FreezeTrigger>,
    state: LogState,
}

/// What freezes a log.
#[derive(Clone, Copy, Debug)]
struct FreezeTrigger {
    is_met: fn(&RecordedEntry) -> bool,
    /// Number of entries after it.
    after: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LogState {
    Recording,
    /// Frozen after this number of further entries.
    Ending {
        left: usize,
        cause: RecordedEntry,
    },
    /// `None`: by a call.
    Frozen(Option<RecordedEntry>),
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
    /// A reply proved writes before it missing.
    LostWrites {
        /// Time at which the reply arrived.
        at: Instant,
        /// Number of writes.
        count: u32,
    },
}

impl RecordedEntry {
    /// The time of the entry, on the clock of the bus.
    pub const fn at(&self) -> Instant {
        let (Self::Read { at, .. }
        | Self::Written { at, .. }
        | Self::Failed { at, .. }
        | Self::LostWrites { at, .. }) = self;
        *at
    }

    /// True for a failed exchange (a reply that is late or missing is one), and for lost writes.
    pub fn is_fault(&self) -> bool {
        matches!(self, Self::Failed { .. } | Self::LostWrites { .. })
    }
}

impl fmt::Display for RecordedEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.at().as_nanos();
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
            Self::LostWrites { count, .. } => write!(f, "lost ; writes={count}"),
        }
    }
}

impl BusLog {
    /// A log with room for this number of entries: a word each. One without room is off, and costs
    /// nothing. All of its memory is written here, so that the cycle touches no new page.
    pub fn new(capacity: usize) -> Self {
        let unused = RecordedEntry::LostWrites {
            at: Instant::default(),
            count: 0,
        };
        let mut entries = VecDeque::with_capacity(capacity);
        entries.resize(capacity, unused);
        entries.clear();
        Self {
            entries,
            capacity,
            dropped: 0,
            trigger: None,
            state: LogState::Recording,
        }
    }

    /// Freezes the log `after` further entries when the first one comes for which `is_met` is true;
    /// with as many as there is room for, that entry is the first one of the log.
    #[must_use]
    pub fn freezing_on(self, is_met: fn(&RecordedEntry) -> bool, after: usize) -> Self {
        let after = after.min(self.capacity.saturating_sub(1));
        let trigger = Some(FreezeTrigger { is_met, after });
        Self { trigger, ..self }
    }

    /// The entries, oldest first.
    pub fn entries(&self) -> vec_deque::Iter<'_, RecordedEntry> {
        self.entries.iter()
    }

    /// Number of entries that were dropped for newer ones.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Records nothing more until [`resume`](Self::resume).
    pub fn freeze(&mut self) {
        self.state = match self.state {
            LogState::Recording => LogState::Frozen(None),
            LogState::Ending { cause, .. } => LogState::Frozen(Some(cause)),
            frozen @ LogState::Frozen(_) => frozen,
        };
    }

    /// True if nothing is recorded until [`resume`](Self::resume).
    pub const fn is_frozen(&self) -> bool {
        matches!(self.state, LogState::Frozen(_))
    }

    /// The entry that has frozen the log; `None` while it records, or after a call.
    pub const fn cause(&self) -> Option<RecordedEntry> {
        match self.state {
            LogState::Frozen(cause) => cause,
            LogState::Recording | LogState::Ending { .. } => None,
        }
    }

    /// Discards all entries, and records again.
    pub fn resume(&mut self) {
        self.entries.clear();
        (self.dropped, self.state) = (0, LogState::Recording);
    }

    /// The log with the names of the registers of this firmware.
    pub fn text<'a>(&'a self, firmware: &'a HostMot2) -> impl fmt::Display + 'a {
        LogText {
            log: self,
            firmware,
        }
    }

    const fn is_off(&self) -> bool {
        self.capacity == 0 || self.is_frozen()
    }

    fn push(&mut self, entry: RecordedEntry) {
        if self.is_off() {
            return;
        }
        if self.entries.len() >= self.capacity {
            self.entries.pop_front();
            self.dropped.tally(1);
        }
        self.entries.push_back(entry);
        let trigger = self.trigger.filter(|trigger| (trigger.is_met)(&entry));
        let is_met = trigger.filter(|_| self.state == LogState::Recording);
        let (left, cause) = match (self.state, is_met) {
            (LogState::Ending { left, cause }, _) => (left.saturating_sub(1), cause),
            (_, Some(trigger)) => (trigger.after, entry),
            _ => return,
        };
        self.state = if left == 0 {
            LogState::Frozen(Some(cause))
        } else {
            LogState::Ending { left, cause }
        };
    }

    fn heading(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kept, dropped) = (self.entries.len(), self.dropped);
        writeln!(
            f,
            "# {kept} entries, {dropped} earlier ones dropped; time in us"
        )?;
        match self.state {
            LogState::Frozen(Some(cause)) => writeln!(f, "# frozen after: {cause}"),
            LogState::Frozen(None) => f.write_str("# frozen by a call\n"),
            LogState::Recording | LogState::Ending { .. } => Ok(()),
        }
    }
}

impl fmt::Display for BusLog {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.heading(f)?;
        self.entries
            .iter()
            .try_for_each(|entry| writeln!(f, "{entry}"))
    }
}

/// A log with the names of registers.
struct LogText<'a> {
    log: &'a BusLog,
    firmware: &'a HostMot2,
}

impl fmt::Display for LogText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let map = RegisterMap::of(self.firmware);
        self.log.heading(f)?;
        for entry in &self.log.entries {
            write!(f, "{entry}")?;
            if let RecordedEntry::Read { address, .. } | RecordedEntry::Written { address, .. } =
                *entry
            {
                match map.name(address) {
                    Some(name) => write!(f, " ; {name}")?,
                    None => write!(f, " ; register {address:#06X}")?,
                }
            }
            if let RecordedEntry::Read { address, word, .. } = *entry
                && let Some(meaning) = map.meaning(address, word)
            {
                write!(f, ": {meaning}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

impl<B> Recording<B> {
    /// Records what goes over `inner` in this log.
    pub const fn new(inner: B, log: BusLog) -> Self {
        Self { inner, log }
    }
}

impl<B: ClockedBus> Recording<B> {
    /// Logs an exchange with the given `result`, and returns that result.
    fn record<T>(
        &mut self,
        accesses: &[Access],
        words: &[u32],
        result: Result<T, BusError>,
    ) -> Result<T, BusError> {
        if self.log.is_off() {
            return result;
        }
        let at = self.inner.now();
        if let Err(error) = &result {
            self.log.push(RecordedEntry::Failed {
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
                self.log.push(match access.direction {
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
        if let Ok(Reply {
            lost_writes: count @ 1..,
            ..
        }) = result
        {
            let at = self.inner.now();
            self.log.push(RecordedEntry::LostWrites { at, count });
        }
        self.record(list.as_ref(), words, result)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let result = self.inner.write_all(accesses, words);
        self.record(accesses, words, result)
    }
}
