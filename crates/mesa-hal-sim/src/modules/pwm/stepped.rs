//! A PWM generator stepped clock by clock: an independent check of the computed one.
//!
//! The model is a chain of registers that take their inputs at an edge of the 200 MHz clock (FACTS
//! 12.3; the recordings show the same delays). It shares no code with the model that it checks.

use super::{PIN_DIRECTION, PIN_OUT, SimPwm};
use crate::fpga::{SimPinDescriptor, gtag};
use crate::machines;
use crate::modules::{Configuration, SimIoPorts, SimModule};

/// The three registers that a written word passes on its way to the fast clock.
#[derive(Clone, Copy, Debug, Default)]
struct Crossing {
    word: u32,
    wanted: bool,
    seen: bool,
    sure: bool,
}

impl Crossing {
    /// Advances by one edge; returns the word that the fast clock takes over at this edge.
    fn step(&mut self, open: bool) -> Option<u32> {
        let taken = self.seen && self.sure;
        let (seen, sure) = (self.seen, self.sure);
        self.sure = seen;
        self.seen = (seen && !taken) || (self.wanted && open && !sure);
        self.wanted &= !self.sure;
        taken.then_some(self.word)
    }

    fn write(&mut self, word: u32) {
        self.word = word;
        self.wanted = true;
    }
}

/// A rate, its accumulator, and a flag for an overflow at the last edge.
#[derive(Clone, Copy, Debug, Default)]
struct Accumulator {
    word: Crossing,
    rate: u32,
    sum: u32,
    overflown: bool,
}

impl Accumulator {
    /// Advances by one edge; true if the driven counter steps at this edge.
    fn step(&mut self) -> bool {
        let ticks = self.overflown;
        self.sum += self.rate;
        self.overflown = self.sum > 0xFFFF;
        self.sum &= 0xFFFF;
        if let Some(rate) = self.word.step(true) {
            self.rate = rate;
        }
        ticks
    }
}

/// The generator and the levels of its pins after each edge.
#[derive(Clone, Copy, Debug, Default)]
struct Stepped {
    pwm: Accumulator,
    pdm: Accumulator,
    adds: bool,
    reference: u32,
    value_in: Crossing,
    mode_in: Crossing,
    value: u32,
    mode: u32,
    ramp: u32,
    old_half: bool,
    high: bool,
    sum: u32,
    /// The end of a period on its way to the adder of the fraction: the same delay as for a value
    /// that waits for the end.
    ends: [bool; 2],
    fraction: u32,
    carry: u32,
}

impl Stepped {
    fn half(&self) -> bool {
        self.reference >> (9 + (self.mode & 3)) & 1 != 0
    }

    fn step(&mut self) {
        let symmetrical = self.mode & 4 != 0;
        let half = self.half();
        let begins = if symmetrical {
            self.old_half && !half
        } else {
            self.old_half != half
        };
        let mask = (0x200 << (self.mode & 3)) - 1;
        let duty = self.value >> 16 & 0xFFF;
        let open = begins || self.mode & 0x20 == 0;
        let ramp = if symmetrical && half {
            !self.reference
        } else {
            self.reference
        };
        if self.adds {
            self.sum = (self.sum & 0xFFF) + duty;
        }
        let dithers = self.mode & 0x40 != 0;
        let carry = if dithers { self.carry } else { 0 };
        self.high = self.ramp & mask < (duty + carry) & 0xFFF;
        let [first, second] = core::mem::replace(&mut self.ends, [begins, false]);
        self.ends[1] = first;
        if second && dithers {
            self.fraction += self.value & 0xFFFF;
            self.carry = self.fraction >> 16;
            self.fraction &= 0xFFFF;
        }
        self.ramp = ramp;
        self.old_half = half;
        if let Some(value) = self.value_in.step(open) {
            self.value = value;
        }
        if let Some(mode) = self.mode_in.step(true) {
            self.mode = mode;
        }
        self.adds = self.pdm.step();
        if self.pwm.step() {
            self.reference = (self.reference + 1) & 0x1FFF;
        }
    }

    fn write(&mut self, version: u8, register: u8, word: u32) {
        let modes = if version > 0 { 0x7F } else { 0x3F };
        match register {
            0 => self.value_in.write(word),
            1 => self.mode_in.write(word & modes),
            2 => self.pwm.word.write(word),
            _ => self.pdm.word.write(word),
        }
    }

    fn pins(&self) -> [bool; 2] {
        let negative = self.value >> 31 != 0;
        match self.mode >> 3 & 3 {
            0 => [self.high, negative],
            1 => [negative, self.high],
            2 => [negative && self.high, !negative && self.high],
            _ => [self.sum > 0xFFF, negative],
        }
    }
}

/// A deterministic sequence of numbers for each seed.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 20) as u32 % limit
    }

    fn of(&mut self, words: &[u32]) -> u32 {
        words[self.below(words.len() as u32) as usize]
    }

    /// A word for the value register, which may be the `present` one again.
    fn value(&mut self, version: u8, present: u32) -> u32 {
        match self.below(4) {
            0 => self.below(0x200) << 16,
            1 => 0x8000_0000 | self.below(0x1000) << 16,
            2 => present,
            _ if version > 0 => self.of(&[0x0FFE_F000, 0x0FFF_0000, 0x01FF_8000]),
            _ => self.below(u32::MAX),
        }
    }
}

/// The first difference between the two models in a run of a module version.
fn difference(seed: u64, version: u8) -> Option<String> {
    let firmware = machines::firmware_7i97(1);
    let mut module = *firmware.module(gtag::PWM).expect("a 7I97 has PWM");
    module.version = version;
    let mut pwm = SimPwm::new(&Configuration {
        firmware: &firmware,
        module: &module,
        io: &SimIoPorts::new(firmware.ports, firmware.port_width),
        now: 0,
        complete: 0,
    });
    let mut stepped = Stepped::default();
    let mut numbers = Numbers(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut said = Vec::new();
    let mut next = [20; 4];
    let mut at = 20;
    // The effect of a change of width on a fraction in progress is unknown: the width is set once.
    let width = numbers.below(8);
    let mut first = (version > 0).then_some(1);
    for clock in 0..24_000u64 {
        let now = clock * 5;
        while let Some(event) = pwm.next_event(now).filter(|&event| event <= now) {
            pwm.event(event);
        }
        stepped.step();
        if now >= at {
            at = now + 20 + u64::from(numbers.below(400) * numbers.below(20)) * 10;
            let register = numbers.of(&[0, 0, 0, 0, 0, 1, 1, 2, 3]) as u8;
            let register = first.take().unwrap_or(register);
            let word = match register {
                0 => numbers.value(version, stepped.value_in.word),
                1 if version > 0 => width | numbers.below(16) << 3,
                1 => numbers.below(128),
                _ => numbers.of(&[0, 0x1000, 0x4000, 0x7000, 0x8000, 0xF000, 0xFFFF, 64425]),
            };
            // A real bus does not write one register twice within eight clocks.
            if now >= next[usize::from(register)] {
                next[usize::from(register)] = now + 40;
                said.push(format!("{now} {register}: {word:#010X}"));
                pwm.put(now, register, 0, word);
                stepped.write(version, register, word);
            }
        }
        let pins = [PIN_OUT, PIN_DIRECTION]
            .map(|pin| pwm.level(now, SimPinDescriptor::new(gtag::PWM, 0, pin)));
        if pins != stepped.pins() {
            let last = said.split_off(said.len().saturating_sub(8));
            return Some(format!(
                "seed {seed}, {now} ns: computed {pins:?}, stepped {:?}; written {last:#?}",
                stepped.pins()
            ));
        }
    }
    None
}

#[test]
fn pins_match_a_generator_stepped_clock_by_clock() {
    assert_eq!((0..400).find_map(|seed| difference(seed, 0)), None);
}

#[test]
fn one_that_dithers_is_too() {
    assert_eq!((0..400).find_map(|seed| difference(seed, 1)), None);
}
