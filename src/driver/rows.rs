//! Rows of events that may happen in every cycle.

use crate::bus::Instant;
use crate::modules::events::{Row, Sink};

use super::Repeating;

/// One row for each kind.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rows {
    pub failed_reads: Row,
    pub failed_writes: Row,
    pub lost_writes: Row,
    pub missed_periods: Row,
    pub others: Row,
}

impl Rows {
    fn each(&mut self) -> [(&mut Row, Repeating); 5] {
        [
            (&mut self.failed_reads, Repeating::FailedReads),
            (&mut self.failed_writes, Repeating::FailedWrites),
            (&mut self.lost_writes, Repeating::LostWrites),
            (&mut self.missed_periods, Repeating::MissedPeriods),
            (&mut self.others, Repeating::OtherMaster),
        ]
    }

    /// Ends the rows without new events for long enough.
    #[inline]
    pub fn look(&mut self, sink: &Sink, now: Instant) {
        for (row, what) in self.each() {
            row.look(sink, now, what);
        }
    }

    /// Ends all rows.
    pub fn end(&mut self, sink: &Sink, now: Instant) {
        for (row, what) in self.each() {
            row.end(sink, now, what);
        }
    }
}
