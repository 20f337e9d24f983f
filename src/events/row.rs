//! Rows of repeated events: the first one is reported, and at the end of the row their number.

use core::time::Duration;

use super::{EventKind, EventSink, Repeating};
use crate::bus::Instant;

/// A row ends when nothing has been added for this time. A network that loses a packet in a
/// thousand gives one row, and not the log of a whole night; the end of a fault is still reported
/// soon.
const QUIET_TIME: Duration = Duration::from_secs(10);

/// A row, open or closed.
///
/// # Real time
/// Constant time. No allocation.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EventRow {
    /// Number of events so far; 0 if the row is closed.
    count: u32,
    /// Number of those that were reported one by one.
    reported: u32,
    /// The reasons that were reported, by their bits.
    reasons: u32,
    first: Instant,
    last: Instant,
}

impl EventRow {
    /// Adds `count` events of a cycle. Reports them if they are the first with their reason.
    #[cold]
    pub fn add(&mut self, sink: &EventSink, now: Instant, count: u32, kind: EventKind) {
        if self.count == 0 {
            self.first = now;
        }
        self.last = now;
        self.count = self.count.saturating_add(count);
        let reason = 1 << (kind.reason() % u32::BITS);
        if self.reasons & reason == 0 {
            self.reasons |= reason;
            self.reported = self.reported.saturating_add(count);
            sink.report(now, kind);
        }
    }

    pub const fn is_open(&self) -> bool {
        self.count > 0
    }

    /// Ends the row if nothing was added for long enough.
    #[inline]
    pub fn look(&mut self, sink: &EventSink, now: Instant, what: Repeating) {
        if self.is_open() && now.since(self.last) >= QUIET_TIME {
            self.end(sink, now, what);
        }
    }

    /// Ends the row, and reports the number of its events unless all of them were reported.
    #[cold]
    pub fn end(&mut self, sink: &EventSink, now: Instant, what: Repeating) {
        let row = core::mem::take(self);
        if row.count > row.reported {
            let millis = row.last.since(row.first).as_millis();
            let lasted = Duration::from_millis(u32::try_from(millis).unwrap_or(u32::MAX).into());
            let count = row.count;
            let kind = EventKind::Repeated {
                what,
                count,
                lasted,
            };
            sink.report(now, kind);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::BusErrorKind::{Late, Lost};
    use alloc::vec::Vec;

    fn failed(why: crate::bus::BusErrorKind) -> EventKind {
        EventKind::ReadFailed { why }
    }

    fn at(millis: u64) -> Instant {
        Instant::from_nanos(millis * 1_000_000)
    }

    fn reported(sink: &EventSink) -> Vec<EventKind> {
        sink.events().map(|event| event.kind).collect()
    }

    #[test]
    fn row_is_reported_once_for_each_reason_and_counted_at_its_end() {
        let (sink, mut row) = (EventSink::new("", 31), EventRow::default());
        for millis in 0..5000 {
            let why = if millis % 2 == 0 { Lost } else { Late };
            row.add(&sink, at(millis), 1, failed(why));
            row.look(&sink, at(millis), Repeating::FailedReads);
        }
        assert_eq!(reported(&sink), [failed(Lost), failed(Late)]);
        row.look(&sink, at(14_998), Repeating::FailedReads);
        assert_eq!(reported(&sink), []);
        row.look(&sink, at(14_999), Repeating::FailedReads);
        let kind = EventKind::Repeated {
            what: Repeating::FailedReads,
            count: 5000,
            lasted: Duration::from_millis(4999),
        };
        assert_eq!(reported(&sink), [kind]);
        assert_eq!(
            alloc::string::ToString::to_string(&kind),
            "5000 failed reads within 4.999 s"
        );
        row.look(&sink, at(99_999), Repeating::FailedReads);
        assert_eq!(reported(&sink), []);
        row.add(&sink, at(100_000), 1, failed(Late));
        assert_eq!(reported(&sink), [failed(Late)], "another row");
    }

    #[test]
    fn end_of_a_fully_reported_row_is_not_reported() {
        let (sink, mut row) = (EventSink::new("", 31), EventRow::default());
        let lost = EventKind::LostWrites { count: 3 };
        row.add(&sink, at(1), 3, lost);
        row.end(&sink, at(2), Repeating::LostWrites);
        assert_eq!(reported(&sink), [lost]);
        assert!(!row.is_open());
        row.end(&sink, at(3), Repeating::LostWrites);
        assert_eq!(reported(&sink), []);
    }
}
