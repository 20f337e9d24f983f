//! A bus around a bus that keeps a log of what was accessed.

use core::fmt;
use core::time::Duration;
use std::io;

use super::WrappedList;
use crate::bus::{
    Access, BusError, BusErrorKind, BusStatistics, Clock, Direction, Hold, Instant, RegisterBus,
    Reply,
};

/// Keeps the last accesses of a bus: when, where, and which value.
///
/// What it writes are the host lines of the gateware transcripts: time in us, direction, address,
/// value. The log has a fixed size; when it is full the oldest entries go, and are counted.
///
/// # Real time
/// Adds the cost of one log entry for each word and of one look at the clock. Allocates only when
/// it is made.
#[derive(Debug)]
pub struct Recording<B> {
    inner: B,
    log: Box<[Entry]>,
    next: usize,
    kept: usize,
    dropped: u64,
}

/// One line of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// When the exchange was over.
    pub at: Instant,
    /// What happened.
    pub event: Event,
}

/// What the log keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Event {
    /// One register was read or written.
    Word {
        /// Which way.
        direction: Direction,
        /// Which register.
        address: u16,
        /// The value.
        value: u32,
    },
    /// The exchange of the `accesses` accesses that begin at `address` failed. Whether its writes
    /// were executed is not known.
    Failed {
        /// What happened.
        kind: BusErrorKind,
        /// Number of accesses.
        accesses: usize,
        /// Address of the first.
        address: u16,
    },
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.at.as_nanos();
        write!(f, "{}.{:02} host ", nanos / 1_000, nanos % 1_000 / 10)?;
        match self.event {
            Event::Word {
                direction,
                address,
                value,
            } => {
                let verb = match direction {
                    Direction::Read => "read",
                    Direction::Write => "write",
                };
                write!(f, "{verb} {address:#06X} {value:#010X}")
            }
            Event::Failed {
                kind,
                accesses,
                address,
            } => write!(f, "failed {address:#06X} ; {kind:?}, accesses={accesses}"),
        }
    }
}

impl<B> Recording<B> {
    /// Records the last `capacity` words that go over `inner`.
    pub fn new(inner: B, capacity: usize) -> Self {
        let empty = Entry {
            at: Instant::default(),
            event: Event::Word {
                direction: Direction::Read,
                address: 0,
                value: 0,
            },
        };
        Self {
            inner,
            log: vec![empty; capacity].into_boxed_slice(),
            next: 0,
            kept: 0,
            dropped: 0,
        }
    }

    /// The log, oldest entry first.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        let (newer, older) = self.log.split_at(self.next.min(self.log.len()));
        let unused = self.log.len() - self.kept;
        // Before the log is full for the first time, what is behind `next` was never used.
        older.iter().chain(newer).skip(unused)
    }

    /// How many entries had to go for newer ones.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Forgets the log.
    pub fn clear(&mut self) {
        self.next = 0;
        self.kept = 0;
        self.dropped = 0;
    }

    /// Writes the log as text, oldest entry first.
    pub fn write_to(&self, mut out: impl io::Write) -> io::Result<()> {
        writeln!(
            out,
            "# {} accesses, {} earlier ones dropped; time in us",
            self.kept, self.dropped
        )?;
        for entry in self.entries() {
            writeln!(out, "{entry}")?;
        }
        Ok(())
    }

    /// The bus inside.
    pub fn inner(&mut self) -> &mut B {
        &mut self.inner
    }

    /// Stops recording.
    pub fn into_inner(self) -> B {
        self.inner
    }

    fn push(&mut self, entry: Entry) {
        if let Some(place) = self.log.get_mut(self.next) {
            *place = entry;
            self.next += 1;
            if self.next == self.log.len() {
                self.next = 0;
            }
        }
        if self.kept < self.log.len() {
            self.kept += 1;
        } else {
            self.dropped += 1;
        }
    }
}

impl<B: Clock> Recording<B> {
    fn record(&mut self, accesses: &[Access], words: &[u32], result: Result<(), BusErrorKind>) {
        let at = self.inner.now();
        if let Err(kind) = result {
            let event = Event::Failed {
                kind,
                accesses: accesses.len(),
                address: accesses.first().map_or(0, |access| access.address),
            };
            self.push(Entry { at, event });
            return;
        }
        for access in accesses {
            let values = words.get(access.words()).unwrap_or_default();
            for (n, &value) in (0u16..).zip(values) {
                let event = Event::Word {
                    direction: access.direction,
                    address: access.address.wrapping_add(n.wrapping_mul(4)),
                    value,
                };
                self.push(Entry { at, event });
            }
        }
    }
}

/// The clock gives the log its times.
impl<B: RegisterBus + Clock> RegisterBus for Recording<B> {
    type Error = B::Error;
    type List = WrappedList<B::List>;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), B::Error> {
        let result = self.inner.exchange(accesses, words);
        let outcome = result.as_ref().map(|&()| ()).map_err(BusError::kind);
        self.record(accesses, words, outcome);
        result
    }

    fn prepare(&mut self, accesses: &[Access], hold: Option<Hold>) -> Result<Self::List, B::Error> {
        let inner = self.inner.prepare(accesses, hold)?;
        Ok(WrappedList::new(accesses, inner))
    }

    fn start(&mut self, list: &Self::List, words: &[u32]) -> Result<(), B::Error> {
        let result = self.inner.start(&list.inner, words);
        if let Err(error) = &result {
            self.record(&list.accesses, words, Err(error.kind()));
        }
        result
    }

    fn finish(&mut self, list: &Self::List, words: &mut [u32]) -> Result<Reply, B::Error> {
        let result = self.inner.finish(&list.inner, words);
        let outcome = result.as_ref().map(|_| ()).map_err(BusError::kind);
        self.record(&list.accesses, words, outcome);
        result
    }

    fn write_some(
        &mut self,
        accesses: &[Access],
        wanted: &[bool],
        words: &mut [u32],
    ) -> Result<(), B::Error> {
        let result = self.inner.write_some(accesses, wanted, words);
        if let Err(error) = &result {
            self.record(accesses, words, Err(error.kind()));
            return result;
        }
        for (access, _) in accesses.iter().zip(wanted).filter(|(_, wanted)| **wanted) {
            self.record(core::slice::from_ref(access), words, Ok(()));
        }
        result
    }

    fn can_hold(&self) -> bool {
        self.inner.can_hold()
    }

    fn set_cycle_deadline(&mut self, deadline: Duration) {
        self.inner.set_cycle_deadline(deadline);
    }

    fn follow_period(&mut self, period: Duration) {
        self.inner.follow_period(period);
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
}

#[cfg(test)]
mod tests {
    use super::super::test_bus::{Memory, MemoryError};
    use super::*;
    use proptest::prelude::*;

    fn text<B: RegisterBus>(bus: &Recording<B>) -> String {
        let mut out = Vec::new();
        bus.write_to(&mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn every_word_is_logged_with_time_and_value() {
        let mut bus = Recording::new(Memory::default(), 10);
        bus.write(0x5A00, 0x4000).unwrap();
        bus.wait(Duration::from_micros(10));
        let mut words = [0x11, 0, 0];
        let list = bus
            .prepare(
                &[Access::write(0x5A04, 0, 1), Access::read(0x5A00, 1, 2)],
                None,
            )
            .unwrap();
        let _ = bus.run(&list, &mut words).unwrap();
        assert_eq!(
            text(&bus),
            "# 4 accesses, 0 earlier ones dropped; time in us\n\
             1.00 host write 0x5A00 0x00004000\n\
             12.00 host write 0x5A04 0x00000011\n\
             12.00 host read 0x5A00 0x00004000\n\
             12.00 host read 0x5A04 0x00000011\n"
        );
    }

    #[test]
    fn a_list_is_logged_when_its_reply_is_taken() {
        let mut bus = Recording::new(Memory::default(), 10);
        let list = bus.prepare(&[Access::read(0x1000, 0, 1)], None).unwrap();
        bus.start(&list, &[0]).unwrap();
        assert_eq!((bus.inner().started, bus.entries().count()), (1, 0));
        let reply = bus.finish(&list, &mut [0]).unwrap();
        assert!(text(&bus).ends_with("1.00 host read 0x1000 0x00000000\n"));
        assert_eq!(reply.slack, Some(Duration::from_micros(5)));
    }

    #[test]
    fn a_failed_exchange_is_one_line_and_passed_on() {
        let mut bus = Recording::new(Memory::default(), 10);
        bus.inner().fail_next = true;
        assert_eq!(bus.read(0x0100), Err(MemoryError));
        assert!(text(&bus).ends_with("1.00 host failed 0x0100 ; Device, accesses=1\n"));
    }

    #[test]
    fn a_log_without_room_records_nothing_and_counts() {
        let mut bus = Recording::new(Memory::default(), 0);
        bus.read(0).unwrap();
        assert_eq!((bus.entries().count(), bus.dropped()), (0, 1));
        bus.clear();
        assert_eq!(bus.dropped(), 0);
    }

    proptest! {
        #[test]
        fn the_log_keeps_the_last_words_in_order(capacity in 0usize..20, total in 0u32..60) {
            let mut bus = Recording::new(Memory::default(), capacity);
            for value in 0..total {
                bus.write(0x1000, value).unwrap();
            }
            let kept: Vec<_> = bus
                .entries()
                .map(|entry| match entry.event {
                    Event::Word { value, .. } => value,
                    Event::Failed { .. } => u32::MAX,
                })
                .collect();
            let first = total.saturating_sub(capacity as u32);
            prop_assert_eq!(kept, (first..total).collect::<Vec<_>>());
            prop_assert_eq!(bus.dropped(), u64::from(first));
        }
    }
}
