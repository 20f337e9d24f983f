//! Encoders in the cycle.

use alloc::vec::Vec;

use crate::boards::fpga::{EncoderBankPins, EncoderPins};
use crate::bus::{ImagePlan, ReadSlot};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hostmot2::{
    ControlWord, CountWord, Encoder, EncoderConfig, EncoderSample, Encoders, Gtag, HostMot2,
    PortPlan, TickRate,
};

use super::{Making, PartError, Wiring};

/// How encoders are set up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderSetup {
    /// How many are used; `None` for all that the firmware has.
    pub count: Option<u8>,
    /// Rate of the multiplexer or of the filters; `None` for what the board is made for.
    pub rate: Option<TickRate>,
}

/// All encoders of a kind.
#[derive(Debug)]
pub(in crate::driver) struct EncoderModule {
    registers: Encoders,
    rate: TickRate,
    timestamps: TickRate,
    channels: Vec<Channel>,
    timestamp: Option<ReadSlot>,
}

#[derive(Debug)]
struct Channel {
    encoder: Encoder,
    pins: EncoderPins,
    count: Option<ReadSlot>,
    control: Option<ReadSlot>,
    mode: Option<SettingSlot>,
}

impl EncoderModule {
    /// The encoders of a firmware, if it has any; their pins are taken in `plan`.
    pub fn build(making: &mut Making<'_>, setup: &EncoderSetup) -> Result<Option<Self>, PartError> {
        let Making {
            firmware,
            plan,
            pins,
            group,
            board,
            made,
        } = making;
        let group = *group;
        let kinds = [Gtag::MUXED_ENCODER, Gtag::ENCODER];
        let Some(module) = kinds.into_iter().find_map(|gtag| firmware.find(gtag)) else {
            return Ok(None);
        };
        let registers = Encoders::locate(firmware, module.gtag)?;
        let all = registers.instances();
        let count = setup.count.unwrap_or(all).min(all);
        if count == 0 {
            return Ok(None);
        }
        take_pins(firmware, module.gtag, count, plan)?;
        let timestamps = TickRate::for_hz(registers.clock_hz(), TickRate::TIMESTAMP_HZ);
        let tick_hz = timestamps.hz(registers.clock_hz());
        let version = (module.gtag == Gtag::MUXED_ENCODER).then_some(module.version);
        let dpll = firmware.find(Gtag::HM2DPLL).is_some();
        made.encoder_bank = Some(EncoderBankPins::new(pins, group, board, version, dpll)?);
        let wiring = Wiring::of(firmware);
        let rate = setup.rate.unwrap_or_else(|| wiring.mux_rate());
        let fastest = registers.max_count_rate(rate);
        let mut channels = Vec::new();
        for number in 0..usize::from(count) {
            let terminals = wiring.encoder(number);
            let pins_of = EncoderPins::new(pins, group, board, number, terminals)?;
            channels.push(Channel {
                encoder: Encoder::new(pins_of.config(pins), tick_hz).counting_up_to(fastest),
                pins: pins_of,
                count: None,
                control: None,
                mode: None,
            });
        }
        made.encoders = channels.iter().map(|channel| channel.pins).collect();
        Ok(Some(Self {
            registers,
            rate,
            timestamps,
            channels,
            timestamp: None,
        }))
    }
}

/// Multiplexed encoders share pins in pairs, which carry the number of the pair, and need the
/// select line.
fn take_pins(
    firmware: &HostMot2,
    gtag: Gtag,
    count: u8,
    plan: &mut PortPlan,
) -> Result<(), crate::hostmot2::IoPinError> {
    let units = if gtag == Gtag::MUXED_ENCODER {
        plan.use_module(firmware, Gtag::MUX_SELECT, 0)?;
        count.div_ceil(2)
    } else {
        count
    };
    for unit in 0..units {
        plan.use_module(firmware, gtag, unit)?;
    }
    Ok(())
}

impl Module for EncoderModule {
    fn set_up(&self, list: &mut SetupList) {
        let configs: Vec<EncoderConfig> = self
            .channels
            .iter()
            .map(|channel| *channel.encoder.config())
            .collect();
        let done = self
            .registers
            .set_up(list, self.timestamps, self.rate, &configs);
        match done {
            Ok(()) => {}
            Err(never) => match never {},
        }
    }

    /// The counters may stand anywhere, and the counts go on from where they were.
    fn restarted(&mut self) {
        for channel in &mut self.channels {
            channel.encoder.resume();
        }
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        let registers = &self.registers;
        self.timestamp = Some(plan.read_data(registers.timestamp));
        for (index, channel) in (0u8..).zip(&mut self.channels) {
            let count = registers.count.address(index);
            let control = registers.control.address(index);
            channel.count = count.map(|address| plan.read_data(address));
            channel.control = control.map(|address| plan.read_data(address));
            let word = channel.encoder.control().0;
            channel.mode = control.map(|address| SettingSlot::claim(plan, address, word));
        }
    }

    fn take(&mut self, cycle: &mut Take<'_>) {
        let word = |slot: Option<ReadSlot>| slot.and_then(|slot| cycle.image.word(slot));
        let Some(timestamp) = word(self.timestamp) else {
            return;
        };
        for channel in &mut self.channels {
            let (Some(count), Some(control)) = (word(channel.count), word(channel.control)) else {
                continue;
            };
            let sample = EncoderSample {
                count: CountWord(count),
                control: ControlWord(control),
                timestamp: timestamp as u16,
                at: cycle.now,
            };
            channel.pins.take(cycle.pins, &mut channel.encoder, sample);
        }
    }

    fn put(&mut self, cycle: &mut Put<'_>) {
        for channel in &mut self.channels {
            channel.pins.command(cycle.pins, &mut channel.encoder);
            cycle.change(channel.mode, channel.encoder.control().0);
        }
    }
}
