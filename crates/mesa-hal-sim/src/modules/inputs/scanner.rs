//! The scan of an input module, in clocks: raw inputs, their filters, and the counters on them.

/// Maximum number of inputs of a module.
pub(super) const MAX_INPUTS: usize = 32;

/// Delay of the external multiplexer after a change of its address, in clocks (200 ns).
const MULTIPLEXER_DELAY: u64 = 20;

const INVERT: u32 = 1 << 5;
const LAST_INPUT: u32 = 0x1F;

/// The clocked part of an input module.
///
/// A slot takes four clocks times the divisor and advances by one input. Slots run from the last
/// input to the first, repeatedly, from configuration on. The level that a slot samples is raw one
/// slot later, and the filter sees it one scan later.
///
/// The filter of an input counts up while it is 1 and down while it is 0. The filtered input turns
/// on when the count reaches the number of scans, and off at 0: a chattering input accumulates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Scanner {
    clocks: u64,
    /// The clock edges at the beginning and at the end of the present slot.
    slot_begin: u64,
    slot_end: u64,
    last: u8,
    control: u32,
    pub long_filter: u32,
    /// The input of the slot, which InMux outputs as the address.
    address: u8,
    /// The input of the slot before.
    previous: u8,
    /// The input that is processed at the end of the slot.
    index: u8,
    /// The level that InMux has sampled for it.
    taken: bool,
    front: Front,
    raw: u32,
    filtered: u32,
    counts: [u16; MAX_INPUTS],
    pub mpgs: [MpgCounter; 4],
}

/// The stage between the lines and the scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Front {
    /// InMux: the single line of the multiplexer.
    Multiplexer(GlitchFilter),
    /// InM: all lines, delayed by one clock.
    Lines(u32),
}

/// The glitch filter of the multiplexer's line: the level must stay for seven clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct GlitchFilter {
    line: bool,
    count: u8,
    output: bool,
}

/// An 8-bit counter on the inputs 2k (A) and 2k+1 (B).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct MpgCounter {
    pub count: u8,
    pub times_four: bool,
}

impl Scanner {
    /// A module of `count` inputs after configuration.
    pub fn new(count: usize, multiplexed: bool) -> Self {
        Self {
            clocks: 0,
            slot_begin: 0,
            slot_end: 0,
            last: (count.clamp(1, MAX_INPUTS) - 1) as u8,
            control: 0,
            long_filter: 0,
            address: 0,
            previous: 0,
            index: 0,
            taken: false,
            front: if multiplexed {
                Front::Multiplexer(GlitchFilter::default())
            } else {
                Front::Lines(0)
            },
            raw: 0,
            filtered: 0,
            counts: [0; MAX_INPUTS],
            mpgs: [MpgCounter::default(); 4],
        }
    }

    pub fn control(&self) -> u32 {
        self.control | u32::from(self.last)
    }

    /// Sets everything but the number of the last input, which can only be read.
    pub fn set_control(&mut self, value: u32) {
        self.control = value & !LAST_INPUT;
    }

    pub fn raw(&self) -> u32 {
        self.raw
    }

    pub fn filtered(&self) -> u32 {
        self.filtered
    }

    /// Clocks per slot.
    pub fn slot_clocks(&self) -> u64 {
        4 * u64::from((self.control >> 6 & 0x3FF) + 1)
    }

    /// The address after `clocks` clock edges, without a write until then.
    pub fn address_at(&self, clocks: u64) -> u8 {
        let Some(over) = clocks.checked_sub(self.slot_end + 1) else {
            return self.address;
        };
        let inputs = u64::from(self.last) + 1;
        let slots = (over / self.slot_clocks() + 1) % inputs;
        ((u64::from(self.address) + inputs - slots) % inputs) as u8
    }

    /// Advances to `clocks` clocks in all, with these levels at the inputs.
    ///
    /// Scans after one that changed nothing are equal, and are skipped.
    pub fn run_to(&mut self, clocks: u64, lines: u32) {
        let scan = self.slot_clocks() * (u64::from(self.last) + 1);
        while self.clocks < clocks {
            let before = *self;
            self.run_slots(clocks.min(before.clocks + scan), lines);
            if self.is_at_rest_since(&before, scan) {
                let skipped = (clocks - self.clocks) / scan * scan;
                self.clocks += skipped;
                self.slot_begin += skipped;
                self.slot_end += skipped;
            }
        }
    }

    fn is_at_rest_since(&self, before: &Self, scan: u64) -> bool {
        let expected = Self {
            clocks: before.clocks + scan,
            slot_begin: before.slot_begin + scan,
            slot_end: before.slot_end + scan,
            ..*before
        };
        *self == expected
    }

    fn run_slots(&mut self, clocks: u64, lines: u32) {
        while self.clocks < clocks {
            let ends_slot = self.slot_end < clocks;
            let to = if ends_slot { self.slot_end + 1 } else { clocks };
            let taken = self.run_lines(to, lines);
            self.clocks = to;
            if ends_slot {
                self.end_slot(taken);
            }
        }
    }

    /// Runs the lines up to `to`; returns the level that the last clock edge samples.
    fn run_lines(&mut self, to: u64, lines: u32) -> bool {
        let clocks = to.saturating_sub(self.clocks);
        let late = (self.slot_begin + MULTIPLEXER_DELAY).saturating_sub(self.clocks);
        let invert = self.control & INVERT != 0;
        let level = |input: u8| (lines >> (input & 0x1F) & 1 != 0) != invert;
        let (before, now) = (level(self.previous), level(self.address));
        match &mut self.front {
            Front::Multiplexer(glitch) => {
                let but_last = clocks.saturating_sub(1);
                glitch.run(before, late.min(but_last));
                glitch.run(now, but_last.saturating_sub(late));
                let taken = glitch.output;
                glitch.run(if late < clocks { now } else { before }, 1);
                taken
            }
            Front::Lines(registered) => {
                let taken = if clocks > 1 { lines } else { *registered };
                *registered = lines;
                taken >> (self.index & 0x1F) & 1 != 0
            }
        }
    }

    /// Handles the clock edge that ends a slot.
    fn end_slot(&mut self, taken: bool) {
        let bit = 1_u32 << (self.index & 0x1F);
        self.filter(bit);
        let raw = match self.front {
            Front::Multiplexer(_) => core::mem::replace(&mut self.taken, taken),
            Front::Lines(_) => taken,
        };
        self.raw = if raw { self.raw | bit } else { self.raw & !bit };
        self.index = self.address;
        self.previous = self.address;
        self.address = self.address.checked_sub(1).unwrap_or(self.last);
        self.slot_begin = self.slot_end;
        self.slot_end += self.slot_clocks();
    }

    /// Runs the filter of the current input on its raw level.
    fn filter(&mut self, bit: u32) {
        let is_long = self.long_filter & bit != 0;
        let (short, long) = (self.control >> 16 & 0x3F, self.control >> 22);
        let scans = if is_long { long } else { short } as u16;
        let Some(count) = self.counts.get_mut(usize::from(self.index)) else {
            return;
        };
        let before = self.filtered;
        if self.raw & bit == 0 {
            if *count == 0 {
                self.filtered &= !bit;
            }
            *count = count.saturating_sub(1);
        } else if *count < scans {
            *count += 1;
        } else if !is_long || *count == scans {
            self.filtered |= bit;
        }
        if self.filtered != before {
            self.count_mpg();
        }
    }

    /// Counts a change of the current input after its filter.
    fn count_mpg(&mut self) {
        let level = |input: u8| self.filtered >> (input & 0x1F) & 1 != 0;
        let (a, b) = (level(self.index & !1), level(self.index | 1));
        let Some(mpg) = self.mpgs.get_mut(usize::from(self.index / 2)) else {
            return;
        };
        let is_a = self.index & 1 == 0;
        if mpg.times_four || (is_a && b) {
            // B leads A when counting up.
            let is_up = (a == b) == is_a;
            mpg.count = mpg.count.wrapping_add_signed(if is_up { 1 } else { -1 });
        }
    }
}

impl GlitchFilter {
    const FULL: u64 = 7;

    /// Advances by `clocks` with this level.
    fn run(&mut self, level: bool, clocks: u64) {
        if clocks > 0 {
            // The line is registered: its level counts from the next clock on.
            self.count(1);
            self.line = level;
            self.count(clocks - 1);
        }
    }

    /// Advances by `clocks` with the registered level.
    fn count(&mut self, clocks: u64) {
        if clocks == 0 {
            return;
        }
        let before = u64::from(self.count);
        let to_end = if self.line {
            Self::FULL - before
        } else {
            before
        };
        // The output follows the count one clock later.
        if clocks > to_end {
            self.output = self.line;
        } else if to_end == Self::FULL {
            self.output = !self.line;
        }
        let moved = clocks.min(to_end);
        self.count = if self.line {
            before + moved
        } else {
            before - moved
        } as u8;
    }
}
