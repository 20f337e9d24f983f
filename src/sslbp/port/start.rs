//! Normal and setup START.

use super::{Port, PortResult};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, ChannelMask, Operation, PortState, ProcessDataSizes, ReplyFormat, StartFailure,
        StartFailureReason, StartMode, StartReport, StartedRemote, software_mode_word,
    },
};
use alloc::vec::Vec;

impl Port {
    /// Starts `channels`, each in its software mode, and reports what became of each of them. Any
    /// byte is a software mode: the remote decides.
    ///
    /// A channel that fails does not fail the others: it is in the report, with the reason.
    /// The channels must be stopped: START ignores those that run (FACTS 3.5), and normal and
    /// setup mode do not go together (FACTS 3.6).
    ///
    /// # Errors
    /// The port is not identified, has no such channel, or they are not stopped; the bus fails, or
    /// START does not end.
    pub fn start<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mode: StartMode,
        channels: &[(Channel, u8)],
    ) -> PortResult<StartReport, B> {
        let mask = channels.iter().map(|&(channel, _)| channel).collect();
        self.require_startable::<B>(mode, mask)?;
        let mut report = StartReport::default();
        if mask.is_empty() {
            return Ok(report);
        }
        let mut writes = Vec::new();
        for &(channel, software_mode) in channels {
            let cs = self.registers(channel)?.cs;
            writes.push((cs, software_mode_word(software_mode)));
        }
        let (complete, snapshot) = self.run(bus, Operation::Start(mode, mask), &writes)?;
        let limit = ProcessDataSizes::largest(self.layout.interface_registers);
        for &start in channels {
            let (channel, _) = start;
            let (told, cs) = (snapshot.interface(channel), snapshot.status(channel));
            let sizes = self.process_data_sizes(bus, channel)?;
            let remote = StartedRemote::new(start, told, sizes, cs);
            let too_large = mode == StartMode::Normal && !sizes.fit(limit);
            if complete.good.contains(channel) && !too_large {
                let data_only = remote.reply_format() == ReplyFormat::DataOnly;
                self.machine.set_sizes(channel, sizes, data_only);
                report.remotes.push(remote);
            } else {
                let reason = StartFailureReason::of(&remote, limit);
                report.failures.push(StartFailure {
                    channel,
                    reason,
                    cs,
                });
            }
        }
        // A remote whose process data is too large runs all the same, and would keep its line busy.
        self.stop(bus, report.failed().intersection(self.running()))?;
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
            || state == PortState::Started(mode);
        if same_mode && running.intersection(mask).is_empty() {
            Ok(())
        } else {
            Err(self.wrong_state("stopped channels (call stop_all first)".into()))
        }
    }
}
