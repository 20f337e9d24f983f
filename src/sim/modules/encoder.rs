//! Quadrature encoders, plain and multiplexed.

use crate::sim::fpga::firmware::{Firmware, ModuleDescriptor, gtag};
use crate::sim::wire::Nanos;
use crate::sim::world::Segment;

const COUNT: u8 = 0;
const CONTROL: u8 = 1;
const STAMP_DIVIDER: u8 = 2;
const STAMP_COUNTER: u8 = 3;
const RATE: u8 = 4;
const TIMER: u8 = 5;

const QUADRATURE_ERROR: u32 = 1 << 15;
const AB_POLARITY: u32 = 1 << 14;
const LATCH_ON_PROBE: u32 = 1 << 13;
const PROBE_POLARITY: u32 = 1 << 12;
const LONG_FILTER: u32 = 1 << 11;
const UP_DOWN: u32 = 1 << 10;
const USE_MASK: u32 = 1 << 9;
const MASK_POLARITY: u32 = 1 << 8;
const GATE_WITH_AB: u32 = 1 << 7;
const JUST_ONCE: u32 = 1 << 6;
const CLEAR_ON_INDEX: u32 = 1 << 5;
const LATCH_ON_INDEX: u32 = 1 << 4;
const INDEX_POLARITY: u32 = 1 << 3;
const LIVE: u32 = 0b111;

/// Of the rate register: the delay of the sample after the multiplex edge, which cables are too
/// short for here, and the divisor.
const SKEW: u32 = 0xF << 28;
const RATE_DIVISOR: u32 = 0xFFF;

/// All encoders of one module. REGISTERS, "Encoder / muxed encoder".
#[derive(Clone, Debug)]
pub struct EncoderBank {
    multiplexed: bool,
    clock: u32,
    divider: u32,
    /// Ticks of the time-stamp counter up to `.0`.
    stamp_base: (Nanos, u64),
    rate: u32,
    /// Which timer of the DPLL latches the counts. It is kept, but nothing is latched.
    timer: u32,
    encoders: Vec<Encoder>,
    /// For each encoder the pin of the select line it depends on.
    select: Vec<Option<usize>>,
}

/// One counter with its three lines.
#[derive(Clone, Debug, Default)]
#[expect(clippy::struct_excessive_bools, reason = "they are lines")]
struct Encoder {
    count: u16,
    stamp: u16,
    control: u32,
    latch: u16,
    /// The quadrature position last sampled. The lines show its two lowest bits.
    sampled: i64,
    index_line: bool,
    /// The index as the control bits condition it: an event comes when it rises.
    index_signal: bool,
    mask_line: bool,
    probe_line: bool,
}

impl EncoderBank {
    pub(crate) fn new(firmware: &Firmware, module: &ModuleDescriptor) -> Self {
        let multiplexed = module.gtag == gtag::MUXED_ENCODER;
        let selects: Vec<usize> = firmware
            .pins
            .iter()
            .enumerate()
            .filter(|(_, pin)| pin.secondary == gtag::MUX_SELECT)
            .map(|(number, _)| number)
            .collect();
        let count = usize::from(module.instances);
        // Each connector with six encoders has its own select line.
        let select =
            (0..count).map(|encoder| selects.get(encoder / 6).or(selects.first()).copied());
        Self {
            multiplexed,
            clock: firmware.clock(module.clock).max(1),
            divider: 0,
            stamp_base: (0, 0),
            rate: power_up_rate(firmware, multiplexed),
            timer: 0,
            select: select.collect(),
            encoders: vec![Encoder::power_up(); count],
        }
    }

    /// The FPGA is loaded again: registers as at power-up. Shafts and lines stay where they are.
    pub(crate) fn reload(&mut self, now: Nanos, firmware: &Firmware) {
        self.divider = 0;
        self.stamp_base = (now, 0);
        self.rate = power_up_rate(firmware, self.multiplexed);
        self.timer = 0;
        for encoder in &mut self.encoders {
            encoder.count = 0;
            encoder.stamp = 0;
            encoder.latch = 0;
            encoder.control = 0;
            encoder.index_signal = !encoder.index_line;
        }
    }

    /// Whether its encoders share their lines.
    pub fn is_multiplexed(&self) -> bool {
        self.multiplexed
    }

    /// The select line an encoder depends on, if it does on one.
    pub(crate) fn select_pin(&self, encoder: usize) -> Option<usize> {
        self.select.get(encoder).copied().flatten()
    }

    pub(crate) fn read(&self, now: Nanos, register: u8, instance: u8) -> u32 {
        let encoder = self.encoders.get(usize::from(instance));
        match register {
            COUNT => encoder.map_or(0, |e| u32::from(e.count) | u32::from(e.stamp) << 16),
            CONTROL => encoder.map_or(0, Encoder::control_word),
            STAMP_DIVIDER => self.divider,
            STAMP_COUNTER => u32::from(self.stamp(now)),
            RATE => self.rate,
            TIMER => self.timer,
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, now: Nanos, register: u8, instance: u8, value: u32) {
        match register {
            STAMP_DIVIDER => {
                self.stamp_base = (now, self.ticks(now));
                self.divider = value;
            }
            RATE => self.rate = value & (SKEW | RATE_DIVISOR),
            TIMER => self.timer = value,
            _ => {
                if let Some(encoder) = self.encoders.get_mut(usize::from(instance)) {
                    encoder.write(register, value);
                }
            }
        }
    }

    /// The highest count rate the lines are sampled for, in counts per second.
    pub fn sample_rate(&self) -> f64 {
        // Two multiplexed encoders take turns on each set of lines.
        self.filter_clock() / if self.multiplexed { 2.0 } else { 1.0 }
    }

    /// Frequency of the multiplexer and of the filters.
    fn filter_clock(&self) -> f64 {
        f64::from(self.clock) / f64::from((self.rate & RATE_DIVISOR) + 2)
    }

    /// Moves the encoder's shaft.
    pub(crate) fn turn(&mut self, instance: usize, segment: &Segment) {
        let sample_rate = self.sample_rate();
        let clock = self.filter_clock();
        let stamps = Stamps {
            base: self.stamp_base,
            clock: self.clock,
            divisor: divisor(self.divider),
        };
        if let Some(encoder) = self.encoders.get_mut(instance) {
            encoder.turn(segment, sample_rate, clock, &stamps);
        }
    }

    /// Makes an encoder lose track of its lines once, as a disturbance on the cable does.
    pub fn disturb(&mut self, instance: usize) {
        if let Some(encoder) = self.encoders.get_mut(instance) {
            encoder.control |= QUADRATURE_ERROR;
        }
    }

    /// Sets the probe input of all encoders.
    pub fn set_probe(&mut self, level: bool) {
        for encoder in &mut self.encoders {
            encoder.set_probe(level);
        }
    }

    /// Sets the index mask input of an encoder.
    pub fn set_index_mask(&mut self, instance: usize, level: bool) {
        if let Some(encoder) = self.encoders.get_mut(instance) {
            encoder.mask_line = level;
        }
    }

    /// Lines A, B and index of an encoder.
    pub fn lines(&self, instance: usize) -> [bool; 3] {
        self.encoders.get(instance).map_or([true; 3], |encoder| {
            let (a, b) = lines(encoder.sampled);
            [a, b, encoder.index_line]
        })
    }

    fn ticks(&self, now: Nanos) -> u64 {
        let stamps = Stamps {
            base: self.stamp_base,
            clock: self.clock,
            divisor: divisor(self.divider),
        };
        stamps.ticks(now)
    }

    fn stamp(&self, now: Nanos) -> u16 {
        self.ticks(now) as u16
    }
}

/// The time-stamp counter, as a function of time.
struct Stamps {
    base: (Nanos, u64),
    clock: u32,
    divisor: u32,
}

impl Stamps {
    fn ticks(&self, now: Nanos) -> u64 {
        let (since, ticks) = self.base;
        let clocks = u128::from(now.saturating_sub(since)) * u128::from(self.clock) / 1_000_000_000;
        ticks.wrapping_add((clocks / u128::from(self.divisor)) as u64)
    }
}

/// The rate register at power-up; plain encoders are filtered at about 16 MHz.
fn power_up_rate(firmware: &Firmware, multiplexed: bool) -> u32 {
    if multiplexed {
        firmware.mux_rate
    } else {
        (firmware.clock_low / 16_000_000).saturating_sub(2)
    }
}

/// What the time-stamp divider divides by: n + 2, or 1 with the top bit of its 16 bits set.
fn divisor(register: u32) -> u32 {
    if register & 0x8000 != 0 {
        1
    } else {
        (register & 0x7FFF) + 2
    }
}

/// Levels of A and B. A leads B when the position rises, and both are high at the index.
fn lines(position: i64) -> (bool, bool) {
    match position & 3 {
        0 => (true, true),
        1 => (false, true),
        2 => (false, false),
        _ => (true, false),
    }
}

impl Encoder {
    /// An encoder whose index line is low, which is active with the polarity bit at 0.
    fn power_up() -> Self {
        Self {
            index_signal: true,
            ..Self::default()
        }
    }

    fn control_word(&self) -> u32 {
        let (a, b) = lines(self.sampled);
        let live = u32::from(a) | u32::from(b) << 1 | u32::from(self.index_line) << 2;
        u32::from(self.latch) << 16 | self.control | live
    }

    fn write(&mut self, register: u8, value: u32) {
        match register {
            COUNT => self.count = 0,
            CONTROL => {
                // Writing a 1 takes back the quadrature error.
                let error = self.control & QUADRATURE_ERROR & !value;
                self.control = value & 0xFFFF & !(LIVE | QUADRATURE_ERROR) | error;
                // Another polarity can make the index signal rise, too.
                self.look_at_index();
            }
            _ => {}
        }
    }

    /// Samples the lines along a movement, as often as the hardware does.
    fn turn(&mut self, segment: &Segment, sample_rate: f64, clock: f64, stamps: &Stamps) {
        let Segment {
            start,
            end,
            from,
            to,
            counts_per_revolution,
        } = *segment;
        let nanos = (end - start) as f64;
        let rate = (to - from).abs() / nanos * 1e9;
        // A line keeps its level for two counts; its filter wants that many clocks of it.
        let filter = if self.control & LONG_FILTER != 0 {
            15.0
        } else {
            3.0
        };
        if rate > 2.0 * clock / filter {
            return;
        }
        if rate <= sample_rate {
            self.follow(from, to, counts_per_revolution, |position| {
                let part = ((position - from) / (to - from)).clamp(0.0, 1.0);
                stamps.ticks(start + (part * nanos) as Nanos) as u16
            });
            return;
        }
        let samples = (nanos * 1e-9 * sample_rate).ceil().max(1.0);
        for sample in 1..=samples as u32 {
            let part = f64::from(sample) / samples;
            let stamp = stamps.ticks(start + (part * nanos) as Nanos) as u16;
            let position = libm::floor(from + part * (to - from)) as i64;
            self.sample(position, counts_per_revolution, stamp);
        }
    }

    /// Every edge of a movement that is slow enough. `stamp` dates a position.
    fn follow(&mut self, from: f64, to: f64, per_turn: u32, stamp: impl Fn(f64) -> u16) {
        let (first, last) = (libm::floor(from) as i64, libm::floor(to) as i64);
        if last > first {
            for position in first + 1..=last {
                self.sample(position, per_turn, stamp(position as f64));
            }
        } else {
            for position in (last..first).rev() {
                self.sample(position, per_turn, stamp((position + 1) as f64));
            }
        }
    }

    /// One look at the lines.
    fn sample(&mut self, position: i64, per_turn: u32, stamp: u16) {
        let before = lines(self.sampled);
        let step = position.wrapping_sub(self.sampled) & 3;
        self.sampled = position;
        if self.control & UP_DOWN != 0 {
            self.count_up_down(before, lines(position), stamp);
        } else {
            match step {
                1 => self.count_by(1, stamp),
                3 => self.count_by(-1, stamp),
                // Both lines at once: no telling which way.
                2 => self.control |= QUADRATURE_ERROR,
                _ => {}
            }
        }
        self.index_line = per_turn != 0 && position.rem_euclid(i64::from(per_turn)) == 0;
        self.look_at_index();
    }

    /// A counts on its rising edge; up when B is high.
    fn count_up_down(&mut self, before: (bool, bool), after: (bool, bool), stamp: u16) {
        if !before.0 && after.0 {
            self.count_by(if after.1 { 1 } else { -1 }, stamp);
        }
    }

    fn count_by(&mut self, step: i16, stamp: u16) {
        self.count = self.count.wrapping_add_signed(step);
        self.stamp = stamp;
    }

    fn look_at_index(&mut self) {
        let (a, b) = lines(self.sampled);
        let polarity = self.control & AB_POLARITY != 0;
        let gated = self.control & GATE_WITH_AB != 0;
        let active = self.index_line == (self.control & INDEX_POLARITY != 0);
        let signal = active && (!gated || (a == polarity && b == polarity));
        let rises = signal && !self.index_signal;
        self.index_signal = signal;
        let mask_polarity = self.control & MASK_POLARITY != 0;
        let masked = self.control & USE_MASK != 0 && self.mask_line != mask_polarity;
        if rises && !masked {
            self.index_event();
        }
    }

    fn index_event(&mut self) {
        if self.control & LATCH_ON_INDEX != 0 {
            self.latch = self.count;
        }
        if self.control & CLEAR_ON_INDEX != 0 {
            self.count = 0;
        }
        if self.control & JUST_ONCE != 0 {
            self.control &= !(LATCH_ON_INDEX | CLEAR_ON_INDEX);
        }
    }

    fn set_probe(&mut self, level: bool) {
        let edge = level != self.probe_line;
        self.probe_line = level;
        let active = level == (self.control & PROBE_POLARITY != 0);
        if edge && active && self.control & LATCH_ON_PROBE != 0 {
            self.latch = self.count;
            if self.control & JUST_ONCE != 0 {
                self.control &= !LATCH_ON_PROBE;
            }
        }
    }
}
