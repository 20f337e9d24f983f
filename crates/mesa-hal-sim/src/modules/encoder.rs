//! Quadrature encoders, plain and multiplexed.
//!
//! FACTS 12.5 to 12.8, 12.12, 13.4; recordings of the enc and qc families, which the simulation
//! follows to the clock. The skew of the multiplexer, which is the delay of the sample after the
//! select edge, is not simulated: the simulated cables are too short for it.

mod clocks;
mod counter;

use mesa_wire::bus::Direction;

use super::{Configuration, RegisterAddress, Settles, SimIoPorts, SimModule};
use crate::fpga::{Fabric, SimFirmware, SimPinDescriptor, UNDRIVEN, gtag};
use crate::wire::Nanos;
use crate::world::Segment;
use clocks::{Clock, Clocks, Divider, Stamps, period};
use counter::{Abz, CountChange, CountPlace, Counter, CounterPins, TO_SELECT};

const COUNT: u8 = 0;
const CONTROL: u8 = 1;
const STAMP_DIVIDER: u8 = 2;
const STAMP_COUNTER: u8 = 3;
const RATE: u8 = 4;
const TIMER: u8 = 5;

/// Secondary pins of the index mask and the probe.
const MASK_PIN: u8 = 0x04;
const PROBE_PIN: u8 = 0x05;
/// Set in the version of multiplexed encoders that have a probe.
const WITH_PROBE: u8 = 0x80;

/// The rate register of plain encoders after configuration.
const PLAIN_RATE: u32 = 4;
/// The high half of a word that no module drives.
const HIGH_HALF: u32 = UNDRIVEN & 0xFFFF_0000;
const LATCHED_BY_TIMER: u32 = 1 << 15;
const TIMERS: u8 = 4;

/// From the clock edge of an event in a counter to the edge at which a read shows it: reads return
/// copies of the registers. Writes have the same delay.
const TO_READ: Clocks = 2;

/// All encoders of one module.
#[derive(Clone, Debug)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "they are properties of the firmware, and a line"
)]
pub struct EncoderBank {
    multiplexed: bool,
    has_probe: bool,
    has_mask: bool,
    clock: Clock,
    stamps: Stamps,
    rate: u32,
    timer: u32,
    /// The words that reads return while a timer of the DPLL latches them.
    latched: Latched,
    select: Divider,
    counters: Vec<Counter>,
    lines: Vec<Abz>,
    /// For each counter, the encoder whose lines it currently gets.
    sees: Vec<usize>,
    /// For each encoder, the pin of its select line.
    select_pins: Vec<Option<usize>>,
    probe: bool,
    /// The time up to which lines and registers are known.
    now: Nanos,
}

/// The words latched by a timer: COUNT and CONTROL of each counter.
#[derive(Clone, Debug, Default)]
struct Latched {
    words: Vec<[u32; 2]>,
    stamp: u16,
}

/// The signal on a select line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SelectLine {
    /// The multiplexer's own signal, or its inverse.
    Driven {
        /// True if the pin inverts the signal.
        inverted: bool,
    },
    /// A constant level.
    Stuck(bool),
}

impl SimModule for EncoderBank {
    fn read(&mut self, fabric: &Fabric, register: u8, instance: u8) -> u32 {
        let number = usize::from(instance);
        let clock = self.clock.passed(fabric.now());
        let mut edge = clock.saturating_sub(TO_READ);
        if let Some(counter) = self.counters.get_mut(number) {
            if counter.changes_at(clock) {
                // An access without any delay after a write, which a real bus does not make, sees
                // the write done.
                edge = clock;
            }
            counter.run_to(edge, &self.stamps);
        }
        let is_latched = self.latching_timer().is_some();
        let latched = self.latched.words.get(number).filter(|_| is_latched);
        let counter = self.counters.get(number);
        match register {
            COUNT => match latched {
                Some([word, _]) => *word,
                None => counter.map_or(UNDRIVEN, Counter::count_word),
            },
            CONTROL => match latched {
                Some([_, word]) => *word,
                None => counter.map_or(UNDRIVEN, |counter| counter.control_word(edge)),
            },
            STAMP_DIVIDER => HIGH_HALF | u32::from(self.stamps.register()),
            STAMP_COUNTER if is_latched => HIGH_HALF | u32::from(self.latched.stamp),
            STAMP_COUNTER => HIGH_HALF | u32::from(self.stamps.after(clock) as u16),
            TIMER => self.timer,
            _ => UNDRIVEN,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, instance: u8, value: u32) {
        let now = fabric.now();
        self.catch_up(now);
        let clock = self.clock.passed(now);
        let change = match register {
            COUNT => CountChange::Clear,
            CONTROL => CountChange::Control(value),
            STAMP_DIVIDER => return self.stamps.write(clock, value as u16),
            RATE => return self.set_rate(now, value),
            TIMER => return self.set_timer(now, value),
            _ => return,
        };
        if let Some(counter) = self.counters.get_mut(usize::from(instance)) {
            counter.change(clock, change, &self.stamps);
        }
    }

    /// Shafts and lines keep their positions.
    fn reload(&mut self, configuration: &Configuration<'_>) {
        self.configure(configuration.firmware, configuration.now);
    }

    /// With a DPLL one register more than the descriptor counts: the timer that latches the others.
    fn addresses(&self, configuration: &Configuration<'_>) -> Vec<RegisterAddress> {
        let has_timer = configuration.firmware.module(gtag::DPLL).is_some();
        let registers = configuration.module.registers;
        configuration.addresses(registers.saturating_add(has_timer.into()))
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::World
    }

    /// The select lines, which all carry the same signal (FACTS 12.7).
    fn level(&self, now: Nanos, pin: SimPinDescriptor) -> bool {
        if pin.secondary != gtag::MUX_SELECT {
            return true;
        }
        let clock = self.clock.passed(now);
        let mut select = self.select;
        let edges = clock.saturating_sub(TO_SELECT);
        select.run_to(edges);
        let [first, ..] = select.loaded();
        // The output rises with the first load.
        first <= edges && select.count().is_multiple_of(2)
    }

    /// The index mask of an encoder, or the probe.
    fn set_input(&mut self, now: Nanos, pin: SimPinDescriptor, level: bool) {
        self.catch_up(now);
        match pin.pin {
            MASK_PIN => self.set_index_mask(pin.unit.into(), level),
            PROBE_PIN => self.set_probe(level),
            _ => {}
        }
    }

    /// Determines the encoder that each counter sees: without its select line, a multiplexer stays
    /// at one encoder of each pair (the odd one, because the line is pulled up), and both counters
    /// see that one.
    fn pins_changed(&mut self, now: Nanos, io: &SimIoPorts) {
        if !self.multiplexed {
            return;
        }
        for encoder in 0..self.encoders() {
            let Some(pin) = self.select_pins.get(encoder).copied().flatten() else {
                continue;
            };
            let line = match io.module_pin(Some(pin)) {
                Some(inverted) => SelectLine::Driven { inverted },
                None => SelectLine::Stuck(io.level(pin, &|_| false)),
            };
            self.set_select(now, encoder, line);
        }
    }

    fn latching_timer(&self) -> Option<u8> {
        // There are four timers; any other number selects the reference.
        let output = Some((self.timer >> 12 & 7) as u8).filter(|&timer| timer <= TIMERS);
        (self.timer & LATCHED_BY_TIMER != 0).then_some(output.unwrap_or(0))
    }

    fn latch(&mut self, edge: Nanos) {
        self.catch_up(edge);
        let clock = self.clock.passed(edge);
        self.latched.stamp = self.stamps.after(clock) as u16;
        let counters = self.counters.iter_mut();
        for (counter, words) in counters.zip(&mut self.latched.words) {
            counter.run_to(clock, &self.stamps);
            *words = [counter.count_word(), counter.control_word(clock)];
        }
    }
}

impl EncoderBank {
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        let Configuration {
            firmware, module, ..
        } = *configuration;
        let multiplexed = module.gtag == gtag::MUXED_ENCODER;
        let has_pin = |pin| {
            let mut pins = firmware.pins.iter();
            pins.any(|found| found.secondary == module.gtag && found.pin == pin)
        };
        let has_probe = has_pin(PROBE_PIN) || (multiplexed && module.version & WITH_PROBE != 0);
        let count = usize::from(module.instances);
        let mut bank = Self {
            multiplexed,
            has_probe,
            has_mask: has_pin(MASK_PIN),
            clock: Clock::new(configuration.clock(), 0),
            stamps: Stamps::new(),
            rate: 0,
            timer: 0,
            latched: Latched::default(),
            select: Divider::new(0, 0),
            counters: Vec::new(),
            lines: vec![[false; 3]; count],
            sees: (0..count).collect(),
            select_pins: select_pins(firmware, count),
            probe: true,
            now: 0,
        };
        bank.configure(firmware, 0);
        bank
    }

    fn configure(&mut self, firmware: &SimFirmware, now: Nanos) {
        self.clock.restart(now);
        self.now = now;
        self.stamps = Stamps::new();
        self.rate = if self.multiplexed {
            firmware.mux_rate
        } else {
            PLAIN_RATE
        };
        self.timer = 0;
        self.latched.words.clear();
        self.latched.words.resize(self.sees.len(), [0; 2]);
        // The dividers of plain encoders begin with a whole period.
        let divider = Divider::new(self.rate, u64::from(self.multiplexed));
        self.select = divider;
        let pins = CounterPins {
            has_probe: self.has_probe,
            mask: self.has_mask,
            probe: self.probe,
        };
        let lines = &self.lines;
        self.counters.clear();
        self.counters
            .extend(self.sees.iter().enumerate().map(|(number, &source)| {
                let place = match (self.multiplexed, number % 2) {
                    (false, _) => CountPlace::Plain,
                    (true, 0) => CountPlace::Even,
                    (true, _) => CountPlace::Odd,
                };
                let line = lines.get(source).copied().unwrap_or_default();
                Counter::new(place, divider, pins).with_lines(line)
            }));
    }

    /// True if the encoders share their lines.
    pub fn is_multiplexed(&self) -> bool {
        self.multiplexed
    }

    /// Number of encoders.
    pub fn encoders(&self) -> usize {
        self.counters.len()
    }

    /// Changes the source of the select signal of the multiplexer in front of an encoder.
    fn set_select(&mut self, now: Nanos, encoder: usize, line: SelectLine) {
        let pair = encoder & !1;
        let source = match line {
            SelectLine::Driven { inverted } => encoder ^ usize::from(inverted),
            SelectLine::Stuck(level) => pair | usize::from(level),
        };
        let Some(sees) = self.sees.get_mut(encoder) else {
            return;
        };
        if core::mem::replace(sees, source) != source {
            let abz = self.lines.get(source).copied().unwrap_or_default();
            self.change_line(now, encoder, abz);
        }
    }

    /// Advances to the state that a read at `now` shows.
    fn catch_up(&mut self, now: Nanos) {
        self.now = now;
        let edge = self.clock.passed(now).saturating_sub(TO_READ);
        for counter in &mut self.counters {
            counter.run_to(edge, &self.stamps);
        }
    }

    fn set_rate(&mut self, now: Nanos, value: u32) {
        let clock = self.clock.passed(now);
        self.rate = value;
        // The old rate applies up to here.
        self.select.run_to(clock);
        self.select.write(clock, value);
        for counter in &mut self.counters {
            counter.set_rate(clock, value);
        }
    }

    fn set_timer(&mut self, now: Nanos, value: u32) {
        let was_latched = self.latching_timer().is_some();
        self.timer = value & 0xF000;
        if !was_latched {
            self.latch(now);
        }
    }

    /// Value of the rate register, which a host cannot read back.
    pub fn rate(&self) -> u32 {
        self.rate
    }

    /// Samples of each line per second. An encoder is followed up to two thirds of this rate in
    /// counts per second with the short filter, and up to two fifteenths with the long one (FACTS
    /// 12.6).
    pub fn sample_rate(&self) -> f64 {
        let clock = self.clock.hz() / period(self.rate) as f64;
        // Two multiplexed encoders take turns on each set of lines.
        clock / if self.multiplexed { 2.0 } else { 1.0 }
    }

    /// Moves an encoder's shaft.
    pub(crate) fn turn(&mut self, encoder: usize, segment: &Segment) {
        let Segment {
            start,
            end,
            from,
            to,
            counts_per_revolution: per_turn,
        } = *segment;
        let nanos = (end - start) as f64;
        let (first, last) = (libm::floor(from) as i64, libm::floor(to) as i64);
        let rate = (to - from).abs() / nanos * 1e9;
        let most = 4.0 * self.sample_rate();
        if rate > most {
            // More edges than samples: the position at the samples is sufficient.
            let looks = libm::ceil(nanos * 1e-9 * most).max(1.0);
            for look in 1..=looks as u32 {
                let part = f64::from(look) / looks;
                let position = libm::floor(from + part * (to - from)) as i64;
                let at = start + (part * nanos) as Nanos;
                self.set_position(at, encoder, position, per_turn);
            }
            return;
        }
        let mut edge = |position: i64, at: i64| {
            let part = ((at as f64 - from) / (to - from)).clamp(0.0, 1.0);
            let at = start + (part * nanos) as Nanos;
            self.set_position(at, encoder, position, per_turn);
        };
        if last > first {
            (first + 1..=last).for_each(|position| edge(position, position));
        } else {
            (last..first)
                .rev()
                .for_each(|position| edge(position, position + 1));
        }
    }

    fn set_position(&mut self, at: Nanos, encoder: usize, position: i64, per_turn: u32) {
        self.set_lines(at, encoder, abz(position, per_turn));
    }

    /// Sets the position of an encoder at the start of its counters, without counting.
    pub(crate) fn place(&mut self, encoder: usize, position: i64, per_turn: u32) {
        let Some(lines) = self.lines.get_mut(encoder) else {
            return;
        };
        *lines = abz(position, per_turn);
        for counter in [encoder, encoder ^ 1] {
            if self.sees.get(counter) == Some(&encoder)
                && let Some(counter) = self.counters.get_mut(counter)
            {
                counter.settle(*lines);
            }
        }
    }

    /// Sets the lines A, B and index of an encoder, in front of the multiplexer, at `now`.
    pub fn set_lines(&mut self, now: Nanos, encoder: usize, abz: [bool; 3]) {
        let Some(lines) = self.lines.get_mut(encoder) else {
            return;
        };
        if core::mem::replace(lines, abz) == abz {
            return;
        }
        for counter in [encoder, encoder ^ 1] {
            if self.sees.get(counter) == Some(&encoder) {
                self.change_line(now, counter, abz);
            }
        }
    }

    fn change_line(&mut self, now: Nanos, counter: usize, abz: Abz) {
        self.now = self.now.max(now);
        let (passed, next) = (self.clock.passed(now), self.clock.next(now));
        if let Some(counter) = self.counters.get_mut(counter) {
            counter.run_to(passed.saturating_sub(TO_READ), &self.stamps);
            counter.set_lines(next, abz);
        }
    }

    /// Makes an encoder lose track of its lines once, like a disturbance on the cable.
    pub fn disturb(&mut self, instance: usize) {
        if let Some(counter) = self.counters.get_mut(instance) {
            counter.disturb();
        }
    }

    /// Sets the probe input of all encoders; no effect on firmware without one. The input is
    /// initially not driven: high. It is filtered like the other lines: a pulse of fewer than three
    /// samples has no effect.
    pub fn set_probe(&mut self, level: bool) {
        self.probe = level;
        let next = self.clock.next(self.now);
        for counter in &mut self.counters {
            counter.change(next, CountChange::Probe(level), &self.stamps);
        }
    }

    /// Sets the index mask input of an encoder. The input is always low on firmware without the
    /// pin; with the pin it is initially not driven: high.
    pub fn set_index_mask(&mut self, instance: usize, level: bool) {
        let next = self.clock.next(self.now);
        let counter = self.counters.get_mut(instance).filter(|_| self.has_mask);
        if let Some(counter) = counter {
            counter.change(
                next.saturating_sub(1),
                CountChange::Mask(level),
                &self.stamps,
            );
        }
    }

    /// Lines A, B and index of an encoder.
    pub fn lines(&self, instance: usize) -> [bool; 3] {
        self.lines.get(instance).copied().unwrap_or([true; 3])
    }
}

/// The select pin of each encoder: one pin for each connector of six encoders.
fn select_pins(firmware: &SimFirmware, encoders: usize) -> Vec<Option<usize>> {
    let pins = firmware.pins.iter().enumerate();
    let selects: Vec<usize> = pins
        .filter(|(_, pin)| pin.secondary == gtag::MUX_SELECT)
        .map(|(number, _)| number)
        .collect();
    let pin = |encoder| selects.get(encoder / 6).or(selects.first()).copied();
    (0..encoders).map(pin).collect()
}

/// A leads B when the position rises, and both are high at the index.
fn abz(position: i64, per_turn: u32) -> Abz {
    let index = per_turn != 0 && position.rem_euclid(i64::from(per_turn)) == 0;
    match position & 3 {
        0 => [true, true, index],
        1 => [false, true, index],
        2 => [false, false, index],
        _ => [true, false, index],
    }
}
