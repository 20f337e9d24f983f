//! A PWM generator: the levels of its two pins at a clock, computed from its written registers.

use super::divider::Divider;

const SYMMETRICAL: u32 = 1 << 2;
const DOUBLE_BUFFERED: u32 = 1 << 5;
pub(super) const DITHER: u32 = 1 << 6;
const NEGATIVE: u32 = 1 << 31;
const PDM_STEPS: u32 = 4096;
/// The register that holds duty and carry has 12 bits.
const GREATEST_DUTY: u32 = 0xFFF;
const FRACTIONS: u64 = 0x1_0000;

/// Clocks from a write until the generator uses the word.
const TAKEN_AFTER: u64 = 2;

/// Clocks from the end of a period until the generator uses the value that waited for it.
const LOADED_AFTER: u64 = 2;

/// Clocks until a change shows on a pin: of sign and mode, of the comparison with the reference, of
/// the reference's turn, and of the PDM adder.
const SIGN_DELAY: u64 = 1;
const COMPARE_DELAY: u64 = 2;
const TURN_DELAY: u64 = 3;
const PDM_DELAY: u64 = 3;

/// Number of clocks after a tick within which a value is still added at that tick.
const ADDED_AHEAD: u64 = 1;

/// Assignment of the signals of a generator to its pins.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    /// PWM on the first pin, sign on the second.
    Magnitude,
    /// Sign on the first pin, PWM on the second.
    Swapped,
    /// PWM on the first pin if bit 31 is set, on the second otherwise.
    UpDown,
    /// Pulse density on the first pin, sign on the second.
    Pdm,
}

/// The two dividers that all generators share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference {
    /// Counts the steps of a PWM period.
    pub(super) pwm: Divider,
    /// Each tick is one addition of the PDM.
    pub(super) pdm: Divider,
}

/// A generator.
#[derive(Clone, Copy, Debug)]
pub(super) struct Generator {
    /// Recent stages, oldest first: pins show the state of a few clocks ago.
    past: [Stage; 4],
    /// A value that waits for the end of a period, and the clock since when.
    waiting: Option<(u32, u64)>,
}

/// The state of a generator from a clock on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stage {
    from: u64,
    value: u32,
    mode: u32,
    /// True if the stage begins with the load of a value that had waited.
    is_load: bool,
    /// The PDM adder at the beginning: after this many ticks, with the carry of the last one.
    ticks: u64,
    sum: u32,
    carry: bool,
    /// The adder of the fraction at the beginning, which advances at each end of a period.
    fraction: Fraction,
}

/// The adder for dithering, at the beginning of a stage: after this many ticks of the reference.
#[derive(Clone, Copy, Debug, Default)]
struct Fraction {
    ticks: u64,
    sum: u32,
    carry: bool,
}

impl Generator {
    pub(super) fn new(from: u64) -> Self {
        let stage = Stage {
            from,
            ..Stage::default()
        };
        Self {
            past: [stage; 4],
            waiting: None,
        }
    }

    /// Applies the load that has taken effect up to `now`.
    pub(super) fn settle(&mut self, now: u64, reference: &Reference) {
        let load = self.load(reference).filter(|load| load.from <= now);
        if let Some(load) = load {
            self.waiting = None;
            self.push(load);
        }
    }

    /// Writes a value; call [`settle`](Self::settle) first.
    pub(super) fn write_value(&mut self, now: u64, value: u32, reference: &Reference) {
        let [.., newest] = &mut self.past;
        if newest.is_load && newest.from >= now {
            // The load in progress takes the new value.
            newest.value = value;
            return;
        }
        if newest.mode & DOUBLE_BUFFERED != 0 {
            let since = self.waiting.map_or(now, |(_, since)| since);
            self.waiting = Some((value, since));
            return;
        }
        self.waiting = None;
        let mut stage = self.newest().followed(now + TAKEN_AFTER, reference);
        stage.value = value;
        self.push(stage);
    }

    /// Writes a mode; call [`settle`](Self::settle) first.
    ///
    /// A waiting value is loaded before the mode if a period ends before the mode takes effect. The
    /// value is loaded together with the mode if that has no double buffer, or if it changes which
    /// half of the period this is: the change looks like the end of a period. Otherwise the value
    /// is loaded at the end of the next period.
    pub(super) fn write_mode(&mut self, now: u64, mode: u32, reference: &Reference) {
        let before = self.newest();
        let from = now + TAKEN_AFTER;
        let mut stage = before.followed(from, reference);
        stage.mode = mode;
        let Some((value, since)) = self.waiting else {
            self.push(stage);
            return;
        };
        let changed = || {
            let ends = mode & DOUBLE_BUFFERED == 0 || stage.seems_to_end(&before, reference);
            ends.then_some(from + 1)
        };
        let end = before.period_end(since, reference);
        let end = end.filter(|&end| end <= from).or_else(changed);
        let Some(end) = end else {
            self.push(stage);
            self.waiting = Some((value, from + 2));
            return;
        };
        self.waiting = None;
        let load = end + LOADED_AFTER;
        if load < from {
            self.push(before.loaded(load, value, reference));
            stage = self.newest().followed(from, reference);
            stage.mode = mode;
            self.push(stage);
        } else {
            self.push(stage);
            self.push(stage.loaded(load, value, reference));
        }
    }

    /// The clock after `seen` at which a written word next takes effect.
    pub(super) fn next_change(&self, seen: u64, reference: &Reference) -> Option<u64> {
        let stages = self.past.iter().map(|stage| stage.from);
        let load = self.load(reference).map(|stage| stage.from);
        let unwraps = self.newest().wrapped_until(reference);
        let changes = stages.chain(load).chain(unwraps);
        changes.filter(|&from| from > seen).min()
    }

    /// The level of the first or of the second pin at a clock.
    pub(super) fn level(&self, clock: u64, second: bool, reference: &Reference) -> bool {
        let at = |delay| self.stage_at(clock.saturating_sub(delay), reference);
        let now = at(SIGN_DELAY);
        let compared = || {
            let ticks = reference.pwm.ticks(clock.saturating_sub(COMPARE_DELAY));
            let stage = at(COMPARE_DELAY);
            let (_, carry) = stage.dither(clock.saturating_sub(COMPARE_DELAY), reference);
            stage.compares(at(TURN_DELAY).ramp(ticks), carry)
        };
        match (now.style(), second) {
            (Style::Magnitude, false) | (Style::Swapped, true) => compared(),
            (Style::UpDown, _) => now.negative() != second && compared(),
            (Style::Pdm, false) => {
                let clock = clock.saturating_sub(PDM_DELAY);
                at(PDM_DELAY - ADDED_AHEAD)
                    .adder(reference.pdm.ticks(clock))
                    .1
            }
            (Style::Magnitude | Style::Pdm, true) | (Style::Swapped, false) => now.negative(),
        }
    }

    /// The stage in effect at a clock.
    pub(super) fn stage_at(&self, clock: u64, reference: &Reference) -> Stage {
        let load = self.load(reference).filter(|load| load.from <= clock);
        let past = || self.past.iter().rev().find(|stage| stage.from <= clock);
        load.or_else(|| past().copied()).unwrap_or(self.past[0])
    }

    fn newest(&self) -> Stage {
        self.past[3]
    }

    /// The stage that begins when the waiting value is loaded.
    fn load(&self, reference: &Reference) -> Option<Stage> {
        let (value, since) = self.waiting?;
        let newest = self.newest();
        let end = newest.period_end(since, reference)?;
        Some(newest.loaded(end + LOADED_AFTER, value, reference))
    }

    fn push(&mut self, stage: Stage) {
        // A stage that begins at the same clock or later has not shown yet: replace it.
        if self.newest().from < stage.from {
            self.past.rotate_left(1);
        }
        self.past[3] = stage;
    }
}

impl Stage {
    pub(super) fn style(&self) -> Style {
        match self.mode >> 3 & 3 {
            0 => Style::Magnitude,
            1 => Style::Swapped,
            2 => Style::UpDown,
            _ => Style::Pdm,
        }
    }

    pub(super) fn symmetrical(&self) -> bool {
        self.mode & SYMMETRICAL != 0
    }

    /// Number of steps in the width that the mode selects.
    pub(super) fn steps(&self) -> u32 {
        1 << (9 + (self.mode & 3))
    }

    /// Fraction of the time in which the first pin is high at a clock, 0 to 1. A value of at least
    /// the number of steps is constantly on.
    ///
    /// The result is the mean of the dithered periods, except for a period that a carry of the
    /// previous value has wrapped to 0.
    pub(super) fn high_part(&self, clock: u64, reference: &Reference) -> f64 {
        let part = |duty: u32| (f64::from(duty) / f64::from(self.steps())).min(1.0);
        let mean = || {
            let more = self.added() as f64 / FRACTIONS as f64;
            let carried = (self.duty() + 1) & GREATEST_DUTY;
            part(self.duty()) * (1.0 - more) + part(carried) * more
        };
        match self.style() {
            Style::Pdm => f64::from(self.duty()) / f64::from(PDM_STEPS),
            Style::Swapped => f64::from(u8::from(self.negative())),
            Style::UpDown if !self.negative() => 0.0,
            _ if self.wrapped_until(reference).is_some_and(|end| clock < end) => 0.0,
            _ => mean(),
        }
    }

    /// Ticks from one end of a period to the next.
    fn period(&self) -> u64 {
        u64::from(self.steps()) << u32::from(self.symmetrical())
    }

    fn duty(&self) -> u32 {
        self.value >> 16 & 0xFFF
    }

    fn negative(&self) -> bool {
        self.value & NEGATIVE != 0
    }

    /// The clock at which the first period ends, not before `since`.
    fn period_end(&self, since: u64, reference: &Reference) -> Option<u64> {
        let before = reference.pwm.ticks(since.saturating_sub(1)) / self.period();
        reference.pwm.reaches((before + 1) * self.period())
    }

    /// True in the second half of a symmetrical period, after this many ticks.
    fn is_second_half(&self, ticks: u64) -> bool {
        ticks & u64::from(self.steps()) != 0
    }

    /// True if the mode that comes with the stage looks like the end of a period.
    fn seems_to_end(&self, before: &Self, reference: &Reference) -> bool {
        let was = before.is_second_half(reference.pwm.ticks(self.from));
        let is = self.is_second_half(reference.pwm.ticks(self.from + 1));
        if self.symmetrical() {
            was && !is
        } else {
            was != is
        }
    }

    /// Reference for the comparison after this many ticks: counts up, or up and down.
    fn ramp(&self, ticks: u64) -> u64 {
        if self.symmetrical() && self.is_second_half(ticks) {
            !ticks
        } else {
            ticks
        }
    }

    /// The PWM signal: high while the value and its carry exceed the reference. The carry is added
    /// without saturation: Mesa's VHDL, `dpwmpdmgenh`.
    fn compares(&self, ramp: u64, carry: bool) -> bool {
        let carry = carry && self.mode & DITHER != 0;
        let value = (self.duty() + u32::from(carry)) & GREATEST_DUTY;
        u64::from(value) > ramp & u64::from(self.steps() - 1)
    }

    /// Fraction added at the end of each period, in 65536ths.
    fn added(&self) -> u64 {
        if self.mode & DITHER == 0 {
            return 0;
        }
        u64::from(self.value) % FRACTIONS
    }

    /// The adder of the fraction at a clock, and the carry that is added to the duty while
    /// dithering: that of the last end of a period, whichever value was in effect then.
    fn dither(&self, clock: u64, reference: &Reference) -> (u32, bool) {
        let Fraction { ticks, sum, carry } = self.fraction;
        if self.mode & DITHER == 0 {
            return (sum, carry);
        }
        let now = reference.pwm.ticks(clock.saturating_sub(LOADED_AFTER));
        let ends = (now / self.period()).saturating_sub(ticks / self.period());
        if ends == 0 {
            return (sum, carry);
        }
        let before = (u64::from(sum) + (ends - 1) % FRACTIONS * self.added()) % FRACTIONS;
        let sum = before + self.added();
        ((sum % FRACTIONS) as u32, sum >= FRACTIONS)
    }

    /// The clock of the end of the period in which the stage began, if a carry of the previous
    /// value wraps the duty to 0 until then.
    fn wrapped_until(&self, reference: &Reference) -> Option<u64> {
        let wraps = self.mode & DITHER != 0 && self.duty() == GREATEST_DUTY && self.fraction.carry;
        let ends = self.fraction.ticks / self.period() + 1;
        let end = reference.pwm.reaches(ends * self.period());
        end.filter(|_| wraps).map(|end| end + LOADED_AFTER)
    }

    /// The PDM adder after this many ticks, and its carry, which is the PDM signal.
    fn adder(&self, ticks: u64) -> (u32, bool) {
        let Some(added) = ticks.checked_sub(self.ticks).filter(|&added| added > 0) else {
            return (self.sum, self.carry);
        };
        let steps = u64::from(PDM_STEPS);
        let duty = u64::from(self.duty());
        let before = (u64::from(self.sum) + (added - 1) % steps * duty) % steps;
        let sum = before + duty;
        ((sum % steps) as u32, sum >= steps)
    }

    /// The stage that follows with another value, after a load.
    fn loaded(&self, from: u64, value: u32, reference: &Reference) -> Self {
        Self {
            value,
            is_load: true,
            ..self.followed(from, reference)
        }
    }

    /// The stage that follows at a clock, with the adder's state at that clock.
    fn followed(&self, from: u64, reference: &Reference) -> Self {
        let ticks = reference.pdm.ticks(from.saturating_sub(1 + ADDED_AHEAD));
        let (sum, carry) = self.adder(ticks);
        let (fraction_sum, fraction_carry) = self.dither(from, reference);
        Self {
            from,
            is_load: false,
            ticks,
            sum,
            carry,
            fraction: Fraction {
                ticks: reference.pwm.ticks(from.saturating_sub(LOADED_AFTER)),
                sum: fraction_sum,
                carry: fraction_carry,
            },
            ..*self
        }
    }
}
