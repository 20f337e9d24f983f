//! The words of the last cycles, written and read, kept for later inspection.

mod names;
mod text;

use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;
use core::fmt;

use super::{Event, TraceSettings};
use crate::bus::{BusErrorKind, Exchanges, Instant, Words};
use crate::bus::{CycleRegister, WordDirection};
use crate::events::EventSink;
use crate::hostmot2::HostMot2;

/// The words written and read in the last cycles: see [`Settings::trace`](super::Settings::trace).
///
/// `Display` is meant for people and prints the words that have changed; [`csv`](Self::csv) is
/// meant for programs and prints a line for each cycle.
#[derive(Debug)]
pub struct Trace {
    /// Prefix of the names of the board's pins.
    board: String,
    settings: TraceSettings,
    /// The registers, in the order of the words of a cycle.
    columns: Vec<TraceColumn>,
    /// Number of registers that are read; they come first.
    read: usize,
    /// A ring: the row at [`next`](Self::next) is the oldest if the ring is full.
    rows: Box<[TraceRow]>,
    words: Box<[u32]>,
    next: usize,
    is_full: bool,
    /// The cycle of the row `next` has been read, and not yet written.
    is_open: bool,
    state: TraceState,
    sink: EventSink,
}

/// A register of the cycle.
#[derive(Clone, Debug)]
struct TraceColumn {
    exchanged: CycleRegister,
    name: Box<str>,
}

/// Outcome of a cycle.
#[derive(Clone, Copy, Debug, Default)]
struct TraceRow {
    cycle: u64,
    read_at: Instant,
    read: TraceOutcome,
    written_at: Instant,
    write: TraceOutcome,
}

/// Outcome of an exchange.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum TraceOutcome {
    #[default]
    NotTried,
    Done,
    Failed(BusErrorKind),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TraceState {
    Recording,
    /// Stops after this number of further cycles.
    Ending(u16, TraceCause),
    Frozen(TraceCause),
}

/// Reason why a trace was frozen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TraceCause {
    /// A request of the application.
    Asked,
    /// An event.
    Event(Event),
}

impl fmt::Display for TraceCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Asked => f.write_str("the application asked for it"),
            Self::Event(event) => event.fmt(f),
        }
    }
}

impl Trace {
    /// Makes a trace for the cycles of these exchanges.
    pub(super) fn new(
        settings: TraceSettings,
        exchanges: &Exchanges,
        board: &str,
        firmware: &HostMot2,
        sink: &EventSink,
    ) -> Self {
        let column = |exchanged: CycleRegister| TraceColumn {
            name: names::name(firmware, exchanged.address).into(),
            exchanged,
        };
        let columns: Vec<_> = exchanges.exchanged().into_iter().map(column).collect();
        let is_read = |column: &&TraceColumn| column.exchanged.way == WordDirection::Read;
        let cycles = usize::from(settings.cycles);
        let trace = Self {
            board: board.into(),
            settings,
            read: columns.iter().take_while(is_read).count(),
            words: vec![0; cycles.saturating_mul(columns.len())].into(),
            columns,
            rows: vec![TraceRow::default(); cycles].into(),
            next: 0,
            is_full: false,
            is_open: false,
            state: TraceState::Recording,
            sink: sink.clone(),
        };
        sink.watch(settings.freeze_on);
        trace
    }

    /// Records a cycle's read, after its end.
    pub(super) fn read(
        &mut self,
        cycle: u64,
        at: Instant,
        failed: Option<BusErrorKind>,
        words: &Words,
    ) {
        if matches!(self.state, TraceState::Frozen(_)) {
            return;
        }
        debug_assert!(self.next < self.rows.len(), "no row {}", self.next);
        if let Some(row) = self.rows.get_mut(self.next) {
            *row = TraceRow {
                cycle,
                read_at: at,
                read: failed.into(),
                ..TraceRow::default()
            };
        }
        self.is_open = true;
        self.copy(WordDirection::Read, words);
        self.notice();
    }

    /// Records a cycle's write, which ends the cycle.
    pub(super) fn written(
        &mut self,
        cycle: u64,
        at: Instant,
        failed: Option<BusErrorKind>,
        words: &Words,
    ) {
        if matches!(self.state, TraceState::Frozen(_)) {
            return;
        }
        let has_read = core::mem::take(&mut self.is_open);
        if let Some(row) = self.rows.get_mut(self.next) {
            if !has_read {
                *row = TraceRow {
                    cycle,
                    ..TraceRow::default()
                };
            }
            (row.written_at, row.write) = (at, failed.into());
        }
        self.copy(WordDirection::Write, words);
        self.notice();
        self.next = self.next.saturating_add(1);
        if self.next >= self.rows.len() {
            (self.next, self.is_full) = (0, true);
        }
        self.state = match self.state {
            TraceState::Ending(0, cause) => TraceState::Frozen(cause),
            TraceState::Ending(left, cause) => TraceState::Ending(left.saturating_sub(1), cause),
            other => other,
        };
    }

    fn copy(&mut self, way: WordDirection, words: &Words) {
        let width = self.columns.len();
        let range = match way {
            WordDirection::Read => 0..self.read,
            _ => self.read..width,
        };
        let mut rows = self.words.chunks_exact_mut(width.max(1));
        let places = self.columns.get(range.clone()).unwrap_or_default();
        let row = rows.nth(self.next).and_then(|row| row.get_mut(range));
        debug_assert!(row.is_some(), "no row {}", self.next);
        for (word, column) in row.unwrap_or_default().iter_mut().zip(places) {
            *word = words.at(column.exchanged);
        }
    }

    /// Begins to stop if a watched event has happened.
    fn notice(&mut self) {
        if self.state == TraceState::Recording
            && let Some(event) = self.sink.caught()
        {
            self.state = TraceState::Ending(self.settings.after, TraceCause::Event(event));
        }
    }

    pub(super) fn freeze(&mut self) {
        if self.state == TraceState::Recording {
            self.state = TraceState::Frozen(TraceCause::Asked);
        }
    }

    /// Discards all rows and records again.
    pub(super) fn resume(&mut self) {
        (self.next, self.is_full, self.state) = (0, false, TraceState::Recording);
        self.is_open = false;
        self.sink.watch(self.settings.freeze_on);
    }

    /// The reason why the trace is frozen; `None` while it records.
    pub fn cause(&self) -> Option<TraceCause> {
        match self.state {
            TraceState::Frozen(cause) => Some(cause),
            _ => None,
        }
    }

    /// Number of recorded cycles.
    pub fn cycles(&self) -> usize {
        if self.is_full {
            self.rows.len()
        } else {
            self.ahead()
        }
    }

    /// Index of the row that will be overwritten next: the one after a cycle that has been read and
    /// not yet written.
    fn ahead(&self) -> usize {
        self.next.saturating_add(self.is_open.into())
    }

    /// A table with a line of names, then a line for each cycle, oldest first. Times are in
    /// nanoseconds on the clock of the bus, words in hexadecimal.
    pub fn csv(&self) -> impl fmt::Display + '_ {
        text::Csv(self)
    }

    /// The cycles with their words, oldest first.
    fn in_order(&self) -> impl Iterator<Item = (&TraceRow, &[u32])> {
        let width = self.columns.len().max(1);
        let all = self.rows.iter().zip(self.words.chunks(width));
        let first = if self.is_full { self.ahead() } else { 0 };
        let count = self.cycles();
        all.clone().skip(first).chain(all.take(first)).take(count)
    }

    /// True if the driver with this sink made the trace.
    pub(super) fn is_of(&self, sink: &EventSink) -> bool {
        self.sink.is_same(sink)
    }
}

impl From<Option<BusErrorKind>> for TraceOutcome {
    fn from(failed: Option<BusErrorKind>) -> Self {
        failed.map_or(Self::Done, Self::Failed)
    }
}
