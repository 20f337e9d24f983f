//! Events, and the queue from which the application takes them.

mod kind;
mod offline;
mod queue;
mod report;
mod row;
mod words;

pub use kind::{CorrectedValue, EventKind, EventMask, Positions, Repeating};
pub use offline::OfflineReason;
pub use queue::Events;
pub use report::{BoardState, CycleReport};

pub(crate) use queue::EventSink;
pub(crate) use row::EventRow;

use core::fmt;

use crate::advice::{Advice, WithAdvice};
use crate::bus::Instant;

/// An event of the cycle, with its time.
///
/// `Display` writes it as a sentence, with a remote as in the names of its pins: `cycle 5021,
/// 5.020113 s: 7i77.0.1: card offline, ...`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Event {
    /// Time of detection, on the clock of the bus.
    pub at: Instant,
    /// The cycle of detection: the number of the call of
    /// [`Driver::read`](crate::driver::Driver::read), from 1 on. 0 is before the first.
    pub cycle: u64,
    /// The kind of the event, with its data.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub kind: EventKind,
}

impl Event {
    /// The next step, if there is one: that of its kind.
    pub fn advice(&self) -> Option<Advice> {
        self.kind.advice()
    }

    /// Joins the event and the advice: `event; advice`.
    pub fn with_advice(&self) -> WithAdvice<'_> {
        WithAdvice::new(self, self.advice())
    }
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at, cycle, kind } = self;
        let micros = at.as_nanos() / 1000;
        let (seconds, micros) = (micros / 1_000_000, micros % 1_000_000);
        write!(f, "cycle {cycle}, {seconds}.{micros:06} s: {kind}")
    }
}

#[cfg(all(test, feature = "serde"))]
pub(crate) mod tests {
    use super::{Event, EventKind, Instant};

    pub fn event(at: Instant, cycle: u64, kind: EventKind) -> Event {
        Event { at, cycle, kind }
    }
}
