//! Encoders in the cycle.

use alloc::format;
use alloc::vec::Vec;

use crate::bus::{ImagePlan, ReadSlot, Tier, WritePhase, WriteSlot};
use crate::driver::{Module, Put, SetupList, Take};
use crate::hal::{GroupId, InOut, Input, Output, OutputRule, Param, PinError, Pins, Spec};
use crate::hostmot2::{
    ControlWord, CountWord, Encoder, EncoderConfig, EncoderReading, EncoderSample, Encoders, Gtag,
    HostMot2, LatchRequest, LocateError, ModuleError, PortPlan, TickRate,
};

/// How encoders are set up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncoderSetup {
    /// How many are used; `None` for all that the firmware has.
    pub count: Option<u8>,
    /// How they count at first; scale and most of the rest can be changed by parameters.
    pub config: EncoderConfig,
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
    mode: Option<WriteSlot>,
    was_index_enabled: bool,
}

/// LinuxCNC's pins of an encoder.
#[derive(Clone, Copy, Debug)]
struct EncoderPins {
    rawcounts: Input<i32>,
    count: Input<i32>,
    position: Input<f64>,
    velocity: Input<f64>,
    velocity_rpm: Input<f64>,
    position_latched: Input<f64>,
    quad_error: Input<bool>,
    inputs: [Input<bool>; 3],
    reset: Output<bool>,
    index_enable: InOut<bool>,
    scale: Param<f64>,
    counter_mode: Param<bool>,
    filter: Param<bool>,
    index_invert: Param<bool>,
    index_mask: Param<bool>,
    index_mask_invert: Param<bool>,
    vel_timeout: Param<f64>,
}

impl EncoderModule {
    /// The encoders of a firmware, if it has any; their pins are taken in `plan`.
    pub fn build(
        firmware: &HostMot2,
        setup: &EncoderSetup,
        plan: &mut PortPlan,
        pins: &mut Pins,
        group: GroupId,
        board: &str,
    ) -> Result<Option<Self>, EncoderBuildError> {
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
        let mut channels = Vec::new();
        for index in 0..count {
            channels.push(Channel {
                encoder: Encoder::new(setup.config, tick_hz),
                pins: EncoderPins::new(pins, group, board, index, &setup.config)?,
                count: None,
                control: None,
                mode: None,
                was_index_enabled: false,
            });
        }
        Ok(Some(Self {
            registers,
            rate: setup.rate.unwrap_or_else(|| usual_rate(firmware)),
            timestamps,
            channels,
            timestamp: None,
        }))
    }
}

/// Why encoders can not be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(in crate::driver) enum EncoderBuildError {
    #[error(transparent)]
    Locate(#[from] LocateError),
    #[error(transparent)]
    Io(#[from] crate::hostmot2::PinError),
    #[error(transparent)]
    Pin(#[from] PinError),
}

impl From<ModuleError> for EncoderBuildError {
    fn from(error: ModuleError) -> Self {
        Self::Locate(error.into())
    }
}

/// The multiplexer rate that the board is made for (manuals: 7I77 and 7I97, "MAXIMUM ENCODER
/// COUNT RATE").
fn usual_rate(firmware: &HostMot2) -> TickRate {
    if firmware.idrom().board_name.0.ends_with(b"7I97") {
        TickRate::MUX_7I97
    } else {
        TickRate::MUX_7I77
    }
}

/// Multiplexed encoders share pins in pairs, which carry the number of the pair, and need the
/// select line.
fn take_pins(
    firmware: &HostMot2,
    gtag: Gtag,
    count: u8,
    plan: &mut PortPlan,
) -> Result<(), crate::hostmot2::PinError> {
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

    fn restarted(&mut self) {
        let tick_hz = self.timestamps.hz(self.registers.clock_hz());
        for channel in &mut self.channels {
            channel.encoder = Encoder::new(*channel.encoder.config(), tick_hz);
            channel.was_index_enabled = false;
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
            channel.mode =
                control.map(|address| plan.write(WritePhase::Data, Tier::Cycle, address, 1, word));
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
            channel.configure(cycle.pins);
            let before = channel.encoder.requested();
            let reading = channel.encoder.read(EncoderSample {
                count: CountWord(count),
                control: ControlWord(control),
                timestamp: timestamp as u16,
                at: cycle.now,
            });
            let found_index =
                before == LatchRequest::Index && channel.encoder.requested() != before;
            channel.pins.publish(cycle.pins, &reading);
            if found_index {
                channel.was_index_enabled = false;
                cycle.pins.publish_inout(channel.pins.index_enable, false);
            }
        }
    }

    fn put(&mut self, cycle: &mut Put<'_>) {
        for channel in &mut self.channels {
            let enabled = cycle.pins.fetch_inout(channel.pins.index_enable);
            if enabled != channel.was_index_enabled {
                channel.was_index_enabled = enabled;
                let request = if enabled {
                    LatchRequest::Index
                } else {
                    LatchRequest::None
                };
                channel.encoder.request(request);
            }
            if cycle.pins.fetch(channel.pins.reset) {
                channel.encoder.reset();
            }
            if let Some(mode) = channel.mode {
                cycle.image.put(mode, channel.encoder.control().0);
            }
        }
    }
}

impl Channel {
    /// Follows the parameters.
    fn configure(&mut self, pins: &Pins) {
        let of = &self.pins;
        let config = EncoderConfig {
            scale: pins.param(of.scale),
            up_down: pins.param(of.counter_mode),
            filter: pins.param(of.filter),
            index_high: !pins.param(of.index_invert),
            index_mask: pins.param(of.index_mask),
            index_mask_invert: pins.param(of.index_mask_invert),
            idle_time: pins.param(of.vel_timeout),
            ..*self.encoder.config()
        };
        if config != *self.encoder.config() {
            self.encoder.set_config(config);
        }
    }
}

impl EncoderPins {
    fn new(
        pins: &mut Pins,
        group: GroupId,
        board: &str,
        index: u8,
        config: &EncoderConfig,
    ) -> Result<Self, PinError> {
        let name = |pin: &str| Spec::new(format!("{board}.encoder.{index:02}.{pin}"));
        let off = OutputRule::safe_at(false);
        Ok(Self {
            rawcounts: pins.add_input(group, name("rawcounts"))?,
            count: pins.add_input(group, name("count"))?,
            position: pins.add_input(group, name("position"))?,
            velocity: pins.add_input(group, name("velocity"))?,
            velocity_rpm: pins.add_input(group, name("velocity-rpm"))?,
            position_latched: pins.add_input(group, name("position-latched"))?,
            quad_error: pins.add_input(group, name("quad-error"))?,
            inputs: [
                pins.add_input(group, name("input-a"))?,
                pins.add_input(group, name("input-b"))?,
                pins.add_input(group, name("input-index"))?,
            ],
            reset: pins.add_output(group, name("reset"), off)?,
            index_enable: pins.add_inout(group, name("index-enable"), off)?,
            scale: pins.add_setting(group, name("scale"), config.usable_scale())?,
            counter_mode: pins.add_setting(group, name("counter-mode"), config.up_down)?,
            filter: pins.add_setting(group, name("filter"), config.filter)?,
            index_invert: pins.add_setting(group, name("index-invert"), !config.index_high)?,
            index_mask: pins.add_setting(group, name("index-mask"), config.index_mask)?,
            index_mask_invert: pins.add_setting(
                group,
                name("index-mask-invert"),
                config.index_mask_invert,
            )?,
            vel_timeout: pins.add_setting(group, name("vel-timeout"), config.idle_time)?,
        })
    }

    fn publish(&self, pins: &mut Pins, reading: &EncoderReading) {
        // LinuxCNC's counts have 32 bits and wrap; positions do not.
        pins.publish(self.rawcounts, reading.rawcounts as i32);
        pins.publish(self.count, reading.count as i32);
        pins.publish(self.position, reading.position);
        pins.publish(self.velocity, reading.velocity);
        pins.publish(self.velocity_rpm, reading.velocity * 60.0);
        pins.publish(self.quad_error, reading.quadrature_error);
        for (&pin, level) in self.inputs.iter().zip(reading.inputs) {
            pins.publish(pin, level);
        }
        if let Some(latched) = reading.latched {
            let scale = pins.param(self.scale);
            pins.publish(self.position_latched, latched as f64 / scale);
        }
    }
}
