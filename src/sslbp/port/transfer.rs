//! One DOIT of process data.

use super::{Port, PortResult};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        ChannelMask, CsStatus, DoitTime, Exchange, MAX_INTERFACE_REGISTERS, Operation, PerChannel,
        PortState, StartMode, Verdict,
    },
};
use alloc::vec::Vec;

/// The interface registers of each channel; those that the layout does not have are not used.
pub type PortWords = PerChannel<[u32; MAX_INTERFACE_REGISTERS as usize]>;

/// What a DOIT brought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfer {
    /// The channels without a good reply: their words are the last good ones, not new.
    pub failed: ChannelMask,
    /// CS of each channel that was asked for; a remote fault shows only here (FACTS 5.3).
    pub cs: PerChannel<CsStatus>,
    /// The input process data.
    pub inputs: PortWords,
}

impl Port {
    /// Read-modify-write: writes `outputs`, runs a DOIT of the channels of `mask`, waits for it
    /// and reads their inputs.
    ///
    /// Manual: 7I77, "NORMAL MODE OPERATION", last paragraph.
    ///
    /// # Errors
    /// A channel does not run in normal mode; the bus fails, or the DOIT does not end.
    pub fn transfer<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mask: ChannelMask,
        outputs: &PortWords,
    ) -> PortResult<Transfer, B> {
        self.require_running(PortState::Started(StartMode::Normal), mask)?;
        let mut transfer = Transfer::default();
        if mask.is_empty() {
            return Ok(transfer);
        }
        let mut writes = Vec::new();
        for channel in mask.iter() {
            let sizes = self.machine.link(channel).sizes;
            let addresses = self.registers(channel)?.interfaces_for(sizes.tx);
            writes.extend(addresses.zip(outputs[channel]));
        }
        let (_, snapshot) = self.run(bus, Operation::Transfer(mask), &writes)?;
        for channel in mask.iter() {
            if matches!(self.machine.link(channel).verdict, Verdict::Failed(_)) {
                transfer.failed = transfer.failed.union(channel.mask());
            }
            transfer.cs[channel] = snapshot.status(channel);
            transfer.inputs[channel] = snapshot.interface(channel);
        }
        Ok(transfer)
    }

    /// How long a transfer of these channels takes, with the sizes that START told. The processor
    /// counts as one of 100 MHz until the parameters have been read.
    pub(crate) fn doit_time(&self, mask: ChannelMask) -> DoitTime {
        let clock_hz = self.parameters.map_or(100_000_000, |known| known.clock_hz);
        let exchange = |channel| Exchange::usual(channel, self.machine.link(channel).sizes);
        let exchanges = mask.iter().map(exchange);
        DoitTime::expected(self.layout.channels, clock_hz, exchanges)
    }
}
