//! Normal and setup START.

use super::{
    Port, PortResult,
    run::{Snapshot, Wanted},
};
use crate::{
    bus::{Clock, RegisterBus},
    discovery::RemoteName,
    sslbp::{
        Channel, ChannelMask, FailedRegisters, Needed, PortState, ProcessDataSizes, ReplyFormat,
        StartFailure, StartFailureReason, StartReport, StartedRemote,
        machine::{Complete, Operation, StartMode, software_mode_word},
    },
};
use alloc::vec::Vec;

/// Interface registers that START tells something in.
const TOLD: u8 = 3;

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
        let mut writes = Vec::new();
        for start in channels {
            let cs = self.registers(start.channel)?.cs();
            writes.push((cs, software_mode_word(start.software_mode)));
        }
        let operation = Operation::Start(mode, mask);
        let ended = self.run(bus, operation, &writes, Wanted::Interface(TOLD))?;
        for start in channels {
            let outcome = self.outcome(bus, mode, *start, &ended)?;
            report.set(start.channel, outcome);
            if let Ok(remote) = outcome {
                let data_only = remote.reply_format() == ReplyFormat::DataOnly;
                self.machine
                    .set_sizes(start.channel, remote.sizes, data_only);
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
        let (state, running) = (self.state(), self.running());
        let same_mode = state == PortState::Stopped
            || running.is_empty() && state != PortState::Unknown
            || state == mode.state();
        if same_mode && running.intersection(mask).is_empty() {
            Ok(())
        } else {
            Err(self.wrong_state(Needed::Stopped))
        }
    }

    fn outcome<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mode: StartMode,
        start: ChannelStart,
        (complete, snapshot): &(Complete, Snapshot),
    ) -> PortResult<Result<StartedRemote, StartFailure>, B> {
        let ChannelStart {
            channel,
            software_mode,
        } = start;
        let cs = snapshot.channel_status(channel);
        let interface = snapshot.interface(channel);
        let sizes = self.process_data_sizes(bus, channel)?;
        let limit = ProcessDataSizes::largest(self.layout.interface_registers());
        let too_large = mode == StartMode::Normal && !sizes.fit(limit);
        if !complete.good.contains(channel) || too_large {
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

    /// A remote whose process data is too large runs all the same, and would keep its line busy.
    fn silence_too_large<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        report: &StartReport,
    ) -> PortResult<(), B> {
        let failed: ChannelMask = report.failures().map(|failure| failure.channel).collect();
        self.stop(bus, failed.intersection(self.running()))
    }
}
