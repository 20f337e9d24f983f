//! Account of the packets sent, derived from the board's own records.
//!
//! A packet that only writes is not answered. So every write leaves its number in the board: in one
//! register for the last executed write, and in one of [`SLOTS`] others, which show for each of the
//! last few writes whether it was executed at all. A write that is a whole cycle is acknowledged by
//! its own reply and does not set the first register. Packets that arrived twice show in the
//! board's own packet counts (manual: 7I97, "MEMORY SPACE 6 LAYOUT").
//!
//! A reply usually contains the number of the last write and the count of received packets. They
//! explain everything if one write and this request were sent since the previous reply; if they do
//! not, the next request asks for the rest ([`Ledger::wants_details`]).

use core::cmp::Reverse;

use crate::tally::Tally;

/// Number of registers that hold the numbers of writes; successive writes use different ones.
pub(super) const SLOTS: usize = 5;

/// Number of past writes that are remembered.
const REMEMBERED: u32 = 64;

/// A lost write keeps its register for this many further writes, in case that it arrives late.
const KEPT: u32 = 16;

/// The board's account in a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Account {
    /// Number of the last executed write that sets this register; `None` in the reply to a write
    /// that does not, since that write is the last one itself.
    pub last_write: Option<u16>,
    /// RXUDPCount, this request included.
    pub received: u16,
    pub details: Option<Details>,
}

/// Further contents, requested when the rest leaves a question open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Details {
    /// The last executed write of each register.
    pub slots: [u16; SLOTS],
    /// TXUDPCount, this reply not included.
    pub sent: u16,
}

/// New findings of an account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct WriteReport {
    /// Writes that the board has not executed.
    pub lost: u32,
    /// Writes that were reported as lost and have been executed since.
    pub found: u32,
    /// The found writes, and writes that were executed after a newer one.
    pub late: u32,
    /// Repeated executions of the same write.
    pub repeated: u32,
    /// Writes whose execution can no longer be determined.
    pub unconfirmed: u32,
    /// Set unless it is certain that the newest write before the request was executed last, and
    /// that nothing else was executed since the previous account.
    pub doubt: bool,
}

/// State of the ledger when a request was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LedgerState {
    /// Number of the newest write.
    newest: u32,
    /// Expected content of the last-write register.
    last: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WriteState {
    /// Never sent, or forgotten.
    Unknown,
    Underway,
    /// Reported as lost.
    Missing,
    Executed,
}

#[derive(Clone, Copy, Debug)]
struct WriteEntry {
    state: WriteState,
    kind: WriteEvidence,
    slot: usize,
}

/// Evidence that a write was executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WriteEvidence {
    /// Not answered: the reply to the next request.
    Alone,
    /// An exchange of set-up: its own reply, or that of another.
    Acknowledged,
    /// A whole cycle: its own reply. Does not set the last-write register.
    Cycle,
}

/// The recent writes, and the state of each according to the board.
#[derive(Clone, Debug)]
pub(super) struct Ledger {
    /// Number of the newest write.
    newest: u32,
    /// Expected content of the last-write register.
    newest_last: u32,
    /// Number of the write after which an older cycle may have been executed: a cycle does not set
    /// the last-write register.
    overtaken: Option<u32>,
    has_cycles: bool,
    /// Number of the newest write before those in flight.
    settled: u32,
    writes: [WriteEntry; REMEMBERED as usize],
    /// The last write of each register.
    owners: [u32; SLOTS],
    /// Writes that were still in flight when they were forgotten.
    forgotten: u32,
    /// Requests since the last account.
    requests: u32,
    /// RXUDPCount of the last account.
    pub(super) received: Option<u16>,
    /// RXUDPCount less TXUDPCount less the accounted executions: grows when the board executes a
    /// packet that is neither answered nor known to the ledger.
    unaccounted: Option<u16>,
    /// Executions accounted for since the last details.
    executions: u16,
    is_open: bool,
}

/// The number of a write, and the slot register of the board in which the write leaves the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct WriteNumber {
    pub number: u32,
    pub slot: usize,
}

impl Ledger {
    /// A ledger without writes; the first one has the number after `newest`.
    pub(super) fn starting_after(newest: u32) -> Self {
        let unknown = WriteEntry {
            state: WriteState::Unknown,
            kind: WriteEvidence::Alone,
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

    /// Records that a write is sent; returns its number.
    pub(super) fn open_write(&mut self, kind: WriteEvidence) -> WriteNumber {
        self.newest = self.newest.wrapping_add(1);
        if kind == WriteEvidence::Cycle {
            self.has_cycles = true;
        } else {
            self.newest_last = self.newest;
        }
        if self.underway() > REMEMBERED {
            self.settled = self.settled.wrapping_add(1);
            // The slot of this write is reused for the new one.
            let is_open = self.state(self.newest) == WriteState::Underway;
            self.forgotten.tally(is_open.into());
        }
        let slot = self.choose_slot();
        if let Some(place) = self.writes.get_mut((self.newest % REMEMBERED) as usize) {
            let state = WriteState::Underway;
            *place = WriteEntry { state, kind, slot };
        }
        WriteNumber {
            number: self.newest,
            slot,
        }
    }

    /// Picks the register to reuse: one whose write is settled or missing for more than [`KEPT`]
    /// writes first, then one whose write is missing, then one in flight; of those the oldest.
    fn choose_slot(&mut self) -> usize {
        let need = |owner: u32| match self.state(owner) {
            WriteState::Underway => 2,
            WriteState::Missing if self.age(owner) <= KEPT => 1,
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

    /// Records that a request is sent; returns the state that its reply refers to.
    pub(super) fn open_request(&mut self) -> LedgerState {
        self.requests = self.requests.saturating_add(1);
        LedgerState {
            newest: self.newest,
            last: self.newest_last,
        }
    }

    /// Records that a packet of caller-supplied commands is sent, whose effect on the counts is not
    /// known.
    pub(super) fn lose_count(&mut self) {
        self.received = None;
        self.unaccounted = None;
        self.is_open = true;
    }

    /// True if the request that is sent now must ask for the details.
    pub(super) fn wants_details(&self) -> bool {
        self.is_open || self.requests > 1 || self.underway() > 1
    }

    /// True if the newest write was executed, according to the last account.
    pub(super) fn is_executed(&self) -> bool {
        self.state(self.newest) == WriteState::Executed
    }

    /// Evaluates the account in the reply to a request; `request` is the value that
    /// [`open_request`] returned for it.
    ///
    /// [`open_request`]: Self::open_request
    pub(super) fn evaluate(&mut self, account: Account, request: LedgerState) -> WriteReport {
        let mut report = WriteReport::default();
        let (request, newest_last) = (request.newest, request.last);
        // The order in which several writes were executed is not known.
        let is_sequence = request.wrapping_sub(self.settled) > 1;
        let last_register = account.last_write.unwrap_or(request as u16);
        // A cycle does not set this register: a number that maps to one is left from an old write.
        let says_last = |last: &u32| account.last_write.is_none() || self.leaves_last(*last);
        let last = self.number(last_register).filter(says_last);
        let slots = account.details.map_or([None; SLOTS], |details| {
            details.slots.map(|word| self.number(word))
        });
        let was_underway = last.is_some_and(|last| self.state(last) == WriteState::Underway);
        let fresh = self.mark_executed(slots.into_iter().flatten().chain(last), &mut report);
        // A newer write was executed, and this one after it.
        let is_own = account.last_write.is_none();
        let is_behind = last.is_some() && last != self.newest_executed(is_own);
        // The newest write was executed, and none after it.
        let expected = if is_own { request } else { newest_last };
        let is_last = last_register == expected as u16 && !is_behind;
        let is_newest = is_last && self.state(request) == WriteState::Executed;
        report.late.tally((is_behind && was_underway).into());
        let arrived = self.arrived(account.received);
        let is_explained = arrived == Some(fresh.wrapping_add(1)) && self.requests == 1;
        match account.details {
            Some(details) => {
                if last.is_none() && last_register != expected as u16 {
                    // A reset, or another host's number: the counts are meaningless.
                    self.unaccounted = None;
                }
                self.settle(request, &slots, details, account.received, &mut report);
            }
            None if is_explained => self.nothing_else_came(request, &mut report),
            None => {
                // The other packets are not known yet. But if an older write had followed the
                // newest one, at least three packets would have arrived.
                if !is_newest && arrived.is_some_and(|arrived| arrived < 3) {
                    self.nothing_else_came(request, &mut report);
                }
                self.is_open = true;
            }
        }
        if let (false, Some(last)) = (is_own, last) {
            self.correct_last(newest_last, last);
        }
        self.close_requests(account.received, report.lost);
        let is_certain = is_explained && is_newest && !is_sequence;
        report.doubt = self.leaves_doubt(request, is_certain, &report);
        report
    }

    /// Number of packets that arrived since the last account, by the new RXUDPCount.
    fn arrived(&self, received: u16) -> Option<u16> {
        self.received.map(|before| received.wrapping_sub(before))
    }

    /// Ends the requests up to the account that was evaluated.
    fn close_requests(&mut self, received: u16, lost: u32) {
        self.received = Some(received);
        self.requests = 0;
        // A lost write may still arrive, and the details show that best.
        self.is_open |= lost > 0;
    }

    /// True if an account leaves a doubt: it is not `is_certain` by itself, an older cycle may
    /// follow, or it has findings.
    fn leaves_doubt(&mut self, request: u32, is_certain: bool, report: &WriteReport) -> bool {
        let said = [
            report.lost,
            report.late,
            report.repeated,
            report.unconfirmed,
        ];
        // Dropped as soon as it is past: half of the number range later, it would count as newer
        // again.
        let is_past = |overtaken: &u32| request.wrapping_sub(*overtaken) as i32 > 0;
        self.overtaken = self.overtaken.filter(|overtaken| !is_past(overtaken));
        let is_certain = is_certain && self.overtaken.is_none();
        let doubts = !is_certain || said.into_iter().any(|count| count > 0);
        if self.has_cycles && doubts {
            self.overtaken = Some(self.newest);
        }
        doubts
    }

    /// If the write expected in the last-write register is missing, expects the one found there: if
    /// the missing one arrives late, the register shows it.
    fn correct_last(&mut self, expected: u32, last: u32) {
        if self.state(expected) == WriteState::Missing && self.newest_last == expected {
            self.newest_last = last;
        }
    }

    /// Marks the writes of the numbers that the board reports as executed. Returns the number of
    /// packets, other than requests, that this explains.
    fn mark_executed(
        &mut self,
        numbers: impl Iterator<Item = u32>,
        report: &mut WriteReport,
    ) -> u16 {
        let mut fresh = 0_u16;
        for number in numbers {
            fresh.tally(self.mark(number, report));
        }
        self.executions = self.executions.wrapping_add(fresh);
        fresh
    }

    fn mark(&mut self, number: u32, report: &mut WriteReport) -> u16 {
        let Some(write) = self.writes.get_mut((number % REMEMBERED) as usize) else {
            return 0;
        };
        match write.state {
            WriteState::Underway => {}
            WriteState::Missing => {
                report.found.tally(1);
                report.late.tally(1);
            }
            WriteState::Unknown | WriteState::Executed => return 0,
        }
        write.state = WriteState::Executed;
        u16::from(write.kind == WriteEvidence::Alone)
    }

    /// Only known writes arrived: the rest is lost.
    fn nothing_else_came(&mut self, request: u32, report: &mut WriteReport) {
        while let Some(number) = self.next_to_settle(request) {
            report.lost.tally(self.give_up(number, WriteState::Missing));
        }
    }

    /// Steps through the writes up to `request` that are not settled.
    fn next_to_settle(&mut self, request: u32) -> Option<u32> {
        // The write may have been settled since the request was sent.
        if request.wrapping_sub(self.settled) as i32 <= 0 {
            return None;
        }
        self.settled = self.settled.wrapping_add(1);
        Some(self.settled)
    }

    /// Settles all writes by the details.
    fn settle(
        &mut self,
        request: u32,
        slots: &[Option<u32>; SLOTS],
        details: Details,
        received: u16,
        report: &mut WriteReport,
    ) {
        report.unconfirmed = core::mem::take(&mut self.forgotten);
        while let Some(number) = self.next_to_settle(request) {
            let slot = self.write(number).map_or(0, |write| write.slot);
            let slot = slots.get(slot).copied().flatten();
            let is_overwritten = slot.is_some_and(|slot| self.age(slot) < self.age(number));
            if is_overwritten {
                report
                    .unconfirmed
                    .tally(self.give_up(number, WriteState::Unknown));
            } else {
                report.lost.tally(self.give_up(number, WriteState::Missing));
            }
        }
        let executions = core::mem::take(&mut self.executions);
        let unanswered = received.wrapping_sub(details.sent);
        let expected = self
            .unaccounted
            .map(|before| before.wrapping_add(executions));
        let surplus = expected.map(|expected| unanswered.wrapping_sub(expected));
        if let Some(surplus @ 1..PLAUSIBLE) = surplus.filter(|_| report.unconfirmed == 0) {
            report.repeated.tally(surplus.into());
        }
        // Counts that a reset of the board restarted, or that an unconfirmed write makes
        // unreliable, start again from here.
        self.unaccounted = Some(unanswered);
        self.is_open = false;
    }

    /// Changes the fate of a write that is still in flight; returns 1 if it was.
    fn give_up(&mut self, number: u32, state: WriteState) -> u32 {
        if self.state(number) != WriteState::Underway {
            return 0;
        }
        if let Some(write) = self.writes.get_mut((number % REMEMBERED) as usize) {
            write.state = state;
        }
        1
    }

    /// The write that a 16-bit number of the board stands for, if it is one of ours.
    fn number(&self, word: u16) -> Option<u32> {
        let age = (self.newest as u16).wrapping_sub(word);
        let number = self.newest.wrapping_sub(u32::from(age));
        (self.state(number) != WriteState::Unknown).then_some(number)
    }

    /// The newest executed write: of all, or only of those that set the last-write register.
    fn newest_executed(&self, of_all: bool) -> Option<u32> {
        (0..REMEMBERED)
            .map(|age| self.newest.wrapping_sub(age))
            .filter(|number| of_all || self.leaves_last(*number))
            .find(|number| self.state(*number) == WriteState::Executed)
    }

    /// True if a remembered write sets the last-write register.
    fn leaves_last(&self, number: u32) -> bool {
        self.write(number)
            .is_some_and(|write| write.kind != WriteEvidence::Cycle)
    }

    fn underway(&self) -> u32 {
        self.newest.wrapping_sub(self.settled)
    }

    fn age(&self, number: u32) -> u32 {
        self.newest.wrapping_sub(number)
    }

    fn state(&self, number: u32) -> WriteState {
        self.write(number)
            .map_or(WriteState::Unknown, |write| write.state)
    }

    fn write(&self, number: u32) -> Option<&WriteEntry> {
        let is_remembered = self.age(number) < REMEMBERED;
        let place = (number % REMEMBERED) as usize;
        self.writes.get(place).filter(|_| is_remembered)
    }
}

/// A larger surplus at once is not caused by repetitions: the counts were restarted.
const PLAUSIBLE: u16 = 0x100;

#[cfg(test)]
mod tests;
