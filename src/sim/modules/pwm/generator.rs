//! One PWM generator: what its two pins show at a clock, computed from what was written to it.

use super::divider::Divider;

const SYMMETRICAL: u32 = 1 << 2;
const DOUBLE_BUFFERED: u32 = 1 << 5;
const DITHER: u32 = 1 << 6;
const NEGATIVE: u32 = 1 << 31;
const PDM_STEPS: u32 = 4096;

/// Clocks from a write to the moment at which the generator has it; and, if that is a mode without
/// double buffer, until a value that waits is taken.
const TAKEN_AFTER: u64 = 2;
const RELEASED_AFTER: u64 = 5;

/// Clocks from the end of a period to the moment at which the generator has the value that waited
/// for it.
const LOADED_AFTER: u64 = 2;

/// Clocks through which sign and mode, the comparison with the reference and the PDM adder go
/// before they show on a pin.
const SIGN_DELAY: u64 = 1;
const COMPARE_DELAY: u64 = 2;
const PDM_DELAY: u64 = 3;

/// Which signal a generator puts on which pin.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    /// PWM on the first pin, sign on the second.
    Magnitude,
    /// Sign on the first pin, PWM on the second.
    Swapped,
    /// PWM on the first pin if bit 31 is set, on the second if it is not.
    UpDown,
    /// Pulse density on the first pin, sign on the second.
    Pdm,
}

/// The two dividers that all generators share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference {
    /// Counts the steps of a PWM period.
    pub(super) pwm: Divider,
    /// Each tick is an addition of the PDM.
    pub(super) pdm: Divider,
}

/// A generator.
#[derive(Clone, Copy, Debug)]
pub(super) struct Generator {
    /// What it has worked with, oldest first: pins show what was a few clocks ago.
    past: [Stage; 4],
    /// A value that waits for the end of a period, and since when.
    waiting: Option<(u32, u64)>,
}

/// What a generator works with from a clock on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stage {
    from: u64,
    value: u32,
    mode: u32,
    /// The PDM adder at the beginning: after so many ticks, with the carry of the last one.
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

    /// Takes over what has come into effect up to `now`.
    pub(super) fn settle(&mut self, now: u64, reference: &Reference) {
        let load = self.load(reference).filter(|load| load.from <= now);
        if let Some(load) = load {
            self.waiting = None;
            self.push(load);
        }
    }

    /// A value is written; [`settle`](Self::settle) comes first.
    pub(super) fn write_value(&mut self, now: u64, value: u32, reference: &Reference) {
        if self.newest().mode & DOUBLE_BUFFERED != 0 {
            let since = self.waiting.map_or(now, |(_, since)| since);
            let same = self.newest().value == value;
            self.waiting = (!same).then_some((value, since));
            return;
        }
        self.waiting = None;
        let mut stage = self.newest().followed(now + TAKEN_AFTER, reference);
        stage.value = value;
        self.push(stage);
    }

    /// A mode is written; [`settle`](Self::settle) comes first.
    pub(super) fn write_mode(&mut self, now: u64, mode: u32, reference: &Reference) {
        let mut stage = self.newest().followed(now + TAKEN_AFTER, reference);
        stage.mode = mode;
        self.push(stage);
        let Some((value, since)) = &mut self.waiting else {
            return;
        };
        *since = now;
        if mode & DOUBLE_BUFFERED == 0 {
            let mut stage = stage.followed(now + RELEASED_AFTER, reference);
            stage.value = *value;
            self.waiting = None;
            self.push(stage);
        }
    }

    /// When something that was written comes into effect, after `seen`.
    pub(super) fn next_change(&self, seen: u64, reference: &Reference) -> Option<u64> {
        let stages = self.past.iter().map(|stage| stage.from);
        let load = self.load(reference).map(|stage| stage.from);
        stages.chain(load).filter(|&from| from > seen).min()
    }

    /// The level of the first pin at a clock, or of the second.
    pub(super) fn level(&self, clock: u64, second: bool, reference: &Reference) -> bool {
        let at = |delay| self.stage_at(clock.saturating_sub(delay), reference);
        let now = at(SIGN_DELAY);
        let compared = || {
            let ticks = reference.pwm.ticks(clock.saturating_sub(COMPARE_DELAY));
            at(COMPARE_DELAY).compares(ticks)
        };
        match (now.style(), second) {
            (Style::Magnitude, false) | (Style::Swapped, true) => compared(),
            (Style::UpDown, _) => now.negative() != second && compared(),
            (Style::Pdm, false) => {
                let clock = clock.saturating_sub(PDM_DELAY);
                at(PDM_DELAY).adder(reference.pdm.ticks(clock)).1
            }
            (Style::Magnitude | Style::Pdm, true) | (Style::Swapped, false) => now.negative(),
        }
    }

    /// What it works with at a clock.
    pub(super) fn stage_at(&self, clock: u64, reference: &Reference) -> Stage {
        let load = self.load(reference).filter(|load| load.from <= clock);
        let past = || self.past.iter().rev().find(|stage| stage.from <= clock);
        load.or_else(|| past().copied()).unwrap_or(self.past[0])
    }

    fn newest(&self) -> Stage {
        self.past[3]
    }

    /// The stage that begins when the value that waits is taken.
    fn load(&self, reference: &Reference) -> Option<Stage> {
        let (value, since) = self.waiting?;
        let newest = self.newest();
        let period = newest.period();
        let before = reference.pwm.ticks(since.saturating_sub(1)) / period;
        let end = reference.pwm.reaches((before + 1) * period)?;
        let mut stage = newest.followed(end + LOADED_AFTER, reference);
        stage.value = value;
        Some(stage)
    }

    fn push(&mut self, stage: Stage) {
        // What begins at the same clock or later has not been seen.
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

    /// Steps of the width that the mode says.
    pub(super) fn steps(&self) -> u32 {
        1 << (9 + (self.mode & 3))
    }

    /// The part of the time in which the first pin is high, 0 to 1. A value of as many steps as
    /// there are or more is constantly on.
    pub(super) fn high_part(&self, dithers: bool) -> f64 {
        let fraction = if dithers && self.mode & DITHER != 0 {
            f64::from(self.value & 0xFFFF) / 65_536.0
        } else {
            0.0
        };
        let value = f64::from(self.duty()) + fraction;
        match self.style() {
            Style::Pdm => value / f64::from(PDM_STEPS),
            Style::Swapped => f64::from(u8::from(self.negative())),
            Style::UpDown if !self.negative() => 0.0,
            _ => (value / f64::from(self.steps())).min(1.0),
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

    /// The PWM signal: high while the value is more than the reference, which counts up, or up
    /// and down.
    fn compares(&self, ticks: u64) -> bool {
        let place = ticks % self.period();
        let steps = u64::from(self.steps());
        let reference = if place < steps {
            place
        } else {
            2 * steps - 1 - place
        };
        u64::from(self.duty()) > reference
    }

    /// The PDM adder after so many ticks, and its carry, which is the PDM signal.
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

    /// The same from a clock on, with the adder as it then is.
    fn followed(&self, from: u64, reference: &Reference) -> Self {
        let ticks = reference.pdm.ticks(from.saturating_sub(1));
        let (sum, carry) = self.adder(ticks);
        Self {
            from,
            ticks,
            sum,
            carry,
            ..*self
        }
    }
}
