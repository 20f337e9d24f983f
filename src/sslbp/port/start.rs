//! Normal and setup START.

use super::{Port, PortResult, wait::Expected};
use crate::{
    bus::{Clock, RegisterBus},
    discovery::RemoteName,
    sslbp::{
        Channel, ChannelMask, ComState, Command, CsStatus, DataStatus, FailedRegisters, Needed,
        PortState, ProcessDataSizes, StartFailure, StartFailureReason, StartReport, StartedRemote,
        software_mode_word,
    },
};
use alloc::vec::Vec;
use core::time::Duration;

/// FACTS 3: 1.0 to 1.13 ms; 17 ms if a remote is absent, and more when it has errors. Low baud
/// rates take longer.
const NORMAL: Expected = Expected {
    usual: Duration::from_millis(1),
    limit: Duration::from_millis(500),
};

/// FACTS 3: 1.8 ms; 55 ms if a remote is absent.
const SETUP: Expected = Expected {
    usual: Duration::from_micros(1_800),
    limit: Duration::from_secs(1),
};

/// A channel that has started is ready at once in all transcripts; others are given 20 ms.
const READY_POLLS: u8 = 20;
const READY_PAUSE: Duration = Duration::from_millis(1);

/// Which START.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StartMode {
    /// For process data. Manual: 7I77, "NORMAL START".
    Normal,
    /// For pass-through accesses. Manual: 7I77, "SETUP MODE OPERATION".
    Setup,
}

impl StartMode {
    const fn command(self, mask: ChannelMask) -> Command {
        match self {
            Self::Normal => Command::start(mask),
            Self::Setup => Command::setup_start(mask),
        }
    }

    const fn expected(self) -> Expected {
        match self {
            Self::Normal => NORMAL,
            Self::Setup => SETUP,
        }
    }

    const fn state(self) -> PortState {
        match self {
            Self::Normal => PortState::Normal,
            Self::Setup => PortState::Setup,
        }
    }

    /// Whether a channel that was stopped before has come through this START.
    fn is_complete(self, cs: CsStatus) -> bool {
        let has_arrived = match self {
            Self::Normal => matches!(cs.state(), ComState::Chatter | ComState::ProcessData7i64),
            Self::Setup => cs.state() == ComState::PassThrough,
        };
        has_arrived && cs.is_ready()
    }
}

/// A channel to start, and in which software mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ChannelStart {
    /// The channel.
    pub channel: Channel,
    /// The software mode; any byte, the remote decides.
    pub software_mode: u8,
}

impl ChannelStart {
    /// `channel` in software mode 0.
    pub const fn new(channel: Channel) -> Self {
        Self {
            channel,
            software_mode: 0,
        }
    }

    /// The same channel in another software mode.
    #[must_use]
    pub const fn with_software_mode(mut self, software_mode: u8) -> Self {
        self.software_mode = software_mode;
        self
    }
}

/// CS and interface registers of a channel after START.
struct AfterStart {
    cs: CsStatus,
    interface: [u32; 3],
}

impl Port {
    /// Starts `channels`, each in its software mode, and reports what became of each of them.
    ///
    /// A channel that fails does not fail the others: it is in the report, with the reason.
    /// The channels must be stopped: START ignores those that run (FACTS 3.5), and normal and
    /// setup mode do not go together (FACTS 3.6).
    pub fn start<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mode: StartMode,
        channels: &[ChannelStart],
    ) -> PortResult<StartReport, B> {
        let mask = channels.iter().map(|start| start.channel).collect();
        self.require_startable::<B>(mode, mask)?;
        let mut report = StartReport::default();
        if mask.is_empty() {
            return Ok(report);
        }
        let data = self.run_start(bus, mode, mask, channels)?;
        for start in channels {
            let outcome = self.outcome(bus, mode, *start, data)?;
            report.set(start.channel, outcome);
            if let Ok(remote) = outcome {
                self.admit(mode, &remote);
            }
        }
        self.silence_too_large(bus, &report)?;
        Ok(report)
    }

    fn require_startable<B: RegisterBus + Clock>(
        &self,
        mode: StartMode,
        mask: ChannelMask,
    ) -> PortResult<(), B> {
        self.known_parameters()?;
        self.require_existing(mask)?;
        let same_mode = self.state == PortState::Stopped
            || self.running.is_empty() && self.state != PortState::Unknown
            || self.state == mode.state();
        if same_mode && self.running.intersection(mask).is_empty() {
            Ok(())
        } else {
            Err(self.wrong_state(Needed::Stopped))
        }
    }

    fn run_start<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mode: StartMode,
        mask: ChannelMask,
        channels: &[ChannelStart],
    ) -> PortResult<DataStatus, B> {
        let mut writes = Vec::new();
        for start in channels {
            let cs = self.registers(start.channel)?.cs();
            writes.push((cs, software_mode_word(start.software_mode)));
        }
        let poll = self.execute(bus, mode.command(mask), &writes, [], mode.expected())?;
        Ok(poll.data())
    }

    fn outcome<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mode: StartMode,
        start: ChannelStart,
        data: DataStatus,
    ) -> PortResult<Result<StartedRemote, StartFailure>, B> {
        let ChannelStart {
            channel,
            software_mode,
        } = start;
        if !data.has_failed(channel) {
            self.await_ready(bus, channel)?;
        }
        let AfterStart { cs, interface } = self.after_start(bus, channel)?;
        // DATA says FF of a START that the network delivered twice (FACTS 3.3); CS knows better.
        let has_failed = data.has_failed(channel) && !mode.is_complete(cs);
        let sizes = self.process_data_sizes(bus, channel)?;
        let limit = ProcessDataSizes::largest(self.layout.interface_registers());
        let too_large = mode == StartMode::Normal && !sizes.fit(limit);
        if has_failed || !cs.is_ready() || too_large {
            let registers = FailedRegisters {
                cs,
                interface,
                sizes,
                limit,
            };
            return Ok(Err(StartFailure {
                channel,
                software_mode,
                reason: StartFailureReason::from_registers(&registers),
                cs,
            }));
        }
        let [unit_number, name, tables] = interface;
        Ok(Ok(StartedRemote {
            channel,
            software_mode,
            unit_number,
            name: RemoteName::from_register(name),
            ptoc: tables as u16,
            gtoc: (tables >> 16) as u16,
            sizes,
            cs,
        }))
    }

    /// Waits a while until CS says that the channel is ready for accesses.
    ///
    /// LinuxCNC waits before each access for all of byte 1 to be 0 (FACTS 6.1). Its
    /// communication-error bit is sticky, though, so that one lost reply would make that wait for
    /// ever; and only a stop makes a ready channel not ready again.
    fn await_ready<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        channel: Channel,
    ) -> PortResult<(), B> {
        let address = self.registers(channel)?.cs();
        for _ in 0..READY_POLLS {
            if CsStatus::from_register(bus.read(address)?).is_ready() {
                break;
            }
            bus.wait(READY_PAUSE);
        }
        Ok(())
    }

    fn after_start<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        channel: Channel,
    ) -> PortResult<AfterStart, B> {
        let registers = self.registers(channel)?;
        let mut interface = [0; 3];
        let cs = bus.read(registers.cs())?;
        for (word, address) in interface.iter_mut().zip(registers.interfaces()) {
            *word = bus.read(address)?;
        }
        Ok(AfterStart {
            cs: CsStatus::from_register(cs),
            interface,
        })
    }

    fn admit(&mut self, mode: StartMode, remote: &StartedRemote) {
        self.state = mode.state();
        self.running = self.running.union(remote.channel.mask());
        let slot = self.sizes.get_mut(usize::from(remote.channel.index()));
        if let Some(slot) = slot {
            *slot = remote.sizes;
        }
    }

    /// A remote whose process data is too large runs all the same, and would keep its line busy.
    fn silence_too_large<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        report: &StartReport,
    ) -> PortResult<(), B> {
        let too_large = report.failures().filter(|failure| {
            matches!(failure.reason, StartFailureReason::SizesTooLarge { .. })
                && failure.cs.is_ready()
        });
        let mask = too_large.map(|failure| failure.channel).collect();
        self.stop(bus, mask)
    }
}
