//! The wait for a reply, and the handling of other datagrams that arrive meanwhile.

use core::time::Duration;

use super::ledger::Account;
use super::matching::Match;
use super::others::ReplyCounters;
use super::wait::Wait;
use super::{PacketLink, UdpBus, UdpList};
use crate::bus::{BusError, Reply};
use crate::lbp16::MAX_PACKET;
use crate::tally::Tally;

/// Limit of the datagrams that are checked after the deadline, for one that arrived before it.
const MAX_OVERTIME: u32 = 64;

impl<L: PacketLink> UdpBus<L> {
    /// Waits for the reply to the newest request and takes its words. Discards all other datagrams.
    pub(super) fn receive(
        &mut self,
        list: &UdpList,
        wait: Wait,
        words: &mut [u32],
    ) -> Result<(), BusError> {
        let request = wait.request;
        let deadline = wait.deadline.saturating_add(list.held);
        let until = wait.started.after(deadline);
        let mut instead = None;
        let (mut overtime, mut datagrams) = (0_u32, 0_u64);
        loop {
            let received = self.link.receive(self.reply.as_mut_slice(), until);
            let waited = self.link.now().since(wait.started);
            match received {
                Ok(Some(length)) => match self.sort(list, length, wait, waited)? {
                    Some(got) if got == request => {
                        list.take(self.reply.as_slice(), words);
                        return Ok(());
                    }
                    Some(got) => {
                        instead = Some(BusError::Stale {
                            request,
                            got,
                            waited,
                        });
                    }
                    None => datagrams.tally(1),
                },
                Ok(None) => overtime = MAX_OVERTIME,
                Err(error) => {
                    // If a reply arrives after all, it is late.
                    self.statistics.lost.tally(1);
                    return Err(BusError::Link { error, waited });
                }
            }
            // A datagram that arrived in time may still be in the socket; the search for it is
            // bounded.
            overtime.tally((waited > deadline).into());
            if overtime >= MAX_OVERTIME {
                self.statistics.lost.tally(1);
                return Err(instead.unwrap_or_else(|| without_reply(request, datagrams, waited)));
            }
        }
    }

    /// Classifies and counts a datagram; returns the number of the request that it answers, if it
    /// answers one.
    fn sort(
        &mut self,
        list: &UdpList,
        length: usize,
        wait: Wait,
        waited: Duration,
    ) -> Result<Option<u32>, BusError> {
        let counted = &mut self.statistics;
        if length > MAX_PACKET {
            // No board sends such a packet, and it is cut off: its last bytes here may be from its
            // middle.
            counted.foreign.tally(1);
            return Ok(None);
        }
        let reply = self.reply.get(..length).unwrap_or(&[]);
        let Some(number) = UdpList::number(reply) else {
            counted.short.tally(1);
            return Ok(None);
        };
        match self.requests.classify(number) {
            Match::Current => self.accept(list, length, wait, waited)?,
            Match::Late => {
                counted.late.tally(1);
                counted.lost = counted.lost.saturating_sub(1);
            }
            Match::Duplicate => counted.duplicate.tally(1),
            Match::Stale => counted.stale.tally(1),
            Match::Foreign if length < list.reply_len(wait.detailed) => {
                counted.short.tally(1);
                return Ok(None);
            }
            Match::Foreign => {
                counted.foreign.tally(1);
                return Ok(None);
            }
        }
        Ok(Some(number))
    }

    /// Checks length and age of the awaited reply, and takes its account.
    fn accept(
        &mut self,
        list: &UdpList,
        length: usize,
        wait: Wait,
        waited: Duration,
    ) -> Result<(), BusError> {
        let (request, expected) = (wait.request, list.reply_len(wait.detailed));
        let counted = &mut self.statistics;
        let reply = self.reply.get(..length).unwrap_or(&[]);
        if length != expected {
            counted.short.tally(1);
            return Err(BusError::Short {
                request,
                expected,
                got: length,
                waited,
            });
        }
        // Only the time that the board waited for its clock extends the deadline: any other delay
        // was on the way, and the words are that much older.
        let held = list.waited_us(reply).unwrap_or(0);
        let held = Duration::from_micros(held.into()).min(list.held);
        let deadline = wait.deadline.saturating_add(held);
        if waited > deadline {
            counted.late.tally(1);
            return Err(BusError::Late {
                request,
                waited,
                by: waited.saturating_sub(deadline),
            });
        }
        counted.bytes_received.tally(length as u64);
        let account = list.account(reply, wait.detailed);
        self.evaluate(account, wait);
        Ok(())
    }

    /// Counts the fates of the writes, and the packets of other senders.
    fn evaluate(&mut self, account: Account, wait: Wait) {
        let before = self.ledger.received;
        let report = self.ledger.evaluate(account, wait.ledger);
        let counted = &mut self.statistics;
        let counters = ReplyCounters {
            at: wait.started,
            received: before.map(|before| account.received.wrapping_sub(before)),
            sent: wait.sent,
            duplicate: counted.duplicate.saturating_add(counted.stale),
        };
        let others = self.others.add(counters);
        let others = others.filter(|_| !self.config.beside_others);
        let others = others.unwrap_or(0);
        counted.foreign_packets.tally(others.into());
        counted.lost_writes.tally(report.lost.into());
        counted.lost_writes = counted.lost_writes.saturating_sub(report.found.into());
        counted.late_writes.tally(report.late.into());
        counted.repeated_writes.tally(report.repeated.into());
        counted.unconfirmed_writes.tally(report.unconfirmed.into());
        counted.doubts.tally(report.doubt.into());
        if self.is_cyclic {
            // A write that arrives late is no longer lost, but it was.
            let lost = report.lost.saturating_add(report.late);
            let reply = Reply::CERTAIN
                .with_certain(!report.doubt)
                .with_lost_writes(lost.saturating_sub(report.found))
                .with_foreign_packets(others);
            self.replies = self.replies.and(reply);
        }
    }
}

fn without_reply(request: u32, datagrams: u64, waited: Duration) -> BusError {
    if datagrams == 0 {
        return BusError::Lost { request, waited };
    }
    BusError::Foreign {
        request,
        datagrams,
        waited,
    }
}
