//! Running an operation of the machine to its end, with the only waits of a port.

use super::{PortResult, SetupPort};
use crate::{
    advice,
    bus::{Access, Clock, RegisterBus},
    sslbp::{
        Channel, CompletedOperation, CsStatus, MAX_CHANNELS, PortError, PortEvent, PortImage,
        PortOperation,
    },
};
use alloc::{format, string::ToString, vec::Vec};
use core::fmt::{self, Write};
use core::time::Duration;

/// Between COMMAND reading 0 and the next write: a write within 20 ns is lost (FACTS 3.4).
const SETTLE: Duration = Duration::from_nanos(200);

/// Time between polls: short at first, and at most this long.
const FIRST_POLL: Duration = Duration::from_micros(2);
const LONGEST_POLL: Duration = Duration::from_micros(250);

/// Ends a wait even on a bus whose clock does not advance.
const MAX_POLLS: u32 = 20_000;

/// CS and interface registers 0 to 2 of a channel.
const PER_CHANNEL: usize = 1 + 3;
const WORDS: usize = 2 + MAX_CHANNELS as usize * PER_CHANNEL;

/// The registers of a port that an operation changes, from the last read: COMMAND, DATA, and CS and
/// interface registers of its channels. One exchange reads them all, so that their contents are
/// valid if COMMAND reads 0.
pub(super) struct PortSnapshot {
    accesses: Vec<Access>,
    words: [u32; WORDS],
}

impl PortSnapshot {
    fn new(port: &super::Port, operation: &PortOperation) -> Self {
        let mut accesses = Vec::new();
        let mut read = |address, place| accesses.push(Access::read(address, place as u16, 1));
        read(port.layout.command, 0);
        read(port.layout.data(), 1);
        let interfaces = match operation {
            PortOperation::Start(..) => 3,
            PortOperation::Access(..) => 2,
            PortOperation::StopAll
            | PortOperation::Stop(_)
            | PortOperation::Transfer(_)
            | PortOperation::ReadLocal(_)
            | PortOperation::WriteLocal(_)
            | PortOperation::Free
            | PortOperation::Reset
            | PortOperation::Release
            | PortOperation::Foreign => 0,
        };
        for channel in operation.channels().iter() {
            let Some(registers) = port.layout.channel(channel) else {
                continue;
            };
            let addresses = registers.interfaces().take(interfaces);
            let addresses = core::iter::once(registers.cs).chain(addresses);
            for (place, address) in (Self::place(channel)..).zip(addresses) {
                read(address, place);
            }
        }
        Self {
            accesses,
            words: [0; WORDS],
        }
    }

    const fn place(channel: Channel) -> usize {
        2 + PER_CHANNEL * channel.index() as usize
    }

    fn word(&self, place: usize) -> u32 {
        let word = self.words.get(place);
        debug_assert!(word.is_some(), "the place of another channel");
        word.copied().unwrap_or(0)
    }

    /// CS of `channel`.
    pub fn status(&self, channel: Channel) -> CsStatus {
        CsStatus(self.cs(channel))
    }

    /// The interface registers of `channel`; registers that were not read are 0.
    pub fn interface<const N: usize>(&self, channel: Channel) -> [u32; N] {
        core::array::from_fn(|n| self.word(Self::place(channel) + 1 + n))
    }
}

impl PortImage for PortSnapshot {
    fn command(&self) -> u32 {
        self.word(0)
    }

    fn data(&self) -> u32 {
        self.word(1)
    }

    fn cs(&self, channel: Channel) -> u32 {
        self.word(Self::place(channel))
    }

    fn interfaces(&self, channel: Channel) -> [u32; 3] {
        self.interface(channel)
    }
}

impl<B: RegisterBus + Clock> SetupPort<'_, B> {
    /// Runs `operation`: waits until the port is idle, writes `writes` and then COMMAND, and waits
    /// until the operation is complete.
    pub(super) fn run(
        &mut self,
        operation: PortOperation,
        writes: &[(u16, u32)],
    ) -> PortResult<(CompletedOperation, PortSnapshot)> {
        if !operation.interrupts() && !self.port.machine.is_idle() {
            let in_flight = self.port.machine.in_flight();
            let before = in_flight.map_or(PortOperation::Foreign, |(operation, _)| operation);
            let mut snapshot = PortSnapshot::new(self.port, &before);
            let waiting_for = format_args!("COMMAND to be 0 before {operation}");
            self.poll(&mut snapshot, before, waiting_for, |port, _| {
                port.port.machine.is_idle().then_some(())
            })?;
        }
        self.issue(operation, writes)?;
        let mut snapshot = PortSnapshot::new(self.port, &operation);
        self.bus.wait(operation.times().usual);
        let waiting_for = format_args!("COMMAND to be 0 after {operation}");
        let complete = self.poll(
            &mut snapshot,
            operation,
            waiting_for,
            |_, event| match event {
                PortEvent::Complete(complete) => Some(complete),
                _ => None,
            },
        )?;
        Ok((complete, snapshot))
    }

    /// Writes `writes` and then the command of `operation`, which must be allowed now, in one
    /// exchange.
    pub(super) fn issue(
        &mut self,
        operation: PortOperation,
        writes: &[(u16, u32)],
    ) -> PortResult<()> {
        self.bus.wait(SETTLE);
        let command = (self.port.layout.command, self.port.machine.begin(operation));
        let (accesses, mut words) = Access::writes(writes.iter().copied().chain([command]));
        let result = self.bus.exchange(&accesses, &mut words);
        self.port.machine.written(self.bus.now(), result.is_ok());
        Ok(result?)
    }

    /// Reads `snapshot` until `end` accepts the machine's event, or the port is stuck.
    fn poll<T>(
        &mut self,
        snapshot: &mut PortSnapshot,
        operation: PortOperation,
        waiting_for: fmt::Arguments<'_>,
        end: impl Fn(&Self, PortEvent) -> Option<T>,
    ) -> PortResult<T> {
        let begin = self.bus.now();
        let mut pause = FIRST_POLL;
        for _ in 0..MAX_POLLS {
            self.bus.exchange(&snapshot.accesses, &mut snapshot.words)?;
            let now = self.bus.now();
            let event = self.port.machine.observe(now, snapshot, true);
            if let Some(end) = end(self, event) {
                return Ok(end);
            }
            if self.port.machine.is_stuck(now) {
                break;
            }
            if let PortEvent::Settling(until) = event {
                self.bus.wait(until.since(now));
            } else {
                self.bus.wait(pause);
                pause = (pause * 2).min(LONGEST_POLL);
            }
        }
        let since = self
            .port
            .machine
            .in_flight()
            .map_or(begin, |(_, issued)| issued);
        let waited = self.bus.now().since(since);
        let can_stop = !operation.interrupts();
        Err(self.timeout(waited, waiting_for, can_stop)?)
    }

    /// The error of a wait that has ended, with the present registers.
    pub(super) fn timeout(
        &mut self,
        waited: Duration,
        waiting_for: fmt::Arguments<'_>,
        can_stop: bool,
    ) -> PortResult<PortError> {
        let mut snapshot = PortSnapshot::new(self.port, &PortOperation::StopAll);
        self.bus.exchange(&snapshot.accesses, &mut snapshot.words)?;
        let (command, data) = (snapshot.command(), snapshot.data() as u8);
        let mut registers = format!("COMMAND {command:04X}, DATA {data:02X}, CS");
        for channel in self.port.layout.mask().iter() {
            // Writing to a string cannot fail.
            let _ = write!(registers, " {:08X}", snapshot.cs(channel));
        }
        let (finding, advice) = if command == u32::MAX {
            let finding = " (all ones: there is no board at this address)";
            (finding, advice::CHECK_BOARD_ADDRESS)
        } else if can_stop {
            ("", advice::STOP_ALL)
        } else {
            let finding = "; the interface processor does not run";
            (finding, advice::RELOAD_FPGA)
        };
        registers.push_str(finding);
        Ok(PortError::Timeout {
            port: self.port.layout.instance,
            waiting_for: waiting_for.to_string(),
            waited,
            registers,
            advice: Some(advice),
        })
    }
}
