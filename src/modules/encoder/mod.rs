//! Quadrature counters, on pins of their own or multiplexed.
//!
//! Source: FACTS 13.4, 9.5, 12.5 to 12.7.

mod latch;
mod pins;
mod registers;
mod state;
mod velocity;

use alloc::format;
use alloc::vec::Vec;

use super::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::bus::{Instant, Phase, ReadSlot, Setting, Stage};
use crate::hal::{PinStore, Rejection};
use crate::hostmot2::{Gtag, ModuleDescriptor, PinDescriptor};

pub use crate::hostmot2::TickRate;

use pins::Command;
pub use pins::{EncoderBankPins, EncoderPins};
use state::{EncoderReading, EncoderSample, EncoderState};

/// How encoders are set up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct EncoderSetup {
    /// How many are used; `None` for all that the firmware has. More than it has are refused.
    pub count: Option<u8>,
    /// Rate of the multiplexer or of the filters, at the slowest [`TickRate::SLOWEST`]; `None` for
    /// what the board is made for.
    pub rate: Option<TickRate>,
}

/// All encoders of a firmware.
#[derive(Debug)]
pub struct Encoders {
    /// The pins of all encoders together.
    pub bank: EncoderBankPins,
    axes: Vec<Encoder>,
    clock_hz: u32,
    /// Samples of an encoder in a tick: of the two on a set of multiplexed pins, each is looked at in
    /// every other tick.
    samples: f64,
    /// Without a probe, its bits of the control register read 0 whatever was written (FACTS 12.5).
    has_probe: bool,
    /// The rate of the set-up.
    usual: TickRate,
    timestamp: ReadSlot,
    rate: Setting,
    timestamps: Setting,
    /// Only with a DPLL.
    timer: Option<Setting>,
}

#[derive(Debug)]
struct Encoder {
    pins: EncoderPins,
    state: EncoderState,
    command: Command,
    /// What the pins show.
    shown: Option<EncoderReading>,
    count: ReadSlot,
    control: ReadSlot,
    mode: Setting,
}

/// Set in the version of multiplexed encoders that have a probe.
const WITH_PROBE: u8 = 0x80;
/// Secondary pin of the probe.
const PROBE_PIN: u8 = 0x05;

impl Encoders {
    /// The pins of each encoder.
    pub fn pins(&self) -> impl ExactSizeIterator<Item = EncoderPins> + '_ {
        self.axes.iter().map(|encoder| encoder.pins)
    }

    /// The encoders of a firmware, if it has any and they are wanted: multiplexed ones of version 2 to
    /// 4, and 0x82 to 0x84 with a probe; others of version 2 and 3.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<Option<Self>, RegisterError> {
        let kinds = [Gtag::MUXED_ENCODER, Gtag::ENCODER];
        let found = kinds.into_iter().find_map(|gtag| r.module(gtag));
        let all = found.map_or(0, |module| module.instances);
        let count = r.settings.encoders.count.unwrap_or(all);
        if count > all {
            return Err(RegisterError::Setting {
                what: "encoders (`EncoderSetup::count`)",
                found: format!("{count}"),
                expected: format!("at most {all}, or a firmware that has more"),
            });
        }
        match found {
            Some(module) if count > 0 => Self::new(r, &module, count).map(Some),
            _ => Ok(None),
        }
    }

    fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        count: u8,
    ) -> Result<Self, RegisterError> {
        let (gtag, clock_hz) = (module.gtag, module.clock_hz);
        let is_muxed = gtag == Gtag::MUXED_ENCODER;
        let probe = module.version & if is_muxed { WITH_PROBE } else { 0 };
        let version = module.version & !probe;
        module.check_layout(5, 0x3)?;
        module.expect_version(version, 2..=if is_muxed { 4 } else { 3 })?;
        let is_probe =
            |pin: &PinDescriptor| pin.secondary == gtag && pin.secondary_pin == PROBE_PIN;
        take_pins(r, gtag, count)?;

        let rate_register = module.register(4, 0)?;
        // Descriptors do not count this register; firmware without it ignores what is written there.
        let timer_register = rate_register
            .checked_add(module.register_stride)
            .filter(|_| r.module(Gtag::HM2DPLL).is_some());
        let usual = r.settings.encoders.rate.unwrap_or(r.board.encoder_rate);
        if usual.0 > TickRate::SLOWEST.0 {
            return Err(RegisterError::Setting {
                what: "rate of the encoders (`EncoderSetup::rate`)",
                found: format!("{usual:?}"),
                expected: format!("at most {:?}: the register has 12 bits", TickRate::SLOWEST),
            });
        }
        let bank = EncoderBankPins::new(
            r.maker("encoder."),
            usual.hz(clock_hz) as u32,
            is_muxed.then_some(version),
            timer_register.is_some(),
        )?;
        let common = bank.common(r.pins, clock_hz, usual);
        let divider = module.register(2, 0)?;
        let timestamps = r
            .image
            .setting(Stage::Configure, divider, common.timestamps.0);
        let rate_word = common.rate.0 | common.skew;
        let rate = r.image.setting(Stage::Configure, rate_register, rate_word);
        let samples = if is_muxed { 0.5 } else { 1.0 };
        let [ticks, sample_hz] = [common.timestamps, common.rate].map(|rate| rate.hz(clock_hz));
        let mut axes = Vec::new();
        for number in 0..count {
            let mut encoder = Encoder::new(r, module, number)?;
            let (state, pins) = (&mut encoder.state, &encoder.pins);
            state.set_rates(ticks, sample_hz * samples);
            r.pins.publish(pins.max_count_rate, state.max_count_rate());
            axes.push(encoder);
        }
        Ok(Self {
            bank,
            axes,
            clock_hz,
            samples,
            has_probe: probe != 0 || r.firmware.pins.iter().any(is_probe),
            usual,
            timestamp: r.image.read(Phase::Data, module.register(3, 0)?),
            rate,
            timestamps,
            timer: timer_register
                .map(|address| r.image.setting(Stage::Configure, address, common.timer)),
        })
    }

    /// Writes what has changed of what all encoders have in common.
    fn write_common(&mut self, cycle: &mut WriteCycle<'_>) {
        let wanted = self.bank.common(cycle.pins, self.clock_hz, self.usual);
        let [ticks, samples] = [wanted.timestamps, wanted.rate].map(|rate| rate.hz(self.clock_hz));
        for Encoder { state, .. } in &mut self.axes {
            state.set_rates(ticks, samples * self.samples);
        }
        cycle.words.set(self.rate, wanted.rate.0 | wanted.skew);
        cycle.words.set(self.timestamps, wanted.timestamps.0);
        if let Some(timer) = self.timer {
            cycle.words.set(timer, wanted.timer);
        }
    }
}

impl Encoder {
    fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        number: u8,
    ) -> Result<Self, RegisterError> {
        let (gtag, n) = (module.gtag, number.into());
        let places = r.board.encoder_places(r.firmware, gtag, n);
        let make = r.maker(&format!("encoder.{number:02}."));
        // What the manuals of multiplexed encoders promise needs the short filter.
        let pins = EncoderPins::new(make, places, gtag != Gtag::MUXED_ENCODER)?;
        let config = pins.config(r.pins);
        let (count, control) = (module.register(0, number)?, module.register(1, number)?);
        let mode = r.image.setting(Stage::Configure, control, config.mode);
        r.image.step(Stage::Configure, count, 0);
        Ok(Self {
            pins,
            state: EncoderState::new(config),
            command: Command::default(),
            shown: None,
            count: r.image.read(Phase::Data, count),
            control: r.image.read(Phase::Data, control),
            mode,
        })
    }

    /// Takes a sample, and shows what has changed.
    fn read(&mut self, pins: &mut PinStore, sample: EncoderSample) {
        if self.state.rests(&sample) {
            return;
        }
        let reading = self.state.read(sample);
        if self.shown.replace(reading) != Some(reading) {
            self.pins.publish(pins, &reading);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>, has_probe: bool) {
        let (pins, state) = (&self.pins, &mut self.state);
        if cycle.changed {
            self.command = pins.command(cycle.pins, state, has_probe);
        }
        if self.command.refuses_probe {
            let pin = pins.probe_enable;
            cycle.pins.count_rejection(pin, Rejection::OutOfRange);
        }
        state.follow(self.command);
        cycle.words.set(self.mode, state.control());
        if state.latch.is_unsettled() {
            cycle.words.repeat(self.mode);
        }
        state.latch.is_repeated |= cycle.words.is_news(self.mode);
    }
}

/// Multiplexed encoders share pins in pairs, which carry the number of the pair, and need the
/// select line. Each card has one of its own, which carries the same signal; its unit is the number
/// of the card's first encoder (FACTS 12.7).
fn take_pins(r: &mut Registrar<'_>, gtag: Gtag, count: u8) -> Result<(), RegisterError> {
    let mut units = count;
    if gtag == Gtag::MUXED_ENCODER {
        units = count.div_ceil(2);
        for unit in 0..count {
            let mut pins = r.firmware.pins_of(Gtag::MUX_SELECT, unit);
            // Without any for unit 0, taking its pins tells what is missing.
            if unit == 0 || pins.next().is_some() {
                r.use_io(Gtag::MUX_SELECT, unit)?;
            }
        }
    }
    (0..units).try_for_each(|unit| r.use_io(gtag, unit))
}

impl Module for Encoders {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let timestamp = cycle.words.word(self.timestamp) as u16;
        for encoder in &mut self.axes {
            let sample = EncoderSample {
                count: cycle.words.word(encoder.count),
                control: cycle.words.word(encoder.control),
                timestamp,
                at: cycle.now,
            };
            encoder.state.latch.is_doubtful |= !cycle.certain;
            encoder.read(cycle.pins, sample);
        }
    }

    /// Pins are looked at when one of them has changed; a latch goes on by itself.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if cycle.changed {
            self.write_common(cycle);
        }
        for encoder in &mut self.axes {
            encoder.write(cycle, self.has_probe);
        }
    }

    /// The counters may stand anywhere, and the counts go on from where they were.
    fn restored(&mut self, _: &mut PinStore, _: Instant) {
        for encoder in &mut self.axes {
            encoder.state.resume();
        }
    }
}

#[cfg(test)]
mod tests;
