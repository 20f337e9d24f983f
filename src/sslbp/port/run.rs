//! Running an operation of the machine to its end: the only place that waits.

use super::{Port, PortResult};
use crate::{
    bus::{Access, Clock, RegisterBus},
    sslbp::{
        Channel, CsStatus, DataStatus, MAX_CHANNELS, MAX_INTERFACE_REGISTERS, Registers, WaitError,
        WaitingFor,
        machine::{Complete, Event, Observed, Operation},
    },
};
use alloc::vec::Vec;
use core::time::Duration;

/// Between COMMAND reading 0 and the next write: a write within 20 ns is swallowed (FACTS 3.4).
const SETTLE: Duration = Duration::from_nanos(200);

/// Time between polls: short at first, and at most this long.
const FIRST_POLL: Duration = Duration::from_micros(2);
const LONGEST_POLL: Duration = Duration::from_micros(250);

/// Ends a wait even on a bus whose clock stands still.
const MOST_POLLS: u32 = 20_000;

/// Which registers are read together with COMMAND and DATA, in one exchange, so that what they hold
/// when COMMAND reads 0 is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    Nothing,
    Cs,
    /// CS and this many interface registers.
    Interface(u8),
}

const CHANNELS: usize = MAX_CHANNELS as usize;
const INTERFACE: usize = MAX_INTERFACE_REGISTERS as usize;

/// The registers of a port as the last read brought them.
pub(super) struct Snapshot {
    accesses: Vec<Access>,
    words: [u32; Self::WORDS],
}

impl Snapshot {
    const PER_CHANNEL: usize = 1 + INTERFACE;
    const WORDS: usize = 2 + CHANNELS * Self::PER_CHANNEL;

    fn new(port: &Port, channels: impl Iterator<Item = Channel>, wanted: Wanted) -> Self {
        let mut snapshot = Self {
            accesses: Vec::new(),
            words: [0; Self::WORDS],
        };
        snapshot.read(port.layout.command(), 0);
        snapshot.read(port.layout.data(), 1);
        let interfaces = match wanted {
            Wanted::Nothing => return snapshot,
            Wanted::Cs => 0,
            Wanted::Interface(count) => count,
        };
        for channel in channels {
            let Some(registers) = port.layout.channel(channel) else {
                continue;
            };
            let first = Self::place(channel);
            snapshot.read(registers.cs(), first);
            let addresses = registers.interfaces().take(usize::from(interfaces));
            for (place, address) in (first + 1..).zip(addresses) {
                snapshot.read(address, place);
            }
        }
        snapshot
    }

    fn read(&mut self, address: u16, place: usize) {
        self.accesses.push(Access::read(address, place as u16, 1));
    }

    fn place(channel: Channel) -> usize {
        2 + Self::PER_CHANNEL * usize::from(channel.index())
    }

    fn word(&self, place: usize) -> u32 {
        self.words.get(place).copied().unwrap_or(0)
    }

    /// DATA.
    pub fn status(&self) -> DataStatus {
        DataStatus::from_register(self.data())
    }

    /// CS of `channel`.
    pub fn channel_status(&self, channel: Channel) -> CsStatus {
        CsStatus::from_register(self.cs(channel))
    }

    /// The interface registers of `channel`; those that were not read are 0.
    pub fn interface<const N: usize>(&self, channel: Channel) -> [u32; N] {
        let first = Self::place(channel) + 1;
        core::array::from_fn(|n| self.word(first + n))
    }
}

impl Observed for Snapshot {
    fn command(&self) -> u32 {
        self.word(0)
    }

    fn data(&self) -> u32 {
        self.word(1)
    }

    fn cs(&self, channel: Channel) -> u32 {
        self.word(Self::place(channel))
    }

    fn told(&self, channel: Channel) -> [u32; 3] {
        self.interface(channel)
    }
}

impl Port {
    /// Runs `operation`: waits until the port is idle, writes `writes` and then COMMAND, and waits
    /// until the operation is complete.
    pub(super) fn run<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        operation: Operation,
        writes: &[(u16, u32)],
        wanted: Wanted,
    ) -> PortResult<(Complete, Snapshot), B> {
        if !operation.interrupts() {
            self.await_idle(bus, operation)?;
        }
        self.issue(bus, operation, writes)?;
        let mut snapshot = Snapshot::new(self, operation.channels().iter(), wanted);
        bus.wait(self.usual(&operation));
        let waiting_for = match operation {
            Operation::Free => WaitingFor::Freed,
            other => WaitingFor::Completion(other.command()),
        };
        let complete = self.poll(bus, &mut snapshot, waiting_for, |_, event| match event {
            Event::Complete(complete) => Some(complete),
            _ => None,
        })?;
        Ok((complete, snapshot))
    }

    /// How long it takes with the sizes of the remotes.
    fn usual(&self, operation: &Operation) -> Duration {
        match operation {
            Operation::Transfer(mask) => self.doit_time(*mask).usual,
            other => other.times().usual,
        }
    }

    /// Waits until COMMAND is 0, so that `operation` may be begun.
    fn await_idle<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        operation: Operation,
    ) -> PortResult<(), B> {
        if self.machine.is_idle() {
            return Ok(());
        }
        let channels = self.machine.in_flight().map(Operation::channels);
        let channels = channels.unwrap_or_default();
        let mut snapshot = Snapshot::new(self, channels.iter(), Wanted::Cs);
        let waiting_for = WaitingFor::Idle(operation.command());
        self.poll(bus, &mut snapshot, waiting_for, |port, _| {
            port.machine.is_idle().then_some(())
        })
    }

    /// Writes `writes` and then the command of `operation`, which must be allowed now, in one
    /// exchange.
    pub(super) fn issue<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        operation: Operation,
        writes: &[(u16, u32)],
    ) -> PortResult<(), B> {
        bus.wait(SETTLE);
        let command = self.machine.begin(operation);
        let command_write = [(self.layout.command(), command.word())];
        let all = || writes.iter().chain(&command_write);
        let mut words: Vec<u32> = all().map(|&(_, word)| word).collect();
        let accesses: Vec<Access> = (0u16..)
            .zip(all())
            .map(|(n, &(address, _))| Access::write(address, n, 1))
            .collect();
        let result = bus.exchange(&accesses, &mut words);
        self.machine.written(bus.now(), result.is_ok());
        Ok(result?)
    }

    /// Frees a port whose COMMAND never clears: the one write that is allowed while it is busy.
    ///
    /// What kept it busy must be over: the way out ends the waiting and not the transfer (FACTS
    /// 3.2), and the STOPALL that follows would stick again.
    pub(super) fn free<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        self.run(bus, Operation::Free, &[], Wanted::Nothing)?;
        Ok(())
    }

    /// Reads `snapshot` until what the machine says of it is the end, or that the port is stuck.
    fn poll<B: RegisterBus + Clock, T>(
        &mut self,
        bus: &mut B,
        snapshot: &mut Snapshot,
        waiting_for: WaitingFor,
        end: impl Fn(&Self, Event) -> Option<T>,
    ) -> PortResult<T, B> {
        let begin = bus.now();
        let mut pause = FIRST_POLL;
        for _ in 0..MOST_POLLS {
            bus.exchange(&snapshot.accesses, &mut snapshot.words)?;
            let now = bus.now();
            let event = self.machine.observe(now, snapshot, true);
            if let Some(end) = end(self, event) {
                return Ok(end);
            }
            if self.machine.is_stuck(now) {
                break;
            }
            if let Event::Settling(until) = event {
                bus.wait(until.since(now));
            } else {
                bus.wait(pause);
                pause = (pause * 2).min(LONGEST_POLL);
            }
        }
        let since = self.machine.issued().unwrap_or(begin);
        let waited = bus.now().since(since);
        Err(self.wait_error(bus, waiting_for, waited)?.into())
    }

    /// The error of a wait that has ended, with the registers as they are now.
    pub(super) fn wait_error<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        waiting_for: WaitingFor,
        waited: Duration,
    ) -> PortResult<WaitError, B> {
        let all = self.layout.mask();
        let mut snapshot = Snapshot::new(self, all.iter(), Wanted::Cs);
        bus.exchange(&snapshot.accesses, &mut snapshot.words)?;
        Ok(WaitError {
            port: self.layout.instance(),
            waiting_for,
            waited,
            registers: Registers {
                command: snapshot.command(),
                data: snapshot.status(),
                channels: self.layout.channels(),
                cs: Channel::ALL.map(|channel| snapshot.channel_status(channel)),
            },
        })
    }
}
