//! The rates that may be in force, and whether the accumulator follows them.

use crate::bus::{HORIZON, Instant};

/// Number of reads in which an accumulator may stand still although it has a rate: it waits for the
/// timers of a step for less than 1 ms, which a cycle of 20 us reads 50 times.
const STANDING_READS: u32 = 60;

/// The words of the writes since the last read. All are the same if there was none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SentRates {
    /// That of the write before.
    pub before: i32,
    pub first: i32,
    pub last: i32,
    /// Number of writes.
    writes: u32,
    /// Start of the first write of a board that is not set up: it and the next ones stop the
    /// generator, and do not restart the watchdog. They are no part of the others.
    pub stopped_at: Option<Instant>,
}

impl SentRates {
    /// There was one write at most.
    pub const fn is_one(&self) -> bool {
        self.writes <= 1
    }
}

/// The rate register of a generator.
#[derive(Clone, Copy, Debug)]
pub(super) struct RateRegister {
    /// The word that was put last.
    pub word: i32,
    /// The magnitude of the fastest rate that may have been in force since the last read.
    fastest: u32,
    /// The magnitudes of the fastest rates of this and the last [`HORIZON`] reads: a packet can be
    /// late by as much.
    recent: [u32; 2],
    /// Number of further reads of this one.
    left: u32,
    /// The last write was sent.
    has_arrived: bool,
    /// The words of the writes since the last read, except those that have failed.
    sent: SentRates,
    /// A write has failed since the last read: it may have been executed.
    has_failed: bool,
    /// Number of consecutive reads without a movement, at a rate at which there is one in each.
    standing: u32,
}

impl RateRegister {
    /// The rate 0 of the set-up.
    pub const fn new() -> Self {
        Self {
            word: 0,
            fastest: 0,
            recent: [0; 2],
            left: (HORIZON as u32).saturating_sub(1),
            has_arrived: true,
            sent: SentRates {
                before: 0,
                first: 0,
                last: 0,
                writes: 0,
                stopped_at: None,
            },
            has_failed: false,
            standing: 0,
        }
    }

    /// Takes the word of the next write.
    #[inline]
    pub fn put(&mut self, word: i32) {
        self.word = word;
        self.fastest = self.fastest.max(word.unsigned_abs());
        let [now, _] = &mut self.recent;
        *now = self.fastest.max(*now);
    }

    /// The next write is one of a board that is not set up.
    pub fn stop(&mut self, now: Instant) {
        let at = &mut self.sent.stopped_at;
        *at = at.or(Some(now));
    }

    /// Takes the outcome of a write.
    #[inline]
    pub fn written(&mut self, arrived: bool) {
        self.has_arrived = arrived;
        self.has_failed |= !arrived;
        let sent = &mut self.sent;
        if arrived && sent.stopped_at.is_none() {
            if sent.writes == 0 {
                sent.first = self.word;
            }
            sent.last = self.word;
            sent.writes = sent.writes.saturating_add(1);
        }
    }

    /// The words that were sent since the last read.
    pub const fn sent(&self) -> SentRates {
        self.sent
    }

    /// True if a write since the last read has failed.
    pub const fn has_failed(&self) -> bool {
        self.has_failed
    }

    /// True if the generator may have moved since the last read.
    pub const fn may_have_moved(&self) -> bool {
        self.fastest > 0
    }

    /// The fastest rate that may have been in force since the last read, in ticks for 2^32 steps.
    pub const fn fastest(&self) -> u32 {
        self.fastest
    }

    /// The fastest rate that a late packet may have brought into force since the last read.
    pub fn fastest_of_late(&self) -> u32 {
        let [now, before] = self.recent;
        self.fastest.max(now).max(before)
    }

    /// Takes a read. After a write in doubt, the rate of before may still be in force.
    #[inline]
    pub fn read(&mut self, certain: bool) {
        self.has_failed = false;
        if let Some(left) = self.left.checked_sub(1) {
            self.left = left;
        } else {
            let [now, _] = self.recent;
            (self.recent, self.left) = (
                [self.word.unsigned_abs(), now],
                (HORIZON as u32).saturating_sub(1),
            );
        }
        // It was not stopped: after that, the board is set up again, with a new register.
        let sent = &mut self.sent;
        (sent.before, sent.first, sent.writes) = (sent.last, sent.last, 0);
        let newest = self.word.unsigned_abs();
        self.fastest = if certain && self.has_arrived {
            newest
        } else {
            self.fastest.max(newest)
        };
    }

    /// Takes a movement of the accumulator. Returns true when it has stood still for too long at a
    /// rate of at least `visible`.
    #[inline]
    pub fn observe(&mut self, moved: i64, certain: bool, visible: u32) -> bool {
        if moved != 0 || self.word.unsigned_abs() < visible {
            if !self.stands() {
                self.standing = 0;
            }
            return false;
        }
        if !certain || self.stands() {
            return false;
        }
        self.standing = self.standing.saturating_add(1);
        self.stands()
    }

    /// True if the accumulator does not follow its rate: the generator stays off until it has been
    /// disabled.
    pub const fn stands(&self) -> bool {
        self.standing >= STANDING_READS
    }

    /// The application has disabled the generator.
    pub const fn disabled(&mut self) {
        self.standing = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn earlier_faster_rate_still_counts_after_a_doubtful_write() {
        let mut rate = RateRegister::new();
        rate.put(-900);
        rate.written(true);
        rate.read(true);
        rate.put(10);
        assert_eq!(rate.fastest(), 900);
        rate.written(false);
        rate.read(true);
        assert_eq!(rate.fastest(), 900, "not sent");
        rate.written(true);
        rate.read(false);
        assert_eq!(rate.fastest(), 900, "perhaps lost");
        rate.read(true);
        assert_eq!(rate.fastest(), 10);
    }

    #[test]
    fn late_packet_has_a_rate_of_the_last_hundred_reads() {
        let mut rate = RateRegister::new();
        for word in [5_000, 10] {
            rate.put(word);
            rate.written(true);
            rate.read(true);
        }
        assert_eq!((rate.fastest(), rate.fastest_of_late()), (10, 5_000));
        for _ in 0..HORIZON - 2 {
            rate.read(true);
            assert_eq!(rate.fastest_of_late(), 5_000);
        }
        for _ in 0..=HORIZON {
            rate.read(true);
        }
        assert_eq!(rate.fastest_of_late(), 10);
    }

    #[test]
    fn accumulator_that_does_not_follow_its_rate_is_found_once() {
        let mut rate = RateRegister::new();
        rate.put(1_000);
        for _ in 0..STANDING_READS - 1 {
            assert!(!rate.observe(0, true, 500));
        }
        assert!(!rate.observe(1, true, 500), "it moves");
        let found = (0..200).filter(|_| rate.observe(0, true, 500)).count();
        assert_eq!((found, rate.stands()), (1, true));
        rate.put(0);
        rate.observe(5, true, 500);
        assert!(rate.stands(), "until it is disabled");
        rate.disabled();
        assert!(!rate.stands());
        for _ in 0..200 {
            assert!(!rate.observe(0, true, 500), "slower than can be seen");
        }
    }
}
