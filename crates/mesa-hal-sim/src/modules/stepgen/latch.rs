//! The latch of the accumulator on index and probe, with the filters of the two inputs.

/// Bits of the mode.
const ON_INDEX: u8 = 1 << 4;
const INDEX_RISES: u8 = 1 << 5;
const ON_PROBE: u8 = 1 << 6;
const PROBE_RISES: u8 = 1 << 7;

/// The accumulator's 48 bits, without those that the latch does not take.
const LATCHED_ABOVE: u32 = 24;

/// Latch of a generator. FACTS 14.14.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Latch {
    pub(super) index: Filter,
    pub(super) probe: Filter,
    latched: u32,
}

impl Latch {
    /// The upper 24 bits of the accumulator at the last edge that was armed.
    pub(super) fn latched(&self) -> u32 {
        self.latched
    }

    /// One tick, before which the accumulator is `accum`; returns the mode without the enable bit
    /// of a latch that has taken it.
    pub(super) fn clock(&mut self, mode: u8, accum: u64) -> u8 {
        let index = self.index.clock();
        let probe = self.probe.clock();
        let mut left = mode;
        for (edge, enable, rises) in [
            (index, ON_INDEX, INDEX_RISES),
            (probe, ON_PROBE, PROBE_RISES),
        ] {
            if mode & enable != 0 && edge == Some(mode & rises != 0) {
                self.latched = (accum >> LATCHED_ABOVE) as u32;
                left &= !enable;
            }
        }
        left
    }

    /// Ticks from now on in which only the filters count.
    pub(super) fn quiet(&self) -> u64 {
        self.index.quiet().min(self.probe.quiet())
    }

    /// Lets quiet ticks pass.
    pub(super) fn skip(&mut self, ticks: u64) {
        self.index.count_on(ticks);
        self.probe.count_on(ticks);
    }
}

/// Filter of an input: counts up while the input is 1 and down while it is 0. Its output changes
/// after the count has reached an end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filter {
    level: bool,
    count: u8,
    output: bool,
    /// The output one tick ago.
    before: bool,
}

impl Default for Filter {
    /// The state after configuration, with the input pulled up.
    fn default() -> Self {
        Self {
            level: true,
            count: 0,
            output: false,
            before: false,
        }
    }
}

impl Filter {
    /// Sets the level of the input from the next tick on.
    pub(super) fn set(&mut self, level: bool) {
        self.level = level;
    }

    /// One tick; returns the level to which the output has changed in the previous one.
    fn clock(&mut self) -> Option<bool> {
        let edge = (self.output != self.before).then_some(self.output);
        self.before = self.output;
        match self.count {
            u8::MAX => self.output = true,
            0 => self.output = false,
            _ => {}
        }
        self.count_on(1);
        edge
    }

    fn quiet(self) -> u64 {
        if self.output != self.before {
            return 0;
        }
        match (self.output, self.level) {
            (false, _) if self.count == u8::MAX => 0,
            (true, _) if self.count == 0 => 0,
            (false, true) => (u8::MAX - self.count).into(),
            (true, false) => self.count.into(),
            _ => u64::MAX,
        }
    }

    fn count_on(&mut self, ticks: u64) {
        let ticks = u8::try_from(ticks).unwrap_or(u8::MAX);
        self.count = if self.level {
            self.count.saturating_add(ticks)
        } else {
            self.count.saturating_sub(ticks)
        };
    }
}
