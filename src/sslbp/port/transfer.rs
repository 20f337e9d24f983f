//! One DOIT of process data, the manual's two ways.

use super::{Port, PortResult, wait::Expected};
use crate::{
    bus::{Access, Clock, RegisterBus},
    sslbp::{
        Channel, ChannelMask, Command, CsStatus, DataStatus, DoitTime, Exchange, MAX_CHANNELS,
        MAX_INTERFACE_REGISTERS, PortState, ProcessDataSizes,
    },
};
use alloc::{vec, vec::Vec};
use core::time::Duration;

/// A DOIT ends within its timeout, whatever the remotes do (FACTS 5.2); generous for low baud
/// rates.
const LIMIT: Duration = Duration::from_millis(100);

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
        if mask.is_empty() {
            return Ok(Transfer::default());
        }
        let writes = self.output_writes::<B>(mask, outputs)?;
        let reads = self.input_reads::<B>(mask)?;
        let command = Command::doit(mask);
        let expected = self.doit_expected(mask);
        let poll = self.execute(bus, command, &writes, reads, expected)?;
        Ok(self.sort_inputs(mask, poll.data(), poll.others()))
    }

    /// Write-before-read: takes the inputs of the DOIT before, writes `outputs` and starts the
    /// next DOIT without waiting for it. `None` with the first call, and after a call with an
    /// empty mask.
    ///
    /// The order is the manual's: COMMAND must be 0 (else the cycle is too short), DATA, inputs,
    /// outputs, DOIT.
    ///
    /// Manual: 7I77, "NORMAL MODE OPERATION", steps 6 to 10.
    pub fn transfer_cyclic<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        before: ChannelMask,
        mask: ChannelMask,
        outputs: &PortWords,
    ) -> PortResult<Option<Transfer>, B> {
        self.require_running(PortState::Normal, mask.union(before))?;
        let command = Command::doit(mask);
        self.await_idle(bus, command)?;
        let transfer = if before.is_empty() {
            None
        } else {
            Some(self.read_inputs(bus, before)?)
        };
        if !mask.is_empty() {
            let writes = self.output_writes::<B>(mask, outputs)?;
            self.issue(bus, command, &writes)?;
        }
        Ok(transfer)
    }

    /// Reads DATA, CS and the inputs of a DOIT that is complete.
    fn read_inputs<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        mask: ChannelMask,
    ) -> PortResult<Transfer, B> {
        let mut addresses = Vec::from([self.layout.data()]);
        addresses.extend(self.input_reads::<B>(mask)?);
        let mut words = vec![0; addresses.len()];
        let accesses: Vec<_> = (0u16..)
            .zip(&addresses)
            .map(|(n, &address)| Access::read(address, n, 1))
            .collect();
        bus.exchange(&accesses, &mut words)?;
        let (data, inputs) = words.split_first().unwrap_or((&0, &[]));
        Ok(self.sort_inputs(mask, DataStatus::from_register(*data), inputs))
    }

    fn output_writes<B: RegisterBus + Clock>(
        &self,
        mask: ChannelMask,
        outputs: &PortWords,
    ) -> PortResult<Vec<(u16, u32)>, B> {
        let mut writes = Vec::new();
        for channel in mask.iter() {
            let addresses = self
                .registers(channel)?
                .interfaces_for(self.size(channel).tx);
            writes.extend(addresses.zip(outputs.channel(channel).iter().copied()));
        }
        Ok(writes)
    }

    /// CS and interface registers of the channels of `mask`.
    fn input_reads<B: RegisterBus + Clock>(&self, mask: ChannelMask) -> PortResult<Vec<u16>, B> {
        let mut reads = Vec::new();
        for channel in mask.iter() {
            let registers = self.registers(channel)?;
            reads.push(registers.cs());
            reads.extend(registers.interfaces());
        }
        Ok(reads)
    }

    fn sort_inputs(&self, mask: ChannelMask, data: DataStatus, words: &[u32]) -> Transfer {
        let mut transfer = Transfer {
            asked: mask,
            failed: data.failed(mask),
            ..Transfer::default()
        };
        let per_channel = 1 + usize::from(self.layout.interface_registers());
        for (channel, words) in mask.iter().zip(words.chunks(per_channel)) {
            let (cs, inputs) = words.split_first().unwrap_or((&0, &[]));
            if let Some(slot) = transfer.cs.get_mut(usize::from(channel.index())) {
                *slot = CsStatus::from_register(*cs);
            }
            transfer.inputs.set(channel, inputs);
        }
        transfer
    }

    fn doit_expected(&self, mask: ChannelMask) -> Expected {
        let exchanges = mask
            .iter()
            .map(|channel| Exchange::usual(channel, self.size(channel)));
        let time = DoitTime::expected(self.processor(), exchanges);
        Expected {
            usual: time.usual,
            limit: LIMIT,
        }
    }

    fn size(&self, channel: Channel) -> ProcessDataSizes {
        let size = self.sizes.get(usize::from(channel.index()));
        size.copied().unwrap_or_default()
    }
}
