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
use crate::bus::Instant;
use crate::bus::{ReadSlot, Setting, Stage};
use crate::hal::PinStore;
use crate::hostmot2::{Gtag, HostMot2, ModuleDescriptor};

use latch::LatchRequest;
use pins::Command;
pub use pins::{EncoderBankPins, EncoderPins};
pub use registers::TickRate;
use registers::{ControlWord, CountWord, EncoderConfig, LatchTimer, MuxSkew};
use state::{EncoderReading, EncoderSample, EncoderState};

/// How encoders are set up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderSetup {
    /// How many are used; `None` for all that the firmware has. More than it has are refused.
    pub count: Option<u8>,
    /// Rate of the multiplexer or of the filters; `None` for what the board is made for.
    pub rate: Option<TickRate>,
}

/// All encoders of a firmware.
#[derive(Debug)]
pub struct Encoders {
    bank: EncoderBankPins,
    axes: Vec<Encoder>,
    kind: Kind,
    initial: Common,
    /// As it was written last.
    common: Common,
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

#[derive(Clone, Copy, Debug)]
struct Kind {
    clock_hz: u32,
    is_muxed: bool,
}

/// What all encoders have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Common {
    /// What `sample-frequency` asks for, ...
    sample_hz: u32,
    /// ... and what the register makes of it.
    rate: TickRate,
    skew: MuxSkew,
    timestamps: TickRate,
    timer: LatchTimer,
}

/// Set in the version of multiplexed encoders that have a probe.
const WITH_PROBE: u8 = 0x80;
/// Secondary pin of the probe.
const PROBE_PIN: u8 = 0x05;

impl Encoders {
    /// The pins of all encoders together.
    pub const fn bank(&self) -> &EncoderBankPins {
        &self.bank
    }

    /// The pins of each encoder.
    pub fn pins(&self) -> impl ExactSizeIterator<Item = EncoderPins> + '_ {
        self.axes.iter().map(|encoder| encoder.pins)
    }

    /// The encoders of a firmware, if it has any and they are wanted: multiplexed ones of version 2 to
    /// 4, and 0x82 to 0x84 with a probe; others of version 2 and 3.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<Option<Self>, RegisterError> {
        let setup = r.settings().encoders;
        let kinds = [Gtag::MUXED_ENCODER, Gtag::ENCODER];
        let found = kinds.into_iter().find_map(|gtag| r.firmware().find(gtag));
        let all = found.map_or(0, |module| module.instances);
        let count = setup.count.unwrap_or(all);
        if count > all {
            return Err(RegisterError::TooManyEncoders { count, all });
        }
        match found.copied() {
            Some(module) if count > 0 => Self::new(r, &module, count, setup.rate).map(Some),
            _ => Ok(None),
        }
    }

    fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        count: u8,
        rate: Option<TickRate>,
    ) -> Result<Self, RegisterError> {
        let (gtag, clock_hz) = (module.gtag, module.clock_hz);
        let is_muxed = gtag == Gtag::MUXED_ENCODER;
        let kind = Kind { clock_hz, is_muxed };
        let probe = module.version & if is_muxed { WITH_PROBE } else { 0 };
        let version = module.version & !probe;
        module.expect(5, 0x3)?;
        module.expect_version(version, 2..=if is_muxed { 4 } else { 3 })?;
        let is_probe = |pin: &crate::hostmot2::PinDescriptor| {
            pin.secondary == gtag && pin.secondary_pin == PROBE_PIN
        };
        // Without a probe, its bits of the control register read 0 whatever was written (FACTS 12.5).
        let has_probe = probe != 0 || r.firmware().pins.iter().any(is_probe);
        take_pins(r, gtag, count)?;

        let rate = rate.unwrap_or(r.board().encoder_rate);
        let common = Common {
            sample_hz: rate.hz(clock_hz) as u32,
            rate,
            skew: MuxSkew::default(),
            timestamps: timestamps(clock_hz, false),
            timer: LatchTimer::default(),
        };
        let has_dpll = r.firmware().find(Gtag::HM2DPLL).is_some();
        // Descriptors do not count this register; firmware without it ignores what is written there.
        let after_rate = module.register(4, 0)?.checked_add(module.register_stride);
        let timer = after_rate.filter(|_| has_dpll);
        let muxed_version = is_muxed.then_some(version);
        let bank = EncoderBankPins::new(
            r.maker("encoder."),
            common.sample_hz,
            muxed_version,
            timer.is_some(),
        )?;
        let divider = module.register(2, 0)?;
        let timestamps = r.setting(Stage::Configure, divider, common.timestamps.0);
        let rate = r.setting(Stage::Configure, module.register(4, 0)?, common.rate.0);
        let mut axes = Vec::new();
        for number in 0..count {
            let mut encoder = Encoder::new(r, module, number)?;
            encoder.state.set_probe(has_probe);
            encoder.state.set_tick_hz(common.timestamps.hz(clock_hz));
            kind.limit(&mut encoder.state, common.rate);
            let most = encoder.state.max_count_rate();
            r.pins().publish(encoder.pins.max_count_rate, most);
            axes.push(encoder);
        }
        Ok(Self {
            bank,
            axes,
            kind,
            initial: common,
            common,
            timestamp: r.input(module.register(3, 0)?),
            rate,
            timestamps,
            timer: timer.map(|address| r.setting(Stage::Configure, address, common.timer.0)),
        })
    }

    /// What the pins ask for now.
    fn wanted(&self, pins: &mut PinStore) -> Common {
        let (bank, clock_hz) = (&self.bank, self.kind.clock_hz);
        let sample_hz = pins.fetch(bank.sample_frequency);
        let skew_ns = bank.muxed_skew.map_or(0, |skew| pins.fetch(skew));
        let timer = bank.timer_number.map_or(-1, |timer| pins.fetch(timer));
        Common {
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

    /// Writes what has changed of what all encoders have in common.
    fn write_common(&mut self, cycle: &mut WriteCycle<'_>) {
        let wanted = self.wanted(cycle.pins);
        let before = core::mem::replace(&mut self.common, wanted);
        for encoder in &mut self.axes {
            if wanted.timestamps != before.timestamps {
                encoder
                    .state
                    .set_tick_hz(wanted.timestamps.hz(self.kind.clock_hz));
            }
            if wanted.rate != before.rate {
                self.kind.limit(&mut encoder.state, wanted.rate);
            }
        }
        cycle.set(self.rate, wanted.rate.0 | wanted.skew.0);
        cycle.set(self.timestamps, wanted.timestamps.0);
        if let Some(timer) = self.timer {
            cycle.set(timer, wanted.timer.0);
        }
    }
}

impl Encoder {
    fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        number: u8,
    ) -> Result<Self, RegisterError> {
        let place = r
            .board()
            .encoder_place(r.firmware(), module.gtag, number.into());
        let make = r.maker(&format!("encoder.{number:02}."));
        let make = make.at(place.terminal, place.signal);
        // What the manuals of multiplexed encoders promise needs the short filter.
        let pins = EncoderPins::new(make, module.gtag != Gtag::MUXED_ENCODER)?;
        let config = pins.config(r.pins());
        let (count, control) = (module.register(0, number)?, module.register(1, number)?);
        let mode = r.setting(Stage::Configure, control, config.control().0);
        r.step(Stage::Configure, count, 0);
        Ok(Self {
            pins,
            state: EncoderState::new(config),
            command: Command::default(),
            shown: None,
            count: r.input(count),
            control: r.input(control),
            mode,
        })
    }

    /// Takes a sample, and shows what has changed.
    fn read(&mut self, pins: &mut PinStore, sample: EncoderSample) {
        if self.state.rests(&sample) {
            return;
        }
        let before = self.state.requested();
        let reading = self.state.read(sample);
        let index_came =
            before == LatchRequest::Index && self.state.requested() != LatchRequest::Index;
        self.pins
            .publish_error(pins, self.command, reading.quadrature_error);
        if self.shown.replace(reading) != Some(reading) || index_came {
            self.pins.publish(pins, &reading, index_came);
        }
    }
}

impl Kind {
    /// Says how fast a state can count.
    fn limit(self, state: &mut EncoderState, rate: TickRate) {
        let Self { clock_hz, is_muxed } = self;
        let fastest = [false, true].map(|long| rate.max_count_rate(clock_hz, is_muxed, long));
        state.set_max_count_rates(fastest, rate.sample_rate(clock_hz, is_muxed));
    }
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
fn take_pins(r: &mut Registrar<'_>, gtag: Gtag, count: u8) -> Result<(), RegisterError> {
    let mut units = count;
    if gtag == Gtag::MUXED_ENCODER {
        units = count.div_ceil(2);
        for unit in (0..count)
            .filter(|unit| has_select(r.firmware(), *unit))
            .collect::<Vec<_>>()
        {
            r.use_io(Gtag::MUX_SELECT, unit)?;
        }
    }
    (0..units).try_for_each(|unit| r.use_io(gtag, unit))
}

/// Each card has a select line of its own, which carries the same signal; its unit is the number of
/// the card's first encoder (FACTS 12.7). Without any for unit 0, taking its pins says what is missing.
fn has_select(firmware: &HostMot2, unit: u8) -> bool {
    unit == 0 || firmware.pins_of(Gtag::MUX_SELECT, unit).next().is_some()
}

impl Module for Encoders {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let timestamp = cycle.word(self.timestamp) as u16;
        for encoder in &mut self.axes {
            let sample = EncoderSample {
                count: CountWord(cycle.word(encoder.count)),
                control: ControlWord(cycle.word(encoder.control)),
                timestamp,
                at: cycle.now,
            };
            encoder.state.disturbed(!cycle.certain, cycle.repeated);
            encoder.read(cycle.pins, sample);
        }
    }

    /// Pins are looked at when one of them has changed; a latch goes on by itself.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if cycle.changed {
            self.write_common(cycle);
        }
        for encoder in &mut self.axes {
            let Encoder { pins, state, .. } = encoder;
            if cycle.changed {
                encoder.command = pins.command(cycle.pins, state);
                state.wake();
            }
            pins.carry_out(encoder.command, cycle.pins, state);
            cycle.set(encoder.mode, state.control().0);
            if state.wants_write() {
                cycle.repeat(encoder.mode);
            }
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
