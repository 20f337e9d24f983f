//! Normal and setup START.

use super::{PortResult, SetupPort};
use crate::{
    advice,
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, ChannelMask, ChannelVariable, PortOperation, PortState, ProcessDataSizes,
        StartFailure, StartFailureReason, StartMode, StartedRemote, software_mode_word,
    },
};
use alloc::vec::Vec;

impl<B: RegisterBus + Clock> SetupPort<'_, B> {
    /// Starts `channels`, each in its software mode, and returns the result of each, in their
    /// order. Any byte is accepted as a software mode: the remote decides.
    ///
    /// A channel that fails does not affect the others: its place contains the reason. The channels
    /// must be stopped: START ignores running channels (FACTS 3.5), and normal and setup mode
    /// cannot be combined (FACTS 3.6).
    ///
    /// # Errors
    /// The port is not identified, a channel does not exist or is not stopped; the bus fails, or
    /// START does not end.
    pub fn start(
        &mut self,
        mode: StartMode,
        channels: &[(Channel, u8)],
    ) -> PortResult<Vec<Result<StartedRemote, StartFailure>>> {
        let mask = channels.iter().map(|&(channel, _)| channel).collect();
        self.require_startable(mode, mask)?;
        let mut outcomes = Vec::new();
        if mask.is_empty() {
            return Ok(outcomes);
        }
        let cs = |&(channel, software_mode): &(Channel, u8)| {
            let registers = self.port.layout.channel(channel)?;
            Some((registers.cs, software_mode_word(software_mode)))
        };
        let writes: Vec<_> = channels.iter().filter_map(cs).collect();
        let (complete, snapshot) = self.run(PortOperation::Start(mode, mask), &writes)?;
        let limit = ProcessDataSizes::largest(self.port.layout.interface_registers);
        let mut unusable = ChannelMask::NONE;
        for &(channel, software_mode) in channels {
            let (interfaces, cs) = (snapshot.interface(channel), snapshot.status(channel));
            let [rx, tx] = self.read_variable(channel, ChannelVariable::RxSize)?;
            let sizes = ProcessDataSizes { rx, tx };
            let remote = StartedRemote::new(channel, software_mode, interfaces, sizes, cs);
            let too_large = mode == StartMode::Normal && !remote.sizes.fit(limit);
            outcomes.push(if complete.good.contains(channel) && !too_large {
                self.port.machine.set_sizes(&remote);
                Ok(remote)
            } else {
                unusable = unusable.union(channel.mask());
                let reason = StartFailureReason::of(&remote, limit);
                Err(StartFailure {
                    channel,
                    reason,
                    cs,
                })
            });
        }
        // A remote with too much process data runs nevertheless, and would keep its line busy.
        self.stop(unusable.intersection(self.port.running()))?;
        Ok(outcomes)
    }

    fn require_startable(&self, mode: StartMode, mask: ChannelMask) -> PortResult<()> {
        self.known_parameters()?;
        self.require_existing(mask)?;
        let (state, running) = (self.port.state(), self.port.running());
        let same_mode = state == PortState::Stopped
            || running.is_empty() && state != PortState::Unknown
            || state == PortState::Started(mode);
        if same_mode && running.intersection(mask).is_empty() {
            Ok(())
        } else {
            Err(self.wrong_state("stopped channels".into(), Some(advice::STOP_ALL_FIRST)))
        }
    }
}
