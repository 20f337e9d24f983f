//! Isolated inputs: InMux and InM, with their filters and MPG counters.

use super::IoPorts;
use crate::sim::fpga::firmware::{Firmware, ModuleDescriptor, gtag};
use crate::sim::wire::Nanos;

const CONTROL: u8 = 0;
const FILTER: u8 = 1;
const FILTERED: u8 = 2;
const RAW: u8 = 3;
const MPG: u8 = 4;

/// The most inputs a module has.
const MAX_INPUTS: usize = 32;
const MAX_MPGS: usize = 4;
const MAX_ADDRESS_LINES: usize = 5;

const LAST_INPUT: u32 = 0x1F;
const INVERT: u32 = 1 << 5;

/// One input on its way through the filter.
#[derive(Clone, Copy, Debug, Default)]
struct Input {
    raw: bool,
    since: Nanos,
    filtered: bool,
}

impl Input {
    /// No current flows: the line is high.
    const IDLE: Self = Self {
        raw: true,
        since: 0,
        filtered: true,
    };
}

/// An 8-bit counter on the inputs 2k and 2k+1.
#[derive(Clone, Copy, Debug, Default)]
struct MpgCounter {
    count: u8,
    times_four: bool,
}

/// An input module. REGISTERS, "InMux / InM".
///
/// The opto-isolators in front of it invert: without the global invert bit, an input reads 1 while
/// no current flows. That is how LinuxCNC sets it up ("fixed to true, as this matches all existing
/// hardware").
///
/// An input reaches the filtered register when it has been stable for as many scans as its filter
/// asks for; the MPG counters count on filtered inputs.
#[derive(Clone, Debug)]
pub struct Inputs {
    multiplexed: bool,
    clock: u32,
    control: u32,
    long_filter: u32,
    count: usize,
    /// What is at the terminals.
    terminals: u32,
    lines: [Input; MAX_INPUTS],
    mpgs: [MpgCounter; MAX_MPGS],
    address: [Option<usize>; MAX_ADDRESS_LINES],
    /// Address bits that stand at 1 because nobody drives their lines.
    stuck_address: usize,
}

impl Inputs {
    pub(crate) fn new(firmware: &Firmware, module: &ModuleDescriptor) -> Self {
        let multiplexed = module.gtag == gtag::IN_MUX;
        let pin = |number: u8| firmware.pin(module.gtag, 0, number);
        let address = core::array::from_fn(|line| {
            let number = 0x81 + line as u8;
            if multiplexed { pin(number) } else { None }
        });
        let count = if multiplexed {
            1 << address.iter().flatten().count()
        } else {
            (0x01..=0x20)
                .filter(|&number| pin(number).is_some())
                .count()
        };
        let mut inputs = Self {
            multiplexed,
            clock: firmware.clock(module.clock).max(1),
            control: 0,
            long_filter: 0,
            count: count.clamp(1, MAX_INPUTS),
            terminals: 0,
            lines: [Input::IDLE; MAX_INPUTS],
            mpgs: [MpgCounter::default(); MAX_MPGS],
            address,
            stuck_address: 0,
        };
        inputs.stuck_address = if multiplexed { usize::MAX } else { 0 };
        inputs
    }

    pub(crate) fn read(&mut self, now: Nanos, register: u8) -> u32 {
        self.settle(now);
        match register {
            CONTROL => self.control | (self.count as u32 - 1),
            FILTER => self.long_filter,
            FILTERED => self.word(|input| input.filtered),
            RAW => self.word(|input| input.raw),
            MPG => u32::from_le_bytes(self.mpgs.map(|mpg| mpg.count)),
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, now: Nanos, register: u8, value: u32) {
        self.settle(now);
        match register {
            CONTROL => {
                self.control = value & !LAST_INPUT;
                self.look(now);
            }
            FILTER => self.long_filter = value,
            MPG => {
                for (mpg, byte) in self.mpgs.iter_mut().zip(value.to_le_bytes()) {
                    mpg.times_four = byte & 1 != 0;
                }
            }
            _ => {}
        }
    }

    /// Number of inputs.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether current flows into an input.
    pub fn terminal(&self, input: usize) -> bool {
        input < MAX_INPUTS && self.terminals >> input & 1 != 0
    }

    /// Scans of the whole module in a second.
    pub fn scan_rate(&self) -> f64 {
        1e9 / self.scan_nanos()
    }

    pub(crate) fn set_terminal(&mut self, now: Nanos, input: usize, on: bool) {
        if input < MAX_INPUTS {
            self.settle(now);
            self.terminals = self.terminals & !(1 << input) | u32::from(on) << input;
            self.look(now);
        }
    }

    /// The address lines are only driven while their pins are set up for it.
    pub(crate) fn pins_changed(&mut self, now: Nanos, io: &IoPorts) {
        if !self.multiplexed {
            return;
        }
        self.settle(now);
        let lines = self.address.iter().enumerate();
        self.stuck_address = lines
            .filter(|(_, pin)| !io.module_drives(**pin))
            .fold(0, |stuck, (line, _)| stuck | 1 << line);
        self.look(now);
    }

    fn word(&self, bit: impl Fn(&Input) -> bool) -> u32 {
        let inputs = self.lines.iter().take(self.count).enumerate();
        inputs.fold(0, |word, (n, input)| word | u32::from(bit(input)) << n)
    }

    fn scan_nanos(&self) -> f64 {
        let divisor = (self.control >> 6 & 0x3FF) + 1;
        // InM too takes its inputs one after the other.
        4e9 / f64::from(self.clock) * f64::from(divisor) * self.count as f64
    }

    fn filter_nanos(&self, input: usize) -> Nanos {
        let long = self.long_filter >> input & 1 != 0;
        let scans = if long {
            self.control >> 22
        } else {
            self.control >> 16 & 0x3F
        };
        (f64::from(scans) * self.scan_nanos()) as Nanos
    }

    /// Takes over the terminals into the raw inputs.
    fn look(&mut self, now: Nanos) {
        let invert = self.control & INVERT != 0;
        for number in 0..self.count {
            let selected = (number | self.stuck_address) & (self.count - 1);
            let source = if self.multiplexed { selected } else { number };
            // An opto-isolator pulls its line low while current flows.
            let raw = self.terminal(source) == invert;
            if let Some(input) = self.lines.get_mut(number)
                && input.raw != raw
            {
                input.raw = raw;
                input.since = now;
            }
        }
    }

    /// Lets every input through that has been stable for long enough, in the order of time.
    fn settle(&mut self, now: Nanos) {
        for _ in 0..self.count {
            let next = self.lines.iter().take(self.count).enumerate();
            let next = next
                .filter(|(_, input)| input.raw != input.filtered)
                .map(|(number, input)| (input.since + self.filter_nanos(number), number))
                .min();
            let Some((due, number)) = next else { return };
            if due > now {
                return;
            }
            if let Some(input) = self.lines.get_mut(number) {
                input.filtered = input.raw;
            }
            self.count_mpg(number);
        }
    }

    fn count_mpg(&mut self, changed: usize) {
        let level = |number: usize| self.lines.get(number).is_some_and(|input| input.filtered);
        let (a, b) = (level(changed & !1), level(changed | 1));
        let a_changed = changed & 1 == 0;
        // A leads B when the wheel turns forwards.
        let forwards = if a_changed { a != b } else { a == b };
        if let Some(mpg) = self.mpgs.get_mut(changed / 2)
            && (mpg.times_four || (a_changed && !b))
        {
            let step = if forwards { 1 } else { -1 };
            mpg.count = mpg.count.wrapping_add_signed(step);
        }
    }
}
