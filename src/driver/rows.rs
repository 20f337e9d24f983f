//! Rows of events that may happen in every cycle.

use crate::bus::Instant;
use crate::events::{EventRow, EventSink};

use super::Repeating;

/// One row for each kind.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EventRows {
    pub failed_reads: EventRow,
    pub failed_writes: EventRow,
    pub lost_writes: EventRow,
    pub missed_periods: EventRow,
    pub foreign_packets: EventRow,
}

impl EventRows {
    #[inline]
    fn each(&mut self, mut with: impl FnMut(&mut EventRow, Repeating)) {
        with(&mut self.failed_reads, Repeating::FailedReads);
        with(&mut self.failed_writes, Repeating::FailedWrites);
        with(&mut self.lost_writes, Repeating::LostWrites);
        with(&mut self.missed_periods, Repeating::MissedPeriods);
        with(&mut self.foreign_packets, Repeating::OtherMaster);
    }

    /// Ends the rows without new events for long enough.
    #[inline]
    pub fn look(&mut self, sink: &EventSink, now: Instant) {
        self.each(|row, what| row.look(sink, now, what));
    }

    /// Ends all rows.
    pub fn end(&mut self, sink: &EventSink, now: Instant) {
        self.each(|row, what| row.end(sink, now, what));
    }
}
