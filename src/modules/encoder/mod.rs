//! Quadrature counters, on pins of their own or multiplexed.
//!
//! Source: FACTS 13.4, 9.5, 12.5 to 12.7.

mod command;
mod latch;
mod pins;
mod reach;
mod registers;
mod state;
mod velocity;

use alloc::format;
use alloc::vec::Vec;
use core::ops::Range;

use super::limit::Limit;
use super::registrar::DrivenModule;
use super::unsure::UnsureMask;
use super::{
    ListenCycle, Module, Outage, ReadCycle, RegisterError, Registrar, RunOnCycle, WriteCycle,
    bank_stem,
};
use crate::advice;
use crate::bus::{Instant, Phase, ReadSlot, Setting, Stage, Words};
use crate::events::{CorrectedValue, Positions};
use crate::hal::{Output, PinStore};
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor, PinDescriptor};
use crate::settings::Defaults;

pub use crate::hostmot2::TickRate;

use command::EncoderCommand;
use pins::EncoderBankPins;
pub use pins::EncoderPins;
use state::{EncoderRates, EncoderReading, EncoderSample, EncoderState};

/// All encoders of a firmware.
#[derive(Debug)]
pub struct Encoders {
    /// The pins that all encoders share.
    bank: EncoderBankPins,
    axes: Vec<Encoder>,
    /// The number of the first of them.
    first: u8,
    clock_hz: u32,
    /// Samples of an encoder per tick of the rate: 0.5 for multiplexed encoders, since each of the
    /// two on a set of pins is sampled in every other tick.
    samples: f64,
    /// False if the firmware has no probe: its bits of the control register then read 0 after any
    /// write (FACTS 12.5).
    has_probe: bool,
    /// The rate of the set-up.
    usual: TickRate,
    /// The last values of the shared pins that are not allowed.
    reported: [Option<i64>; 3],
    timestamp: ReadSlot,
    rate: Setting,
    timestamps: Setting,
    /// Present only with a DPLL.
    timer: Option<Setting>,
}

#[derive(Debug)]
struct Encoder {
    pins: EncoderPins,
    state: EncoderState,
    /// The last read showed nothing new, and no latch is requested: as long as no command changes,
    /// there is nothing to write.
    rests: bool,
    command: EncoderCommand,
    /// The last published reading.
    shown: Option<EncoderReading>,
    count: ReadSlot,
    control: ReadSlot,
    mode: Setting,
}

/// Secondary pin number of the probe.
const PROBE_PIN: u8 = 0x05;

impl Encoders {
    /// The pins of each encoder.
    pub fn pins(&self) -> impl ExactSizeIterator<Item = EncoderPins> + '_ {
        self.axes.iter().map(|encoder| encoder.pins)
    }

    /// Rate at which the inputs of all encoders are sampled, in Hz; for muxed encoders the
    /// multiplex rate, twice the sample rate of each encoder. A rate that the clock cannot be
    /// divided to becomes the next lower one.
    pub const fn sample_frequency(&self) -> Output<u32> {
        self.bank.sample_frequency
    }

    /// Delay of the sample after the multiplex edge in ns, for muxed encoders of version 4; rounded
    /// to the nearest number of clock periods, at most 15.
    pub const fn muxed_skew(&self) -> Option<Output<u32>> {
        self.bank.muxed_skew
    }

    /// Time stamps of about 10 MHz instead of 1 MHz, for all encoders: for frequency counting, and
    /// for cycle periods up to 1 ms. The velocity estimate restarts when this changes.
    pub const fn hires_timestamp(&self) -> Output<bool> {
        self.bank.hires_timestamp
    }

    /// Source that latches the counts of all encoders: 0 the DPLL's reference, 1 to 4 its timers,
    /// -1 none. Only with a DPLL.
    pub const fn timer_number(&self) -> Option<Output<i32>> {
        self.bank.timer_number
    }

    /// Registers the encoders of a firmware, as many as the settings ask for: multiplexed ones of
    /// version 2 to 4, others of version 2 and 3; encoders with a probe have 0x80 added to the
    /// version.
    ///
    /// Encoders of several modules, and of both kinds, are numbered consecutively in the order of
    /// the descriptors. The shared pins of a second module are named
    /// `encoder.bank-1.sample-frequency`, and so on.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        let modules = r.driven(&[Gtag::MUXED_ENCODER, Gtag::ENCODER]);
        let mut first = 0_u8;
        for (bank, module) in modules.iter().enumerate() {
            let numbers = first..first.saturating_add(module.descriptor.instances);
            first = numbers.end;
            if !numbers.is_empty() {
                let encoders = Self::new(r, module, bank, numbers)?;
                r.add(encoders);
            }
        }
        Ok(())
    }

    /// The first encoders of a module, as many as there are `numbers` for their names.
    fn new(
        r: &mut Registrar<'_>,
        of_kind: &DrivenModule,
        bank: usize,
        numbers: Range<u8>,
    ) -> Result<Self, RegisterError> {
        let (count, first) = (numbers.len() as u8, numbers.start);
        let module = &of_kind.descriptor;
        let (gtag, clock_hz) = (module.gtag, module.clock_hz);
        let is_muxed = gtag == Gtag::MUXED_ENCODER;
        let probe = module.version & ModuleDescriptor::WITH_PROBE;
        let version = module.version & !probe;
        take_pins(r, of_kind, count)?;

        let rate_register = module.register(4, 0)?;
        let timer_register = timer_register(r, module, rate_register);
        let usual = rate_of_setup(r, module)?;
        let bank = EncoderBankPins::new(
            r.maker(&bank_stem("encoder", bank)),
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
        let rates = common.rates(clock_hz, samples);
        let mut axes = Vec::new();
        for (instance, number) in (0..count).zip(numbers) {
            axes.push(Encoder::new(r, of_kind, instance, number, rates)?);
        }
        Ok(Self {
            bank,
            axes,
            first,
            clock_hz,
            samples,
            has_probe: probe != 0 || has_probe_pin(r, gtag),
            usual,
            reported: [None; 3],
            timestamp: r.image.read(Phase::Data, module.register(3, 0)?),
            rate,
            timestamps,
            timer: timer_register
                .map(|address| r.image.setting(Stage::Configure, address, common.timer)),
        })
    }

    /// Reports values of the shared pins that are not allowed: nearest ones are used.
    fn check_limits(&mut self, cycle: &mut WriteCycle<'_>) {
        let [of_rate, of_skew, of_timer] = &mut self.reported;
        let limit = |setting, lowest: u32, highest: u32| Limit {
            setting,
            number: 0,
            lowest: lowest.into(),
            highest: highest.into(),
            instead: None,
        };
        let rate = if self.samples < 1.0 {
            CorrectedValue::MuxedSampleFrequency
        } else {
            CorrectedValue::SampleFrequency
        };
        let clock = self.clock_hz;
        let slowest = clock.div_ceil(TickRate::SLOWEST.0.saturating_add(2));
        limit(rate, slowest, clock / 2).pin(cycle, self.bank.sample_frequency, of_rate);
        if let Some(skew) = self.bank.muxed_skew {
            let longest = 15_000_000_000_u64.checked_div(clock.into()).unwrap_or(0);
            let longest = u32::try_from(longest).unwrap_or(u32::MAX);
            limit(CorrectedValue::MuxedSkew, 0, longest).pin(cycle, skew, of_skew);
        }
        if let Some(timer) = self.bank.timer_number {
            let limit = Limit::timer(CorrectedValue::EncoderTimer, -1);
            limit.pin(cycle, timer, of_timer);
        }
    }

    /// Writes the changed settings that all encoders share.
    fn write_common(&mut self, cycle: &mut WriteCycle<'_>) {
        self.check_limits(cycle);
        let wanted = self.bank.common(cycle.pins, self.clock_hz, self.usual);
        let rates = wanted.rates(self.clock_hz, self.samples);
        for Encoder { state, .. } in &mut self.axes {
            state.set_rates(rates);
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
        of_kind: &DrivenModule,
        instance: u8,
        number: u8,
        rates: EncoderRates,
    ) -> Result<Self, RegisterError> {
        let module = &of_kind.descriptor;
        let (gtag, n) = (module.gtag, of_kind.number(instance).into());
        let places = r.board.encoder_places(r.firmware, gtag, n);
        // The count rates in the manuals of multiplexed encoders need the short filter.
        let has_filter = gtag != Gtag::MUXED_ENCODER || r.settings.defaults == Defaults::LinuxCnc;
        let make = r.maker(&format!("encoder.{number:02}."));
        let pins = EncoderPins::new(make, places, has_filter)?;
        let config = pins.config(r.pins);
        let (count, control) = (module.register(0, instance)?, module.register(1, instance)?);
        let mode = r.image.setting(Stage::Configure, control, config.mode);
        // The count is never written: it goes on through every fault but a reset.
        let mut state = EncoderState::new(config, gtag == Gtag::MUXED_ENCODER);
        state.set_rates(rates);
        r.pins.publish(pins.max_count_rate, state.max_count_rate());
        Ok(Self {
            pins,
            state,
            rests: false,
            command: EncoderCommand::default(),
            shown: None,
            count: r.image.read(Phase::Data, count),
            control: r.image.read(Phase::Data, control),
            mode,
        })
    }

    /// The registers as they were read.
    fn sample(&self, words: &Words, timestamp: u16, times: [Instant; 2]) -> EncoderSample {
        let [asked, at] = times;
        EncoderSample {
            count: words.word(self.count),
            control: words.word(self.control),
            timestamp,
            asked,
            at,
        }
    }

    /// Takes a sample, and publishes the reading if it has changed. Returns true if a position that
    /// the application had is lost.
    fn read(&mut self, pins: &mut PinStore, sample: EncoderSample) -> bool {
        self.rests = self.state.rests(&sample);
        if self.rests {
            return false;
        }
        let reading = self.state.read(sample);
        if self.shown.replace(reading) != Some(reading) {
            self.pins.publish(pins, &reading);
        }
        self.state.end_read()
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>, has_probe: bool) {
        let (pins, state) = (&self.pins, &mut self.state);
        if cycle.changed {
            self.command = pins.command(cycle.pins, state, has_probe);
        } else if self.rests && !self.command.refuses_probe {
            return;
        }
        if self.command.refuses_probe {
            let pin = pins.probe_enable;
            cycle.pins.count_out_of_range(pin);
        }
        state.follow(self.command);
        cycle.words.set(self.mode, state.control());
        if state.latch.is_unsettled() {
            cycle.words.repeat(self.mode);
        }
        state.latch.is_repeated |= cycle.words.is_news(self.mode);
    }
}

/// The rate of the settings, or else that of the board's table or of LinuxCNC, which rounds it up
/// to the next one that the clock can be divided to.
fn rate_of_setup(r: &Registrar<'_>, module: &ModuleDescriptor) -> Result<TickRate, RegisterError> {
    let is_muxed = module.gtag == Gtag::MUXED_ENCODER;
    let of_linuxcnc = |hz: u32| {
        let ticks = module.clock_hz.checked_div(hz).unwrap_or(0);
        TickRate(ticks.saturating_sub(2))
    };
    let usual = match (r.settings.defaults, r.board.encoder_rate) {
        (Defaults::Board, Some(rate)) => rate,
        (_, _) if is_muxed => of_linuxcnc(8_000_000),
        (Defaults::Board, None) => TickRate::MUX_7I77,
        (Defaults::LinuxCnc, _) => of_linuxcnc(25_000_000),
    };
    let rate = r.settings.encoder_rate.unwrap_or(usual);
    if rate.0 > TickRate::SLOWEST.0 {
        return Err(RegisterError::Setting {
            what: "rate of the encoders",
            found: format!("{rate:?}"),
            expected: format!("at most {:?}: the register has 12 bits", TickRate::SLOWEST),
            advice: advice::SET_ENCODER_RATE,
        });
    }
    Ok(rate)
}

/// The register that selects the timer for latching; `None` without a DPLL.
fn timer_register(r: &Registrar<'_>, module: &ModuleDescriptor, rate: u16) -> Option<u16> {
    // The register count of the descriptor does not include this register; firmware without it
    // ignores writes there.
    let register = rate.checked_add(module.register_stride);
    register.filter(|_| r.firmware.find(Gtag::HM2DPLL).is_some())
}

fn has_probe_pin(r: &Registrar<'_>, gtag: Gtag) -> bool {
    let is_probe = |pin: &PinDescriptor| pin.secondary == gtag && pin.secondary_pin == PROBE_PIN;
    r.firmware.pins.iter().any(is_probe)
}

/// Checks layout and version.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    let newest = match module.gtag {
        Gtag::MUXED_ENCODER => 4,
        _ => 3,
    };
    module.check_layout(5, 0x3)?;
    module.expect_version(module.version & !ModuleDescriptor::WITH_PROBE, 2..=newest)
}

/// Gives the encoders their I/O pins. Multiplexed encoders share pins in pairs, which carry the
/// number of the pair, and need the select line. Each card has a line of its own, which carries the
/// same signal (FACTS 12.7). Its unit is often that of the card's first encoder, but not in all
/// firmwares; all lines are therefore driven where all encoders are used.
fn take_pins(r: &mut Registrar<'_>, module: &DrivenModule, count: u8) -> Result<(), RegisterError> {
    let gtag = module.descriptor.gtag;
    let (first, end) = (module.first, module.number(count));
    if gtag != Gtag::MUXED_ENCODER {
        return (first..end).try_for_each(|unit| r.use_io(gtag, unit));
    }
    let of_unit = |unit: &u8| r.firmware.pins_of(Gtag::MUX_SELECT, *unit).next().is_some();
    let lines: Vec<u8> = (0..=u8::MAX).filter(of_unit).collect();
    let used = |unit: &u8| module.is_whole || *unit < end;
    let is_any_used = lines.iter().any(used);
    for unit in lines.into_iter().filter(|unit| !is_any_used || used(unit)) {
        // A second module of this kind shares the lines of the first.
        if first == 0 {
            r.use_io(Gtag::MUX_SELECT, unit)?;
        }
    }
    (first / 2..end.div_ceil(2)).try_for_each(|unit| r.use_io(gtag, unit))
}

impl Module for Encoders {
    /// Counts since a start are not shown: the counter has their lowest 16 bits only.
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        for encoder in &self.axes {
            let control = cycle.words.word(encoder.control);
            encoder.pins.listen(cycle, control);
        }
    }

    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let timestamp = cycle.words.word(self.timestamp) as u16;
        let times = [cycle.asked, cycle.now];
        let mut unsure = UnsureMask::default();
        for (number, encoder) in (self.first..).zip(&mut self.axes) {
            let sample = encoder.sample(cycle.words, timestamp, times);
            encoder.state.latch.is_doubtful |= !cycle.certain;
            if encoder.read(cycle.pins, sample) {
                unsure.add(number);
            }
        }
        unsure.report(cycle, Positions::Encoders);
    }

    fn run_on(&mut self, cycle: &RunOnCycle<'_>) {
        let timestamp = cycle.words.word(self.timestamp) as u16;
        let times = [cycle.asked, cycle.now];
        for encoder in &mut self.axes {
            let sample = encoder.sample(cycle.words, timestamp, times);
            let is_unseen = cycle.words.is_unseen(encoder.mode);
            encoder.state.run_on(sample, cycle.outage, is_unseen);
        }
    }

    /// Reads the pins only when one of them has changed; a pending latch continues by itself.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if cycle.changed {
            self.write_common(cycle);
        }
        for encoder in &mut self.axes {
            encoder.write(cycle, self.has_probe);
        }
    }

    fn set_up_again(&mut self, _: &mut PinStore, _: Instant, outage: &Outage) {
        for encoder in &mut self.axes {
            encoder.state.set_up_again(outage);
            encoder.rests = false;
        }
    }
}

#[cfg(test)]
mod tests;
