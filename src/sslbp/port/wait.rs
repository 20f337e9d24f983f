//! Writing COMMAND and waiting for it: the only place that does either.

use super::{Port, PortResult};
use crate::{
    bus::{Access, Clock, RegisterBus},
    sslbp::{Command, CsStatus, DataStatus, Registers, WaitError, WaitingFor},
};
use alloc::vec::Vec;
use core::time::Duration;

/// Between COMMAND reading 0 and the next write: a write within 20 ns is swallowed (FACTS 3.4).
const SETTLE: Duration = Duration::from_nanos(200);

/// The longest that an operation of the gateware itself takes, with a margin: setup START with an
/// absent channel 55 ms, a pass-through access without a reply 50 ms (FACTS 3, 4.2).
const BUSY_LIMIT: Duration = Duration::from_millis(200);

/// The way out clears COMMAND within 7 us (FACTS 3, 3.2).
const FREE_LIMIT: Duration = Duration::from_millis(5);
/// The way out is found twice: soon after COMMAND is 0 it is taken as invalid and cleared once
/// more, and a command written in between is lost (as FACTS 3.3 says of others: within 12 us).
const AFTER_FREE: Duration = Duration::from_micros(20);

/// Time between polls: short at first, and at most this long.
const FIRST_POLL: Duration = Duration::from_micros(2);
const LONGEST_POLL: Duration = Duration::from_micros(250);

/// Ends a wait even on a bus whose clock stands still.
const MOST_POLLS: u32 = 20_000;

/// How long a command usually takes, and when to give up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    pub usual: Duration,
    pub limit: Duration,
}

/// Registers that are read together with COMMAND, in one exchange, so that what they hold when
/// COMMAND reads 0 is valid.
pub(super) struct Poll {
    accesses: Vec<Access>,
    words: Vec<u32>,
}

impl Poll {
    /// COMMAND and DATA.
    fn new(port: &Port) -> Self {
        let mut poll = Self {
            accesses: Vec::new(),
            words: Vec::new(),
        };
        poll.push(port.layout.command());
        poll.push(port.layout.data());
        poll
    }

    fn push(&mut self, address: u16) {
        self.accesses
            .push(Access::read(address, self.words.len() as u16, 1));
        self.words.push(0);
    }

    fn command(&self) -> u32 {
        self.words.first().copied().unwrap_or(u32::MAX)
    }

    /// DATA as it was together with the last COMMAND.
    pub fn data(&self) -> DataStatus {
        DataStatus::from_register(self.words.get(1).copied().unwrap_or(0))
    }

    /// The registers after COMMAND and DATA, in the order in which they were given.
    pub fn others(&self) -> &[u32] {
        self.words.get(2..).unwrap_or(&[])
    }
}

impl Port {
    /// Runs `command` once COMMAND is 0: first writes `writes`, then COMMAND, then waits for it to
    /// clear. `reads` are read together with it.
    pub(super) fn execute<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        command: Command,
        writes: &[(u16, u32)],
        reads: impl IntoIterator<Item = u16>,
        expected: Expected,
    ) -> PortResult<Poll, B> {
        self.await_idle(bus, command)?;
        self.issue(bus, command, writes)?;
        let mut poll = Poll::new(self);
        for address in reads {
            poll.push(address);
        }
        bus.wait(expected.usual);
        let waiting_for = WaitingFor::Completion(command);
        self.poll(bus, &mut poll, waiting_for, expected.limit)?;
        Ok(poll)
    }

    /// Waits until COMMAND is 0, so that `command` may be written.
    pub(super) fn await_idle<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        command: Command,
    ) -> PortResult<(), B> {
        if self.idle {
            return Ok(());
        }
        let mut poll = Poll::new(self);
        self.poll(bus, &mut poll, WaitingFor::Idle(command), BUSY_LIMIT)
    }

    /// Writes `writes` and then `command`, which must be allowed now, in one exchange.
    pub(super) fn issue<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        command: Command,
        writes: &[(u16, u32)],
    ) -> PortResult<(), B> {
        let command_write = [(self.layout.command(), command.word())];
        let all = || writes.iter().chain(&command_write);
        let mut words: Vec<u32> = all().map(|&(_, word)| word).collect();
        let accesses: Vec<Access> = (0u16..)
            .zip(all())
            .map(|(n, &(address, _))| Access::write(address, n, 1))
            .collect();
        bus.wait(SETTLE);
        self.idle = false;
        Ok(bus.exchange(&accesses, &mut words)?)
    }

    /// Frees a port whose COMMAND never clears: the one write that is allowed while it is busy.
    ///
    /// What kept it busy must be over: the way out ends the waiting and not the transfer (FACTS
    /// 3.2), and the STOPALL that follows would stick again.
    pub(super) fn free<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        self.issue(bus, Command::FREE, &[])?;
        let mut poll = Poll::new(self);
        self.poll(bus, &mut poll, WaitingFor::Freed, FREE_LIMIT)?;
        bus.wait(AFTER_FREE);
        Ok(())
    }

    /// Reads `poll` until COMMAND is 0 in it, for at most `limit`.
    pub(super) fn poll<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        poll: &mut Poll,
        waiting_for: WaitingFor,
        limit: Duration,
    ) -> PortResult<(), B> {
        let begin = bus.now();
        let mut pause = FIRST_POLL;
        for _ in 0..MOST_POLLS {
            bus.exchange(&poll.accesses, &mut poll.words)?;
            if poll.command() == 0 {
                self.idle = true;
                return Ok(());
            }
            if bus.now().since(begin) >= limit {
                break;
            }
            bus.wait(pause);
            pause = (pause * 2).min(LONGEST_POLL);
        }
        let waited = bus.now().since(begin);
        Err(self.wait_error(bus, waiting_for, waited)?.into())
    }

    /// The error of a wait that has ended, with the registers as they are now.
    pub(super) fn wait_error<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        waiting_for: WaitingFor,
        waited: Duration,
    ) -> PortResult<WaitError, B> {
        Ok(WaitError {
            port: self.layout.instance(),
            waiting_for,
            waited,
            registers: self.snapshot(bus)?,
        })
    }

    /// COMMAND, DATA and all CS, as they are now.
    pub fn snapshot<B: RegisterBus + Clock>(&self, bus: &mut B) -> PortResult<Registers, B> {
        let mut poll = Poll::new(self);
        for channel in self.layout.mask().iter() {
            poll.push(self.registers(channel)?.cs());
        }
        bus.exchange(&poll.accesses, &mut poll.words)?;
        let mut registers = Registers {
            command: poll.command(),
            data: poll.data(),
            channels: self.layout.channels(),
            ..Registers::default()
        };
        for (cs, &word) in registers.cs.iter_mut().zip(poll.others()) {
            *cs = CsStatus::from_register(word);
        }
        Ok(registers)
    }
}
