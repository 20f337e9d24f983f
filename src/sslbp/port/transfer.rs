//! One DOIT of process data.

use super::{Port, PortResult, run::Wanted};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, ChannelMask, CsStatus, DoitTime, Exchange, MAX_CHANNELS, MAX_INTERFACE_REGISTERS,
        PortState,
        machine::{Operation, Verdict},
    },
};
use alloc::vec::Vec;

/// The interface registers of one channel; those that the layout does not have are not used.
pub type ChannelWords = [u32; MAX_INTERFACE_REGISTERS as usize];

/// The interface registers of all channels of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortWords([ChannelWords; MAX_CHANNELS as usize]);

impl PortWords {
    /// Those of `channel`.
    pub fn channel(&self, channel: Channel) -> &ChannelWords {
        let Self(words) = self;
        // A channel is one of the eight by construction.
        words
            .get(usize::from(channel.index()))
            .unwrap_or(&[0; MAX_INTERFACE_REGISTERS as usize])
    }

    /// Sets the first words of `channel`; the others become 0.
    pub fn set(&mut self, channel: Channel, words: &[u32]) {
        if let Some(slot) = self.0.get_mut(usize::from(channel.index())) {
            *slot = [0; MAX_INTERFACE_REGISTERS as usize];
            for (to, &from) in slot.iter_mut().zip(words) {
                *to = from;
            }
        }
    }
}

/// What a DOIT brought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfer {
    /// The channels that were asked for.
    pub asked: ChannelMask,
    /// Those of them without a good reply: their words are the last good ones, not new.
    pub failed: ChannelMask,
    /// CS of each channel that was asked for; a remote fault shows only here (FACTS 5.3).
    pub cs: [CsStatus; MAX_CHANNELS as usize],
    /// The input process data.
    pub inputs: PortWords,
}

impl Transfer {
    /// CS of `channel`.
    pub fn status(&self, channel: Channel) -> CsStatus {
        let cs = self.cs.get(usize::from(channel.index()));
        cs.copied().unwrap_or_default()
    }
}

impl Port {
    /// Read-modify-write: writes `outputs`, runs a DOIT of the channels of `mask`, waits for it
    /// and reads their inputs.
    ///
    /// Manual: 7I77, "NORMAL MODE OPERATION", last paragraph.
    pub fn transfer<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mask: ChannelMask,
        outputs: &PortWords,
    ) -> PortResult<Transfer, B> {
        self.require_running(PortState::Normal, mask)?;
        let mut transfer = Transfer {
            asked: mask,
            ..Transfer::default()
        };
        if mask.is_empty() {
            return Ok(transfer);
        }
        let mut writes = Vec::new();
        for channel in mask.iter() {
            let sizes = self.machine.link(channel).sizes();
            let addresses = self.registers(channel)?.interfaces_for(sizes.tx);
            writes.extend(addresses.zip(outputs.channel(channel).iter().copied()));
        }
        let wanted = Wanted::Interface(self.layout.interface_registers());
        let (complete, snapshot) = self.run(bus, Operation::Transfer(mask), &writes, wanted)?;
        let has_failed =
            |channel: &Channel| matches!(self.machine.link(*channel).verdict(), Verdict::Failed(_));
        transfer.failed = complete.bad.iter().filter(has_failed).collect();
        for channel in mask.iter() {
            if let Some(cs) = transfer.cs.get_mut(usize::from(channel.index())) {
                *cs = snapshot.channel_status(channel);
            }
            let inputs: ChannelWords = snapshot.interface(channel);
            transfer.inputs.set(channel, &inputs);
        }
        Ok(transfer)
    }

    /// How long a transfer of these channels takes, with the sizes that START told.
    pub fn doit_time(&self, mask: ChannelMask) -> DoitTime {
        let exchanges = mask
            .iter()
            .map(|channel| Exchange::usual(channel, self.machine.link(channel).sizes()));
        DoitTime::expected(self.processor(), exchanges)
    }
}
