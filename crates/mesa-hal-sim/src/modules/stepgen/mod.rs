//! Step generators.

mod divider;
mod generator;
mod latch;
#[cfg(test)]
mod stepped;
#[cfg(test)]
mod tests;

use mesa_wire::bus::Direction;

use super::{Configuration, RegisterAddress, Settles, SimModule};
use crate::fpga::{Fabric, OUTPUT_PIN, SimPinDescriptor, UNDRIVEN, gtag};
use crate::wire::Nanos;
use divider::Divider;
use generator::{Generator, Time};

const RATE: u8 = 0;
const ACCUM: u8 = 1;
const MODE: u8 = 2;
const DIR_SETUP: u8 = 3;
const DIR_HOLD: u8 = 4;
const STEP_LEN: u8 = 5;
const STEP_SPACE: u8 = 6;
const TABLE: u8 = 7;
const TABLE_MAX: u8 = 8;
const MASTER: u8 = 9;
const TIMER: u8 = 10;

/// Secondary pin of the first output.
const FIRST_OUTPUT: u8 = 0x81;
/// Secondary pins of index and probe, with the numbers of older sources.
const INDEX_PINS: [u8; 2] = [0x09, 0x01];
const PROBE_PINS: [u8; 2] = [0x0A, 0x02];
/// Unit of a pin that belongs to all generators.
const ALL_UNITS: u8 = 0x80;

/// Set in the version of generators with a latch on index and probe.
const WITH_LATCH: u8 = 0x80;
/// First version that can swap its outputs. FACTS 14.2.
const WITH_SWAP: u8 = 2;
/// Bits of the mode without swap, and without swap and latch.
const TYPE_BITS: u32 = 0x03;
const SWAP_BITS: u32 = 0x07;
const LATCH_BITS: u32 = 0xFF;

const SAMPLED_BY_TIMER: u32 = 1 << 15;
const TIMER_BITS: u32 = 0xF000;
const TIMERS: u8 = 4;

/// Longest time that is simulated at once, in ticks.
const STRETCH: u64 = 1 << 30;

const SECOND: u128 = 1_000_000_000;

/// All step generators of a firmware. FACTS 14.1 and 14.2.
///
/// They go on when the watchdog bites, unseen: FACTS 14.15.
///
/// The simulation is exact to the clock. Its cost is proportional to the steps, not to the clocks:
/// it goes from one event of a generator to the next.
#[derive(Clone, Debug)]
pub struct SimStepgen {
    clock: u32,
    has_dpll: bool,
    mode_bits: u32,
    master: Divider,
    timer: u32,
    generators: Vec<Generator>,
    samples: Samples,
    /// Clock edges since power-up: the generators are in the state after the last one.
    ticks: u64,
}

/// ACCUM of all generators at the last edge of the DPLL timer. FACTS 14.13.
#[derive(Clone, Debug, Default)]
struct Samples {
    words: Vec<u32>,
    /// The words that reads return in the tick of the edge.
    older: Vec<u32>,
    edge: u64,
}

/// The outputs of a generator after a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OutputChange {
    pub(crate) at: Nanos,
    pub(crate) unit: usize,
    /// Bit 0 is the first pin.
    pub(crate) outputs: u8,
}

impl SimModule for SimStepgen {
    fn read(&mut self, _: &Fabric, register: u8, instance: u8) -> u32 {
        let unit = usize::from(instance);
        let generator = self.generators.get(unit);
        match (register, generator) {
            (ACCUM, Some(generator)) => self.accum_word(unit, generator),
            (MODE, Some(generator)) => generator.mode_word().unwrap_or(UNDRIVEN),
            (MASTER, _) => self.master.rate(),
            (TIMER, _) if self.has_dpll => self.timer,
            _ => UNDRIVEN,
        }
    }

    /// The outputs can change at once. A timer that is selected while it is 1, in place of one that
    /// was 0, samples the accumulators at once. FACTS 14.13.
    fn write(&mut self, fabric: &mut Fabric, register: u8, instance: u8, value: u32) {
        let now = fabric.now();
        let before = self.selected_timer();
        self.put(now, register, instance, value, |change| {
            fabric.outputs_changed(change);
        });
        let after = self.selected_timer();
        if before != after {
            let was_high = fabric.timer_level(now.saturating_sub(1), before);
            if was_high == Some(false) && fabric.timer_level(now, after) == Some(true) {
                self.sample();
            }
        }
    }

    fn reload(&mut self, configuration: &Configuration<'_>) {
        *self = Self::new(configuration);
    }

    /// One register more than the descriptor counts: the timer that latches the accumulators.
    /// Without a DPLL nothing drives the bus there.
    fn addresses(&self, configuration: &Configuration<'_>) -> Vec<RegisterAddress> {
        configuration.addresses(configuration.module.registers.saturating_add(1))
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::World
    }

    fn is_driving(&self) -> bool {
        true
    }

    fn level(&self, now: Nanos, pin: SimPinDescriptor) -> bool {
        let Some(generator) = self.generators.get(usize::from(pin.unit)) else {
            return false;
        };
        let mut ahead = *generator;
        let ticks = self.ticks_passed(now).saturating_sub(self.ticks);
        ahead.run(self.master, ticks.min(STRETCH), |_, _| {});
        is_high(ahead.outputs(), pin.pin)
    }

    /// Index or probe.
    fn set_input(&mut self, _: Nanos, pin: SimPinDescriptor, level: bool) {
        for (number, generator) in self.generators.iter_mut().enumerate() {
            let is_meant = pin.unit == ALL_UNITS || usize::from(pin.unit) == number;
            let latch = generator.latch_mut().filter(|_| is_meant);
            let Some(latch) = latch else {
                continue;
            };
            if INDEX_PINS.contains(&pin.pin) {
                latch.index.set(level);
            } else if PROBE_PINS.contains(&pin.pin) {
                latch.probe.set(level);
            }
        }
    }

    /// Reports the changes generator by generator, each in order of time.
    fn advance(&mut self, fabric: &mut Fabric, to: Nanos) -> bool {
        let ticks = self.ticks_passed(to);
        self.run_to(ticks, &mut |change| fabric.outputs_changed(change));
        true
    }

    fn latching_timer(&self) -> Option<u8> {
        let is_on = self.has_dpll && self.timer & SAMPLED_BY_TIMER != 0;
        is_on.then_some(self.selected_timer())
    }

    fn latch(&mut self, _: Nanos) {
        self.sample();
    }
}

impl SimStepgen {
    /// Generators after the configuration of the FPGA. Index and probe have the levels of their
    /// pins.
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        let Configuration {
            firmware,
            module,
            io,
            now,
            ..
        } = *configuration;
        let count = usize::from(module.instances);
        let has_latch = module.version & WITH_LATCH != 0;
        let mode_bits = match module.version {
            _ if has_latch => LATCH_BITS,
            WITH_SWAP.. => SWAP_BITS,
            _ => TYPE_BITS,
        };
        let has_dpll = firmware.module(gtag::DPLL).is_some();
        let mut generators = Self {
            clock: configuration.clock(),
            has_dpll,
            mode_bits,
            master: Divider::new(has_dpll),
            timer: 0,
            generators: vec![Generator::new(has_latch); count],
            samples: Samples {
                words: vec![0; count],
                older: vec![0; count],
                edge: 0,
            },
            ticks: 0,
        };
        generators.ticks = generators.next_tick(now);
        for (number, &pin) in firmware.pins.iter().enumerate() {
            if pin.secondary == module.gtag && pin.pin & OUTPUT_PIN == 0 {
                generators.set_input(now, pin, io.level(number, &|_| false));
            }
        }
        generators
    }

    /// ACCUM as a read returns it. With a DPLL it passes through one register more.
    fn accum_word(&self, unit: usize, generator: &Generator) -> u32 {
        match (self.latching_timer(), self.has_dpll) {
            (Some(_), _) => self.samples.word(unit, self.ticks),
            (None, true) => generator.accum_before(),
            (None, false) => generator.accum(),
        }
    }

    /// Writes a register.
    fn put(
        &mut self,
        now: Nanos,
        register: u8,
        instance: u8,
        value: u32,
        mut changed: impl FnMut(OutputChange),
    ) {
        self.run_to(self.next_tick(now), &mut changed);
        let at = self.time_of(self.ticks);
        let unit = usize::from(instance);
        match register {
            MASTER => self.master.set_rate(value),
            TIMER => self.set_timer(value),
            _ => {
                let mode_bits = self.mode_bits;
                let Some(generator) = self.generators.get_mut(unit) else {
                    return;
                };
                let before = generator.outputs();
                write_generator(generator, register, value, mode_bits);
                let outputs = generator.outputs();
                if outputs != before {
                    changed(OutputChange { at, unit, outputs });
                }
            }
        }
    }

    /// Writes TIMER. Reads show the values at the moment of switching on until the first edge.
    fn set_timer(&mut self, value: u32) {
        let was_sampled = self.latching_timer().is_some();
        self.timer = value & TIMER_BITS;
        if !was_sampled {
            for (word, generator) in self.samples.words.iter_mut().zip(&self.generators) {
                *word = generator.accum_before();
            }
            self.samples.edge = 0;
        }
    }

    /// The selected DPLL timer, even if it does not sample; 0 is the reference.
    fn selected_timer(&self) -> u8 {
        // There are four timers; any other number selects the reference.
        let output = Some((self.timer >> 12 & 7) as u8);
        output.filter(|&timer| timer <= TIMERS).unwrap_or(0)
    }

    /// Samples all accumulators, up to date, at a rise of the timer. The samples show one tick
    /// later.
    fn sample(&mut self) {
        let Samples { words, older, edge } = &mut self.samples;
        core::mem::swap(words, older);
        *edge = self.ticks;
        for (word, generator) in words.iter_mut().zip(&self.generators) {
            *word = generator.accum();
        }
    }

    fn run_to(&mut self, to: u64, changed: &mut impl FnMut(OutputChange)) {
        while let Some(left) = to.checked_sub(self.ticks).filter(|&left| left > 0) {
            let (from, ticks) = (self.ticks, left.min(STRETCH));
            let clock = self.clock;
            for (unit, generator) in self.generators.iter_mut().enumerate() {
                generator.run(self.master, ticks, |passed, outputs| {
                    let at = time_of(clock, from + passed);
                    changed(OutputChange { at, unit, outputs });
                });
            }
            self.master.advance(ticks);
            self.ticks += ticks;
        }
    }

    /// The outputs of a generator; bit 0 is the first pin.
    pub(crate) fn outputs(&self, unit: usize) -> u8 {
        self.generators.get(unit).map_or(0, Generator::outputs)
    }

    /// Number of generators.
    pub fn count(&self) -> usize {
        self.generators.len()
    }

    /// The accumulator of a generator in 1/65536 steps, as ACCUM without sample or delay. Its upper
    /// half is the number of steps, which wraps.
    pub fn accumulator(&self, unit: usize) -> Option<u32> {
        Some(self.generators.get(unit)?.accum())
    }

    /// The number of the first clock edge that is not before `now`.
    fn next_tick(&self, now: Nanos) -> u64 {
        let clocks = u128::from(now) * u128::from(self.clock);
        clocks.div_ceil(SECOND) as u64
    }

    /// The number of the last clock edge up to `now`.
    fn ticks_passed(&self, now: Nanos) -> u64 {
        (u128::from(now) * u128::from(self.clock) / SECOND) as u64
    }

    /// Time of the clock edge with this number.
    fn time_of(&self, tick: u64) -> Nanos {
        time_of(self.clock, tick)
    }
}

impl Samples {
    /// The word that a read in a tick returns.
    fn word(&self, unit: usize, tick: u64) -> u32 {
        let is_new = tick > self.edge;
        let words = if is_new { &self.words } else { &self.older };
        words.get(unit).copied().unwrap_or_default()
    }
}

fn write_generator(generator: &mut Generator, register: u8, value: u32, mode_bits: u32) {
    match register {
        RATE => generator.set_rate(value),
        ACCUM => generator.set_accum(value),
        MODE => generator.set_mode((value & mode_bits) as u8),
        DIR_SETUP => generator.set_time(Time::DirSetup, value),
        DIR_HOLD => generator.set_time(Time::DirHold, value),
        STEP_LEN => generator.set_time(Time::StepLen, value),
        STEP_SPACE => generator.set_time(Time::StepSpace, value),
        TABLE => generator.push_entry(value),
        TABLE_MAX => generator.set_table_max(value),
        _ => {}
    }
}

fn time_of(clock: u32, tick: u64) -> Nanos {
    // Each edge of an output needs it: seconds apart, so that 64 bits suffice.
    let clock = u64::from(clock);
    let second = SECOND as u64;
    tick / clock * second + (tick % clock * second).div_ceil(clock)
}

/// The level of a secondary pin in the outputs of a generator.
pub(crate) fn is_high(outputs: u8, pin: u8) -> bool {
    let number = pin.checked_sub(FIRST_OUTPUT);
    number.is_some_and(|number| u32::from(outputs).checked_shr(number.into()).unwrap_or(0) & 1 != 0)
}
