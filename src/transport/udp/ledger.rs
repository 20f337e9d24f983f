//! What became of the packets sent, by the board's own account.
//!
//! A packet that only writes is not answered. So every write leaves its number in the board: in
//! one register, which tells the last write that was executed, and in one of [`SLOTS`] others,
//! which tell of the last few whether they were executed at all. A write that is a whole cycle is
//! acknowledged by its own reply, and leaves the first out. What came twice shows in
//! the board's own counts of packets (manual: 7I97, "MEMORY SPACE 6 LAYOUT").
//!
//! A reply usually brings the last number and the count of packets received. That explains
//! everything when one write and this request were sent since the reply before; when it does not,
//! the next request asks for the rest ([`Ledger::wants_details`]).

use core::cmp::Reverse;

use crate::tally::Tally;

/// Registers that writes leave their numbers in, each in another one.
pub(super) const SLOTS: usize = 5;

/// How many past writes are remembered.
const REMEMBERED: u32 = 64;

/// For this many writes a lost one keeps its register, in case that it comes late.
const KEPT: u32 = 16;

/// The board's account, as a reply brings it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Account {
    /// Number of the last write that was executed, of those that leave it; `None` in the reply to
    /// one that does not: it is the last itself.
    pub last_write: Option<u16>,
    /// RXUDPCount, this request included.
    pub received: u16,
    pub details: Option<Details>,
}

/// What is asked for when the rest leaves something open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Details {
    /// The last write of each register that was executed.
    pub slots: [u16; SLOTS],
    /// TXUDPCount, this reply not included.
    pub sent: u16,
}

/// What an account said that was not known before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct News {
    /// Writes that the board has not executed.
    pub lost: u32,
    /// Writes that were said lost, and were executed since.
    pub found: u32,
    /// Those, and writes that came after a newer one.
    pub late: u32,
    /// Executions of writes that were executed before.
    pub repeated: u32,
    /// Writes of which nobody can tell any more.
    pub unconfirmed: u32,
    /// It is not certain that the newest write before the request was the last executed, and that
    /// nothing else was since the account before.
    pub doubt: bool,
}

/// What had been sent when a request was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Asked {
    /// Number of the newest write.
    newest: u32,
    /// Number that the register of the last write is to hold.
    last: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// Never sent, or forgotten.
    Unknown,
    Underway,
    /// Said lost.
    Missing,
    Executed,
}

#[derive(Clone, Copy, Debug)]
struct Write {
    fate: Fate,
    kind: Kind,
    slot: usize,
}

/// What tells that a write was executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It is not answered: the reply to the next request.
    Alone,
    /// An exchange of set-up: its own reply, or another's.
    Acknowledged,
    /// A whole cycle: its own reply. It does not say that it was the last.
    Cycle,
}

/// The writes sent lately, and what the board said of them.
#[derive(Clone, Debug)]
pub(super) struct Ledger {
    /// Number of the newest write.
    newest: u32,
    /// Number that the register of the last write is to hold.
    newest_last: u32,
    /// After the write of this number, an older cycle may have been executed, which does not say
    /// that it was the last.
    overtaken: Option<u32>,
    has_cycles: bool,
    /// Number of the newest write before those in flight.
    settled: u32,
    writes: [Write; REMEMBERED as usize],
    /// The last write of each register.
    owners: [u32; SLOTS],
    /// Writes that were still in flight when they were forgotten.
    forgotten: u32,
    /// Requests since the last account.
    requests: u32,
    /// RXUDPCount of the last account.
    pub(super) received: Option<u16>,
    /// RXUDPCount less TXUDPCount less the executions that are accounted for: it grows when a
    /// packet is executed that nobody answered and nobody knows.
    unaccounted: Option<u16>,
    /// Executions accounted for since the last details.
    executions: u16,
    is_open: bool,
}

impl Ledger {
    /// No write yet; the first will have the number after `newest`.
    pub(super) fn starting_after(newest: u32) -> Self {
        let unknown = Write {
            fate: Fate::Unknown,
            kind: Kind::Alone,
            slot: 0,
        };
        Self {
            newest,
            newest_last: newest,
            overtaken: None,
            has_cycles: false,
            settled: newest,
            writes: [unknown; REMEMBERED as usize],
            owners: [newest; SLOTS],
            forgotten: 0,
            requests: 0,
            received: None,
            unaccounted: None,
            executions: 0,
            is_open: true,
        }
    }

    /// A write is sent: its number, and which register it leaves that in.
    pub(super) fn open_write(&mut self, kind: Kind) -> (u32, usize) {
        self.newest = self.newest.wrapping_add(1);
        if kind == Kind::Cycle {
            self.has_cycles = true;
        } else {
            self.newest_last = self.newest;
        }
        if self.underway() > REMEMBERED {
            self.settled = self.settled.wrapping_add(1);
            // Its place is the new one's.
            let is_open = self.fate(self.newest) == Fate::Underway;
            self.forgotten.tally(is_open.into());
        }
        let slot = self.choose_slot();
        if let Some(place) = self.writes.get_mut((self.newest % REMEMBERED) as usize) {
            let fate = Fate::Underway;
            *place = Write { fate, kind, slot };
        }
        (self.newest, slot)
    }

    /// The register that is needed least: whose write is settled, then lost and hardly to come,
    /// then in flight; of those the oldest.
    fn choose_slot(&mut self) -> usize {
        let need = |owner: u32| match self.fate(owner) {
            Fate::Underway => 2,
            Fate::Missing if self.age(owner) <= KEPT => 1,
            _ => 0,
        };
        let rank = |owner: u32| (need(owner), Reverse(self.age(owner)));
        let ranked = self.owners.map(rank);
        let least = ranked.iter().min().copied();
        let slot = ranked.iter().position(|rank| Some(*rank) == least);
        let slot = slot.unwrap_or(0);
        if let Some(owner) = self.owners.get_mut(slot) {
            *owner = self.newest;
        }
        slot
    }

    /// A request is sent: what its reply tells of.
    pub(super) fn open_request(&mut self) -> Asked {
        self.requests = self.requests.saturating_add(1);
        Asked {
            newest: self.newest,
            last: self.newest_last,
        }
    }

    /// A packet of somebody's own commands is sent, whose effect on the counts is not known.
    pub(super) fn lose_count(&mut self) {
        self.received = None;
        self.unaccounted = None;
        self.is_open = true;
    }

    /// Whether the request that is sent now must bring the details.
    pub(super) fn wants_details(&self) -> bool {
        self.is_open || self.requests > 1 || self.underway() > 1
    }

    /// Whether the newest write was executed, as far as the last account tells.
    pub(super) fn is_executed(&self) -> bool {
        self.fate(self.newest) == Fate::Executed
    }

    /// Takes what the reply to a request brought; `asked` is what [`open_request`] gave for it.
    ///
    /// [`open_request`]: Self::open_request
    pub(super) fn hear(&mut self, account: Account, asked: Asked) -> News {
        let mut news = News::default();
        let (asked, newest_last) = (asked.newest, asked.last);
        // Of several writes nobody can tell in which order they were executed.
        let is_sequence = asked.wrapping_sub(self.settled) > 1;
        let last_register = account.last_write.unwrap_or(asked as u16);
        // A number of a cycle there is that of a write of long ago.
        let says_last = |last: &u32| account.last_write.is_none() || self.leaves_last(*last);
        let last = self.number(last_register).filter(says_last);
        let slots = account.details.map_or([None; SLOTS], |details| {
            details.slots.map(|word| self.number(word))
        });
        let was_underway = last.is_some_and(|last| self.fate(last) == Fate::Underway);
        let mut fresh = 0_u16;
        for number in slots.into_iter().flatten().chain(last) {
            fresh.tally(self.executed(number, &mut news));
        }
        // A newer one was executed, and this one after it.
        let is_own = account.last_write.is_none();
        let is_behind = last.is_some() && last != self.newest_executed(is_own);
        // The newest write was executed, and none after it.
        let expected = if is_own { asked } else { newest_last };
        let is_newest =
            self.fate(asked) == Fate::Executed && last_register == expected as u16 && !is_behind;
        news.late.tally((is_behind && was_underway).into());
        self.executions = self.executions.wrapping_add(fresh);
        let arrived = self
            .received
            .map(|before| account.received.wrapping_sub(before));
        let is_explained = arrived == Some(fresh.wrapping_add(1)) && self.requests == 1;
        match account.details {
            Some(details) => {
                if last.is_none() && last_register != expected as u16 {
                    // Reset, or somebody else's: the counts mean nothing.
                    self.unaccounted = None;
                }
                self.settle(asked, &slots, details, account.received, &mut news);
            }
            None if is_explained => self.nothing_else_came(asked, &mut news),
            None => {
                // What else came is not known yet. But had the newest write been followed by an
                // older one, there would be three packets at least.
                if !is_newest && arrived.is_some_and(|arrived| arrived < 3) {
                    self.nothing_else_came(asked, &mut news);
                }
                self.is_open = true;
            }
        }
        if let (false, Some(last), Fate::Missing) = (is_own, last, self.fate(newest_last)) {
            // It did not become the last; should it come late, the register tells.
            if self.newest_last == newest_last {
                self.newest_last = last;
            }
        }
        self.received = Some(account.received);
        self.requests = 0;
        // What is lost may still come, and the details show it best.
        self.is_open |= news.lost > 0;
        let said = [news.lost, news.late, news.repeated, news.unconfirmed];
        // Forgotten as soon as it is past: numbers that have gone half round look older again.
        let is_past = |overtaken: &u32| asked.wrapping_sub(*overtaken) as i32 > 0;
        self.overtaken = self.overtaken.filter(|overtaken| !is_past(overtaken));
        let is_certain = is_explained && is_newest && !is_sequence && self.overtaken.is_none();
        news.doubt = !is_certain || said.into_iter().any(|count| count > 0);
        if self.has_cycles && news.doubt {
            self.overtaken = Some(self.newest);
        }
        news
    }

    /// A number that the board names is executed. How many packets that explains which are no
    /// requests.
    fn executed(&mut self, number: u32, news: &mut News) -> u16 {
        let Some(write) = self.writes.get_mut((number % REMEMBERED) as usize) else {
            return 0;
        };
        match write.fate {
            Fate::Underway => {}
            Fate::Missing => {
                news.found.tally(1);
                news.late.tally(1);
            }
            Fate::Unknown | Fate::Executed => return 0,
        }
        write.fate = Fate::Executed;
        u16::from(write.kind == Kind::Alone)
    }

    /// Nothing came but what is known to be executed: the rest is lost.
    fn nothing_else_came(&mut self, asked: u32, news: &mut News) {
        while let Some(number) = self.next_to_settle(asked) {
            news.lost.tally(self.give_up(number, Fate::Missing));
        }
    }

    /// Goes through the writes that are not settled up to `asked`.
    fn next_to_settle(&mut self, asked: u32) -> Option<u32> {
        // What was asked may be settled since.
        if asked.wrapping_sub(self.settled) as i32 <= 0 {
            return None;
        }
        self.settled = self.settled.wrapping_add(1);
        Some(self.settled)
    }

    /// Settles everything by the details.
    fn settle(
        &mut self,
        asked: u32,
        slots: &[Option<u32>; SLOTS],
        details: Details,
        received: u16,
        news: &mut News,
    ) {
        news.unconfirmed = core::mem::take(&mut self.forgotten);
        while let Some(number) = self.next_to_settle(asked) {
            let slot = self.write(number).map_or(0, |write| write.slot);
            let slot = slots.get(slot).copied().flatten();
            let is_overwritten = slot.is_some_and(|slot| self.age(slot) < self.age(number));
            if is_overwritten {
                news.unconfirmed.tally(self.give_up(number, Fate::Unknown));
            } else {
                news.lost.tally(self.give_up(number, Fate::Missing));
            }
        }
        let executions = core::mem::take(&mut self.executions);
        let unanswered = received.wrapping_sub(details.sent);
        let expected = self
            .unaccounted
            .map(|before| before.wrapping_add(executions));
        let surplus = expected.map(|expected| unanswered.wrapping_sub(expected));
        if let Some(surplus @ 1..PLAUSIBLE) = surplus.filter(|_| news.unconfirmed == 0) {
            news.repeated.tally(surplus.into());
        }
        // Counts that a reset of the board took back, or that an unconfirmed write blurs, begin
        // again from here.
        self.unaccounted = Some(unanswered);
        self.is_open = false;
    }

    /// A write that is still in flight gets another fate: 1 if it was.
    fn give_up(&mut self, number: u32, fate: Fate) -> u32 {
        if self.fate(number) != Fate::Underway {
            return 0;
        }
        if let Some(write) = self.writes.get_mut((number % REMEMBERED) as usize) {
            write.fate = fate;
        }
        1
    }

    /// The write that a 16-bit number of the board means, if it is one of ours.
    fn number(&self, word: u16) -> Option<u32> {
        let age = (self.newest as u16).wrapping_sub(word);
        let number = self.newest.wrapping_sub(u32::from(age));
        (self.fate(number) != Fate::Unknown).then_some(number)
    }

    /// The newest write that was executed: of all, or of those that say that they were the last.
    fn newest_executed(&self, of_all: bool) -> Option<u32> {
        (0..REMEMBERED)
            .map(|age| self.newest.wrapping_sub(age))
            .filter(|number| of_all || self.leaves_last(*number))
            .find(|number| self.fate(*number) == Fate::Executed)
    }

    /// Whether a remembered write says that it was the last.
    fn leaves_last(&self, number: u32) -> bool {
        self.write(number)
            .is_some_and(|write| write.kind != Kind::Cycle)
    }

    fn underway(&self) -> u32 {
        self.newest.wrapping_sub(self.settled)
    }

    fn age(&self, number: u32) -> u32 {
        self.newest.wrapping_sub(number)
    }

    fn fate(&self, number: u32) -> Fate {
        self.write(number).map_or(Fate::Unknown, |write| write.fate)
    }

    fn write(&self, number: u32) -> Option<&Write> {
        let is_remembered = self.age(number) < REMEMBERED;
        let place = (number % REMEMBERED) as usize;
        self.writes.get(place).filter(|_| is_remembered)
    }
}

/// So many in one go are no repetitions: the counts began again.
const PLAUSIBLE: u16 = 0x100;

#[cfg(test)]
mod tests;
