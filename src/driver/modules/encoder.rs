//! Encoders in the cycle.

use alloc::vec::Vec;

use crate::boards::fpga::{EncoderBankPins, EncoderPins};
use crate::bus::{ImagePlan, ReadSlot};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take, WriteNews};
use crate::hal::PinStore;
use crate::hostmot2::{
    ControlWord, CountWord, Encoder, EncoderConfig, EncoderSample, Encoders, Gtag, HostMot2,
    LatchTimer, MuxSkew, PortPlan, TickRate,
};

use super::{Making, PartError, Wiring};

pub use crate::modules::encoder::EncoderSetup;

/// All encoders of a kind.
#[derive(Debug)]
pub(in crate::driver) struct EncoderModule {
    registers: Encoders,
    bank: EncoderBankPins,
    initial: Settings,
    /// As they were put last.
    settings: Settings,
    channels: Vec<Channel>,
    timestamp: Option<ReadSlot>,
    slots: Option<Slots>,
}

/// What all encoders have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Settings {
    /// What `sample-frequency` asks for, ...
    sample_hz: u32,
    /// ... and what the register makes of it.
    rate: TickRate,
    skew: MuxSkew,
    timestamps: TickRate,
    timer: LatchTimer,
}

#[derive(Clone, Copy, Debug)]
struct Slots {
    rate: SettingSlot,
    timestamps: SettingSlot,
    /// Only with a DPLL.
    timer: Option<SettingSlot>,
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
            return match setup.count {
                Some(count @ 1..) => Err(PartError::TooManyEncoders { count, all: 0 }),
                _ => Ok(None),
            };
        };
        let registers = Encoders::locate(firmware, module.gtag)?;
        let all = registers.instances();
        let count = setup.count.unwrap_or(all);
        if count > all {
            return Err(PartError::TooManyEncoders { count, all });
        }
        if count == 0 {
            return Ok(None);
        }
        take_pins(firmware, module.gtag, count, plan)?;
        let clock_hz = registers.clock_hz();
        let wiring = Wiring::of(firmware);
        let rate = setup.rate.unwrap_or_else(|| wiring.mux_rate());
        let fastest = count_rates(&registers, rate);
        let settings = Settings {
            sample_hz: rate.hz(clock_hz) as u32,
            rate,
            skew: MuxSkew::default(),
            timestamps: timestamps(clock_hz, false),
            timer: LatchTimer::default(),
        };
        let tick_hz = settings.timestamps.hz(clock_hz);
        let version = registers.is_muxed().then_some(registers.version());
        let dpll = registers.timer.is_some() && firmware.find(Gtag::HM2DPLL).is_some();
        let hz = settings.sample_hz;
        let bank = EncoderBankPins::new(pins, group, board, hz, version, dpll)?;
        made.encoder_bank = Some(bank);
        let mut channels = Vec::new();
        for number in 0..usize::from(count) {
            let terminals = wiring.encoder(firmware, number);
            let pins_of = EncoderPins::new(pins, group, board, number, terminals)?;
            if registers.is_muxed() {
                // What the manuals promise needs the short filter.
                pins.publish(pins_of.filter, false);
            }
            let mut encoder = Encoder::new(pins_of.config(pins), tick_hz);
            encoder.set_max_count_rates(fastest, registers.sample_rate(rate));
            pins.publish(pins_of.max_count_rate, encoder.max_count_rate());
            channels.push(Channel {
                encoder: if registers.has_probe() {
                    encoder
                } else {
                    encoder.without_probe()
                },
                pins: pins_of,
                count: None,
                control: None,
                mode: None,
            });
        }
        made.encoders = channels.iter().map(|channel| channel.pins).collect();
        Ok(Some(Self {
            registers,
            bank,
            initial: settings,
            settings,
            channels,
            timestamp: None,
            slots: None,
        }))
    }

    fn tick_hz(&self) -> f64 {
        self.settings.timestamps.hz(self.registers.clock_hz())
    }

    /// The register of the timer that latches the counts; only with a DPLL.
    fn timer(&self) -> Option<u16> {
        self.registers
            .timer
            .filter(|_| self.bank.timer_number.is_some())
    }

    /// What the pins ask for now.
    fn wanted(&self, pins: &mut PinStore) -> Settings {
        let (bank, clock_hz) = (&self.bank, self.registers.clock_hz());
        let sample_hz = pins.fetch(bank.sample_frequency);
        let skew_ns = bank.muxed_skew.map_or(0, |skew| pins.fetch(skew));
        let timer = bank.timer_number.map_or(-1, |timer| pins.fetch(timer));
        Settings {
            sample_hz,
            // The rate of the set-up need not be one that its rounded frequency gives.
            rate: if sample_hz == self.initial.sample_hz {
                self.initial.rate
            } else {
                TickRate::for_hz(clock_hz, sample_hz)
            },
            skew: MuxSkew::for_ns(clock_hz, skew_ns),
            timestamps: timestamps(clock_hz, pins.fetch(bank.hires_timestamp)),
            timer: LatchTimer::new(timer),
        }
    }

    /// Puts what has changed of what all encoders have in common.
    fn put_settings(&mut self, cycle: &mut Put<'_>) {
        let wanted = self.wanted(cycle.pins);
        let before = core::mem::replace(&mut self.settings, wanted);
        if wanted.timestamps != before.timestamps {
            let tick_hz = self.tick_hz();
            for channel in &mut self.channels {
                channel.encoder.set_tick_hz(tick_hz);
            }
        }
        if wanted.rate != before.rate {
            let fastest = count_rates(&self.registers, wanted.rate);
            let sampled = self.registers.sample_rate(wanted.rate);
            for channel in &mut self.channels {
                channel.encoder.set_max_count_rates(fastest, sampled);
            }
        }
        let slots = self.slots;
        let rate = wanted.rate.0 | wanted.skew.0;
        cycle.change(slots.map(|slots| slots.rate), rate);
        cycle.change(slots.map(|slots| slots.timestamps), wanted.timestamps.0);
        cycle.change(slots.and_then(|slots| slots.timer), wanted.timer.0);
    }
}

/// The most counts in a second with the short filter and with the long one.
fn count_rates(registers: &Encoders, rate: TickRate) -> [f64; 2] {
    [false, true].map(|long_filter| registers.max_count_rate(rate, long_filter))
}

fn timestamps(clock_hz: u32, fine: bool) -> TickRate {
    let hz = if fine {
        TickRate::FINE_TIMESTAMP_HZ
    } else {
        TickRate::TIMESTAMP_HZ
    };
    TickRate::for_hz(clock_hz, hz)
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
        for unit in select_units(firmware, count) {
            plan.use_module(firmware, Gtag::MUX_SELECT, unit)?;
        }
        count.div_ceil(2)
    } else {
        count
    };
    for unit in 0..units {
        plan.use_module(firmware, gtag, unit)?;
    }
    Ok(())
}

/// Each card has a select line of its own, which carries the same signal; its unit is the number of
/// the card's first encoder (FACTS 12.7).
fn select_units(firmware: &HostMot2, count: u8) -> impl Iterator<Item = u8> {
    let mut has_unit = [false; 256];
    for pin in firmware.pins() {
        let is_select = pin.secondary == Gtag::MUX_SELECT;
        if let Some(has) = has_unit.get_mut(usize::from(pin.unit)) {
            *has |= is_select;
        }
    }
    (0..count).filter(move |unit| {
        let has = has_unit.get(usize::from(*unit)).copied();
        // Without any, the plan says what is missing.
        *unit == 0 || has.unwrap_or(false)
    })
}

impl Module for EncoderModule {
    fn set_up(&self, list: &mut SetupList) {
        let configs: Vec<EncoderConfig> = self
            .channels
            .iter()
            .map(|channel| *channel.encoder.config())
            .collect();
        let Settings {
            timestamps, rate, ..
        } = self.initial;
        match self.registers.set_up(list, timestamps, rate, &configs) {
            Ok(()) => {}
            Err(never) => match never {},
        }
        if let Some(address) = self.timer() {
            list.push(address, self.initial.timer.0);
        }
    }

    /// The counters may stand anywhere, and the counts go on from where they were.
    fn restarted(&mut self) {
        for channel in &mut self.channels {
            channel.encoder.resume();
        }
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        let (registers, timer) = (&self.registers, self.timer());
        self.timestamp = Some(plan.read_data(registers.timestamp));
        let settings = &self.initial;
        self.slots = Some(Slots {
            rate: SettingSlot::claim(plan, registers.rate, settings.rate.0),
            timestamps: SettingSlot::claim(
                plan,
                registers.timestamp_divider,
                settings.timestamps.0,
            ),
            timer: timer.map(|address| SettingSlot::claim(plan, address, settings.timer.0)),
        });
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
            let WriteNews {
                is_doubtful,
                is_repeated,
            } = cycle.writes;
            channel.encoder.disturbed(is_doubtful, is_repeated);
            channel.pins.take(cycle.pins, &mut channel.encoder, sample);
        }
    }

    fn put(&mut self, cycle: &mut Put<'_>) {
        self.put_settings(cycle);
        for channel in &mut self.channels {
            channel.pins.command(cycle.pins, &mut channel.encoder);
            cycle.change(channel.mode, channel.encoder.control().0);
            if channel.encoder.wants_write() {
                cycle.repeat(channel.mode);
            }
        }
    }
}
