//! A step generator: accumulator, timers and outputs, from one event to the next.

use super::divider::Divider;
use super::latch::Latch;

/// Width of the accumulator; its lower 32 bits are the fraction of a step.
const ACCUM_BITS: u32 = 48;
const STEP: u64 = 1 << 32;
/// Bits of the accumulator below those that ACCUM shows.
const HIDDEN: u32 = 16;

/// A quadrature phase: a quarter of a step.
const QUARTER: u64 = STEP / 4;

/// Width of the four timing registers.
const TIMING: u32 = 0x3FFF;

const TYPE: u8 = 3;
const SWAP: u8 = 1 << 2;

/// Entries of the table.
const ENTRIES: usize = 16;

/// Type of the outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    /// Step on the first pin, direction on the second.
    StepDir,
    /// Pulses upwards on the first pin, downwards on the second.
    UpDown,
    /// Two phases, a cycle for each step; upwards the first pin leads.
    Quadrature,
    /// One entry of the table after the other.
    Table,
}

/// The four times of a generator in ticks, as registers.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timing {
    dir_setup: u16,
    dir_hold: u16,
    step_len: u16,
    step_space: u16,
}

/// A timing register.
#[derive(Clone, Copy, Debug)]
pub(super) enum Time {
    DirSetup,
    DirHold,
    StepLen,
    StepSpace,
}

/// A generator after a tick. FACTS 14.4 to 14.12.
///
/// A step begins in the tick after the accumulator has crossed an integer. While a timer runs that
/// has to end first, the accumulator does not add if that would cross.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Generator {
    rate: i32,
    accum: u64,
    /// Accumulator and sign of the rate one tick ago.
    before: u64,
    was_negative: bool,
    mode: u8,
    timing: Timing,
    table: [u8; ENTRIES],
    table_max: u8,
    pointer: u8,
    step: bool,
    negative: bool,
    /// The rest of the pulse, and of the space after it, while they last.
    pulse: Option<u16>,
    space: Option<u16>,
    /// The rest of the times from a direction change to the next step, and from a step to the next
    /// direction change.
    setup: u16,
    hold: u16,
    latch: Option<Latch>,
}

impl Generator {
    /// A generator after configuration, with or without a latch on index and probe.
    pub(super) fn new(has_latch: bool) -> Self {
        Self {
            latch: has_latch.then(Latch::default),
            ..Self::default()
        }
    }

    /// ACCUM after the last tick.
    pub(super) fn accum(&self) -> u32 {
        (self.accum >> HIDDEN) as u32
    }

    /// ACCUM one tick earlier.
    pub(super) fn accum_before(&self) -> u32 {
        (self.before >> HIDDEN) as u32
    }

    /// MODE with the latched accumulator, as firmware with a latch returns it.
    pub(super) fn mode_word(&self) -> Option<u32> {
        let latched = self.latch?.latched();
        Some(latched << 8 | u32::from(self.mode))
    }

    pub(super) fn set_rate(&mut self, word: u32) {
        self.rate = word as i32;
    }

    /// Writes ACCUM; the bits below it stay.
    pub(super) fn set_accum(&mut self, word: u32) {
        self.accum = u64::from(word) << HIDDEN | self.accum & ((1 << HIDDEN) - 1);
    }

    pub(super) fn set_mode(&mut self, mode: u8) {
        self.mode = mode;
    }

    /// Writes a timing register. A timer that runs keeps its time.
    pub(super) fn set_time(&mut self, time: Time, word: u32) {
        let register = match time {
            Time::DirSetup => &mut self.timing.dir_setup,
            Time::DirHold => &mut self.timing.dir_hold,
            Time::StepLen => &mut self.timing.step_len,
            Time::StepSpace => &mut self.timing.step_space,
        };
        *register = (word & TIMING) as u16;
    }

    /// Writes TABLE: the entry becomes the first one, and all others move up.
    pub(super) fn push_entry(&mut self, word: u32) {
        self.table.rotate_right(1);
        self.table[0] = word as u8;
    }

    /// Writes TABLEMAX, which resets the pointer.
    pub(super) fn set_table_max(&mut self, word: u32) {
        self.table_max = (word & 0xF) as u8;
        self.pointer = 0;
    }

    /// The latch, if the firmware has one.
    pub(super) fn latch_mut(&mut self) -> Option<&mut Latch> {
        self.latch.as_mut()
    }

    /// The outputs: bit 0 is the first pin.
    pub(super) fn outputs(&self) -> u8 {
        let pins = |first: bool, second: bool| u8::from(first) | u8::from(second) << 1;
        let outputs = match self.style() {
            Style::StepDir => pins(self.step, self.negative),
            Style::UpDown => pins(self.step && !self.negative, self.step && self.negative),
            Style::Quadrature => {
                let quarter = self.accum % STEP / QUARTER;
                pins(matches!(quarter, 1 | 2), quarter >= 2)
            }
            Style::Table => {
                let entry = self.table.get(usize::from(self.pointer));
                entry.copied().unwrap_or_default()
            }
        };
        if self.mode & SWAP == 0 {
            return outputs;
        }
        outputs & !3 | outputs << 1 & 2 | outputs >> 1 & 1
    }

    /// Lets `ticks` pass, fewer than 2^31, from the state of the divider; `changed` gets the number
    /// of ticks up to each change of the outputs, and the outputs after it.
    pub(super) fn run(&mut self, divider: Divider, ticks: u64, mut changed: impl FnMut(u64, u8)) {
        let mut divider = divider;
        let mut shown = self.outputs();
        let mut passed = 0;
        while passed < ticks {
            let quiet = self.quiet(&divider).min(ticks - passed - 1);
            self.skip(&divider, quiet);
            divider.advance(quiet);
            self.clock(divider.adds_next());
            divider.advance(1);
            passed += quiet + 1;
            let outputs = self.outputs();
            if outputs != shown {
                changed(passed, outputs);
                shown = outputs;
            }
        }
    }

    /// Ticks from now on in which timers run, and the accumulator adds without crossing, or waits.
    pub(super) fn quiet(&self, divider: &Divider) -> u64 {
        if self.step_is_due() {
            return 0;
        }
        let timers = [
            self.pulse,
            self.space,
            Some(self.setup).filter(|&left| left > 0),
        ];
        let timers = timers.into_iter().flatten().map(u64::from);
        let hold = self.is_reversing().then_some(self.hold.into());
        let latch = self.latch.map(|latch| latch.quiet());
        let motion = self.adds_in_peace();
        let motion = motion.map(|adds| divider.until(adds + 1) - 1);
        let limits = timers.chain(hold).chain(latch).chain(motion);
        limits.min().unwrap_or(u64::MAX)
    }

    /// Number of additions before the one that crosses an integer, or changes the outputs; `None`
    /// if there is no such addition.
    fn adds_in_peace(&self) -> Option<u64> {
        let waits = self.waits();
        if self.style() == Style::Quadrature {
            let (phase, step) = (self.adds_within(QUARTER)?, self.adds_within(STEP)?);
            return (!waits || phase < step).then_some(phase);
        }
        // Divisions are what a simulation costs most.
        if waits { None } else { self.adds_within(STEP) }
    }

    /// Number of additions that stay within a multiple of `unit`; `None` if all do.
    fn adds_within(&self, unit: u64) -> Option<u64> {
        let rate = u64::from(self.rate.unsigned_abs());
        let place = self.accum % unit;
        let room = if self.rate < 0 {
            place
        } else {
            unit - 1 - place
        };
        room.checked_div(rate)
    }

    /// Lets quiet ticks pass.
    fn skip(&mut self, divider: &Divider, ticks: u64) {
        let Some(last) = ticks.checked_sub(1) else {
            return;
        };
        let accum = self.held(divider.adds(ticks));
        self.before = self.held(divider.adds(last));
        self.accum = accum;
        self.was_negative = self.rate < 0;
        let left = |time: u16| u64::from(time).saturating_sub(ticks) as u16;
        self.pulse = self.pulse.map(left);
        self.space = self.space.map(left);
        self.setup = left(self.setup);
        self.hold = left(self.hold);
        if let Some(latch) = &mut self.latch {
            latch.skip(ticks);
        }
    }

    /// One tick; `adds` if the accumulator adds in it.
    fn clock(&mut self, adds: bool) {
        if let Some(latch) = &mut self.latch {
            self.mode = latch.clock(self.mode, self.accum);
        }
        let begins = self.step_is_due();
        let next = self.added(adds.into());
        let stands = self.crosses(next) && self.waits();
        let accum = if stands { self.accum } else { next };
        let negative = self.rate < 0;
        self.run_pulse();
        self.run_direction(begins);
        if begins {
            self.begin_step();
        }
        self.before = self.accum;
        self.accum = accum;
        self.was_negative = negative;
    }

    /// Runs pulse, and space after it.
    fn run_pulse(&mut self) {
        let running = |left: Option<u16>| left.and_then(|left| left.checked_sub(1));
        self.space = running(self.space);
        if self.pulse == Some(0) {
            self.step = false;
            self.space = started(self.timing.step_space);
        }
        self.pulse = running(self.pulse);
    }

    /// Runs hold and set-up. The hold begins with a step.
    fn run_direction(&mut self, step_begins: bool) {
        self.setup = self.setup.saturating_sub(1);
        if step_begins {
            self.hold = self.timing.dir_hold;
        } else if self.hold > 0 {
            self.hold -= 1;
        } else if self.is_reversing() {
            self.negative = !self.negative;
            self.setup = self.timing.dir_setup;
        }
    }

    /// Begins a step. A pulse without length has no end.
    fn begin_step(&mut self) {
        self.step = true;
        self.pulse = started(self.timing.step_len);
        let (pointer, last) = (self.pointer, self.table_max);
        self.pointer = match self.was_negative {
            true if pointer == 0 => last,
            true => pointer - 1,
            false if pointer == last => 0,
            false => (pointer + 1) % ENTRIES as u8,
        };
    }

    /// True if a step begins in the next tick: the top bit of the fraction has changed in the
    /// direction of the rate, by an addition or by a write.
    fn step_is_due(&self) -> bool {
        let high = |accum: u64| accum & (STEP / 2) != 0;
        let (was, is) = (high(self.before), high(self.accum));
        was != is && is == self.was_negative
    }

    /// True while the direction does not yet follow the sign of the rate.
    fn is_reversing(&self) -> bool {
        self.negative != (self.rate < 0)
    }

    /// True while no step may begin.
    fn waits(&self) -> bool {
        let pulse = self.pulse.is_some() || self.space.is_some();
        pulse || self.setup > 0 || self.is_reversing()
    }

    /// The accumulator after a number of additions, of which those are left out that would cross.
    /// The result would be wrong for more than the additions in the longest time of a timer.
    fn held(&self, adds: u64) -> u64 {
        let there = self.added(adds);
        if self.crosses(there) {
            self.added(self.adds_within(STEP).unwrap_or_default())
        } else {
            there
        }
    }

    /// True if another value of the accumulator has another number of whole steps.
    fn crosses(&self, there: u64) -> bool {
        there / STEP != self.accum / STEP
    }

    /// The accumulator after a number of additions.
    fn added(&self, adds: u64) -> u64 {
        let change = i64::from(self.rate).wrapping_mul(adds as i64);
        self.accum.wrapping_add_signed(change) % (1 << ACCUM_BITS)
    }

    fn style(&self) -> Style {
        match self.mode & TYPE {
            0 => Style::StepDir,
            1 => Style::UpDown,
            2 => Style::Quadrature,
            _ => Style::Table,
        }
    }
}

/// A timer of this time; none for 0.
fn started(time: u16) -> Option<u16> {
    Some(time).filter(|&time| time > 0)
}
