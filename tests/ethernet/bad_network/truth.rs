//! The true fate of the packets, from the simulator's own record.

use std::collections::BTreeSet;

use mesa_hal::bus::BusStatistics;

use crate::common::ethernet::{Sent, SimLink};

/// Time after which no packet is on its way any more: far longer than any delay of the network.
const ON_ITS_WAY: u64 = 100_000_000;

/// Knowledge about the writes that the driver can derive from the replies it has taken.
pub struct Truth {
    /// The first packet that counts.
    first: usize,
    /// The first packet that may still be on its way.
    recent: usize,
    /// Time at which the board executed the request whose reply was taken last.
    heard: u64,
    /// Writes that a reply has shown as missing.
    missing: BTreeSet<usize>,
    late: u64,
}

impl Truth {
    pub fn from(link: &SimLink) -> Self {
        Self {
            first: link.journal.len(),
            recent: link.journal.len(),
            heard: link.board.time(),
            missing: BTreeSet::new(),
            late: 0,
        }
    }

    /// The writes from packet `first` on, with their numbers.
    fn writes(link: &SimLink, first: usize) -> impl Iterator<Item = (usize, &Sent)> {
        let packets = link.journal.iter().enumerate().skip(first);
        packets.filter(|(_, sent)| sent.is_write)
    }

    /// Records that the reply to the newest request was taken. True if the board had executed,
    /// since the previous reply, exactly the writes that were sent since, its own included, in
    /// their order.
    pub fn heard(&mut self, link: &SimLink) -> bool {
        let newest = link.journal.iter().rposition(|sent| sent.is_request);
        let newest = newest.expect("a request was sent");
        let request = &link.journal[newest];
        let (_, now) = request.replies.first().expect("its reply was taken");
        let (before, now) = (self.heard, *now);
        self.heard = now;
        while link.journal[self.recent].at + ON_ITS_WAY < before {
            self.recent += 1;
        }
        let mut order: Vec<(u64, usize)> = Self::writes(link, self.recent)
            .flat_map(|(n, sent)| sent.executed.iter().map(move |&at| (at, n)))
            .filter(|(at, _)| *at <= now)
            .collect();
        order.sort_unstable();
        let since: Vec<usize> = order
            .iter()
            .filter(|(at, _)| *at > before)
            .map(|(_, n)| *n)
            .collect();
        let due: Vec<usize> = Self::writes(link, self.recent)
            .take_while(|(n, _)| *n <= newest)
            .filter(|(_, sent)| sent.executed.iter().all(|at| *at > before))
            .map(|(n, _)| n)
            .filter(|n| !self.missing.contains(n))
            .collect();
        for n in &since {
            self.late += u64::from(self.missing.remove(n));
        }
        let executed: BTreeSet<usize> = order.iter().map(|(_, n)| *n).collect();
        self.missing
            .extend(due.iter().filter(|n| !executed.contains(n)));
        // The last one was executed for the first time, and behind a newer one.
        let last = order.last().map(|(_, n)| *n);
        let is_behind = last
            .is_some_and(|last| due.contains(&last) && executed.iter().any(|other| *other > last));
        self.late += u64::from(is_behind);
        since == due
    }

    /// Compares all counts with the driver's statistics.
    pub fn check(&self, link: &SimLink, before: BusStatistics, after: BusStatistics, seed: u64) {
        let packets = &link.journal[self.first..];
        let requests = packets.iter().filter(|sent| sent.is_request);
        let (mut lost, mut duplicate) = (0, 0);
        for request in requests.clone() {
            lost += u64::from(request.replies.is_empty());
            duplicate += request.replies.len().saturating_sub(1) as u64;
        }
        let (mut lost_writes, mut repeated) = (0, 0);
        for (_, write) in Self::writes(link, self.first) {
            lost_writes += u64::from(write.executed.is_empty());
            // An answered write, such as a whole cycle, is detected by its second reply.
            let again = write.executed.len().saturating_sub(1) as u64;
            repeated += if write.is_request { 0 } else { again };
        }
        let answered = after.exchanges - before.exchanges;
        assert_eq!(answered, packets.len() as u64, "seed {seed}: packets");
        assert_eq!(after.lost - before.lost, lost, "seed {seed}: lost");
        assert_eq!(after.duplicate, duplicate, "seed {seed}: duplicate replies");
        assert_eq!(after.lost_writes, lost_writes, "seed {seed}: lost writes");
        assert_eq!(after.late_writes, self.late, "seed {seed}: late writes");
        assert_eq!(after.repeated_writes, repeated, "seed {seed}: repeated");
        let nothing = (
            after.unconfirmed_writes,
            after.foreign,
            after.short,
            after.stale,
        );
        assert_eq!(nothing, (0, 0, 0, 0), "seed {seed}");
        let each = [
            lost,
            after.late,
            duplicate,
            lost_writes,
            self.late,
            repeated,
        ];
        assert!(each.iter().all(|n| *n > 5), "seed {seed}: {each:?}");
    }
}
