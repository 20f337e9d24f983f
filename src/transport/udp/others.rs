//! Detects other senders of packets to the board, from the board's own packet count.
//!
//! Every reply contains the number of packets that the board has received. Packets beyond those
//! that this host sent come from other hosts, or arrived twice. The surplus is summed for a second,
//! and of each slot of 10 ms only a few packets count: a second master sends all the time, whereas
//! a program that inspects the board, or checks that it is free, sends in a burst.

use core::time::Duration;

use crate::bus::Instant;
use crate::tally::Tally;

/// Packets are summed over this time.
const WINDOW: Duration = Duration::from_secs(1);
/// Threshold: up to 50 counted packets in a window are tolerated, and as many in each second of a
/// longer interval without replies.
const THRESHOLD: u64 = 50;
/// Length of a slot in nanoseconds: 10 ms.
const SLOT_NANOS: u64 = 10_000_000;
/// Upper limit of the packets that count in a slot: a sender that reaches it all the time is
/// detected after a quarter of a second.
const MAX_PER_SLOT: u64 = 2;
/// Upper limit of the packets that count from one reply to the next. A board that was reset counts
/// from 0 again, which looks like an arbitrary number of packets, but happens only once.
const MAX_PER_REPLY: u64 = 8;
/// Duplicate packets assumed for each duplicate reply: duplicates of a write cause no reply, and
/// some replies are lost.
const PER_DUPLICATE: u64 = 4;

/// Contents of a reply that show packets of other senders.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReplyCounters {
    /// Time at which the request was sent.
    pub at: Instant,
    /// Packets that the board has received since the previous reply; `None` if not known.
    pub received: Option<u16>,
    /// Number of the request among all packets that were sent.
    pub sent: u64,
    /// Duplicate replies so far.
    pub duplicate: u64,
}

/// Sum of the packets of other senders.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Others {
    /// Start of this window, and the number of duplicate replies at that time.
    begun: Option<(Instant, u64)>,
    /// Number of packets sent up to the previous request.
    sent: u64,
    /// Slot of that request, and the surplus packets in it. Lost packets lower the sum.
    slot: (u64, i64),
    /// Counted packets of the earlier slots, limited for each slot.
    counted: i64,
    /// All surplus packets of the earlier slots.
    packets: i64,
    /// Already reported in this window.
    is_reported: bool,
}

impl Others {
    /// Adds the contents of a reply. Returns the number of foreign packets if they exceed the
    /// threshold, once in each window.
    pub(super) fn add(&mut self, counters: ReplyCounters) -> Option<u32> {
        let own = counters.sent.wrapping_sub(self.sent) as u16;
        self.sent = counters.sent;
        let slot = counters.at.as_nanos() / SLOT_NANOS;
        let Some(received) = counters.received.filter(|_| self.begun.is_some()) else {
            self.begin(counters, slot);
            return None;
        };
        let more = received.wrapping_sub(own).cast_signed();
        self.slot.1.tally(more.into());
        let passed = slot.wrapping_sub(self.slot.0);
        if passed == 0 {
            return None;
        }
        self.end_slot(counters, passed)
    }

    fn end_slot(&mut self, counters: ReplyCounters, passed: u64) -> Option<u32> {
        let (at, duplicate) = self.begun?;
        let (before, packets) = self.slot;
        let slot = before.wrapping_add(passed);
        self.slot = (slot, 0);
        let most = passed.saturating_mul(MAX_PER_SLOT).min(MAX_PER_REPLY);
        self.counted.tally(packets.min(most.cast_signed()));
        self.packets.tally(packets);
        let within = counters.at.since(at);
        let few = THRESHOLD.saturating_mul(within.max(WINDOW).as_secs());
        let duplicates = counters.duplicate.saturating_sub(duplicate);
        let few = few.saturating_add(PER_DUPLICATE.saturating_mul(duplicates));
        let is_news = !self.is_reported && u64::try_from(self.counted).is_ok_and(|n| n > few);
        let packets = u32::try_from(self.packets).unwrap_or(u32::MAX);
        self.is_reported |= is_news;
        if within >= WINDOW {
            self.begin(counters, slot);
        }
        is_news.then_some(packets)
    }

    fn begin(&mut self, counters: ReplyCounters, slot: u64) {
        *self = Self {
            begun: Some((counters.at, counters.duplicate)),
            sent: counters.sent,
            slot: (slot, 0),
            ..Self::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The packet count of a board, and the packets sent to it.
    #[derive(Default)]
    struct Board {
        others: Others,
        counters: u16,
        received: u16,
        sent: u64,
        duplicate: u64,
        now: u64,
    }

    impl Board {
        /// A cycle of 1 ms: a write and a request, and `more` packets in addition (or fewer, if
        /// negative).
        fn cycle(&mut self, more: i16) -> Option<u32> {
            self.now += 1_000_000;
            self.sent += 2;
            self.received = self.received.wrapping_add(2).wrapping_add_signed(more);
            self.reply(true)
        }

        fn reply(&mut self, is_known: bool) -> Option<u32> {
            let before = core::mem::replace(&mut self.counters, self.received);
            let counters = ReplyCounters {
                at: Instant::from_nanos(self.now),
                received: is_known.then(|| self.received.wrapping_sub(before)),
                sent: self.sent,
                duplicate: self.duplicate,
            };
            self.others.add(counters)
        }

        fn new(received: u16, sent: u64) -> Self {
            let mut board = Self {
                received,
                sent,
                ..Self::default()
            };
            assert_eq!(board.reply(false), None);
            board
        }
    }

    #[test]
    fn second_master_at_100_packets_per_s_is_detected_every_second() {
        for every in [1, 5, 10] {
            let mut board = Board::new(65_000, u64::from(u32::MAX) - 500);
            let noticed: Vec<_> = (0..3000)
                .filter_map(|n| board.cycle(i16::from(n % every == 0)))
                .collect();
            assert_eq!(noticed.len(), 3, "one in {every} ms");
            let expected = if every == 1 { 250..=270 } else { 51..=56 };
            let is_right = noticed.iter().all(|packets| expected.contains(packets));
            assert!(is_right, "one in {every} ms: {noticed:?}");
        }
        let mut board = Board::new(0, 0);
        assert!((0..10_000).all(|n| board.cycle(i16::from(n % 25 == 0)).is_none()));
    }

    #[test]
    fn short_burst_of_queries_is_not_a_second_master() {
        let mut board = Board::new(0, 0);
        // As `mesaflash --readhmid`, and ten times as many.
        assert!((0..10_000).all(|n| board.cycle(if n % 1000 < 12 { 15 } else { 0 }).is_none()));
        let flood = |n: u32| if n % 1000 < 200 { 9 } else { 0 };
        assert!((0..10_000).all(|n| board.cycle(flood(n)).is_none()));
    }

    #[test]
    fn pause_makes_no_difference() {
        let mut board = Board::new(0, 0);
        for _ in 0..10 {
            // Another host used the board in the meantime and has stopped.
            board.now += 60_000_000_000;
            board.received = board.received.wrapping_add(30_000);
            assert_eq!(board.cycle(0), None);
        }
    }

    proptest! {
        #[test]
        fn board_reset_is_not_taken_for_a_second_master(
            resets in prop::collection::vec((any::<u16>(), 0..400_u16), 1..30),
        ) {
            let mut board = Board::new(60_000, 0);
            for (received, cycles) in resets {
                // No board restarts faster.
                board.now += 200_000_000;
                board.received = received;
                prop_assert_eq!(board.cycle(0), None);
                for _ in 0..cycles {
                    prop_assert_eq!(board.cycle(0), None);
                }
            }
        }

        #[test]
        fn lost_late_or_duplicate_packets_are_not_a_second_master(
            first in any::<u16>(),
            loses in 0..8_u32, delays in 0..8_u32, doubles in 0..=8_u32,
            dice in prop::collection::vec(any::<[u32; 3]>(), 2500),
        ) {
            let mut board = Board::new(first, 0);
            let mut late = 0;
            for [lost, delayed, doubled] in dice {
                let mut more = core::mem::take(&mut late);
                // Of the two packets of a cycle the first is lost, or executed a cycle later.
                if lost % 8 < loses {
                    more -= 1;
                } else if delayed % 8 < delays {
                    more -= 1;
                    late += 1;
                }
                // Each of the two is duplicated independently.
                if doubled % 8 < doubles {
                    more += 1;
                }
                if doubled / 8 % 8 < doubles {
                    more += 1;
                    board.duplicate += 1;
                }
                prop_assert_eq!(board.cycle(more), None);
            }
        }
    }
}
