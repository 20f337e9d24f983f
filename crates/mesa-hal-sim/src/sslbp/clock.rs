//! The processor's clock and its tick timer.

use crate::wire::Nanos;

/// Converts between clock cycles and nanoseconds without division on the hot path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    hz: u32,
    /// Duration of one cycle, in units of 2^-32 ns.
    period: u128,
}

impl Clock {
    /// A clock of `hz` hertz.
    pub fn new(hz: u32) -> Self {
        Self {
            hz,
            period: (1_000_000_000_u128 << 32) / u128::from(hz.max(1)),
        }
    }

    /// The frequency.
    pub fn hz(&self) -> u32 {
        self.hz
    }

    /// Start of cycle number `cycle`.
    pub fn nanos(&self, cycle: u64) -> Nanos {
        ((u128::from(cycle) * self.period) >> 32) as Nanos
    }

    /// The first cycle that begins at or after `time`.
    pub fn cycle_at(&self, time: Nanos) -> u64 {
        let mut cycle = ((u128::from(time) << 32) / self.period) as u64;
        while self.nanos(cycle) < time {
            cycle += 1;
        }
        cycle
    }
}

/// The 16-bit tick counter behind all timeouts of the port.
///
/// Its divider can be changed at any time, but the current tick keeps its old length: the first
/// timeout after a START therefore depends on the previous command.
#[derive(Clone, Copy, Debug)]
pub(super) struct TickTimer {
    count: u16,
    /// Cycle of the last change of `count`.
    since: u64,
    /// Length of the current tick in cycles.
    current: u64,
    /// Length of the following ticks in cycles.
    period: u64,
}

impl TickTimer {
    /// The timer after reset, counting at its highest rate.
    pub fn new() -> Self {
        Self {
            count: 0,
            since: 0,
            current: 2,
            period: 2,
        }
    }

    /// The tick counter at `cycle`, which must not go back.
    pub fn read(&mut self, cycle: u64) -> u16 {
        let elapsed = cycle.saturating_sub(self.since);
        if elapsed >= self.current {
            let rest = elapsed - self.current;
            let more = rest / self.period;
            self.count = self.count.wrapping_add(1).wrapping_add(more as u16);
            self.since += self.current + more * self.period;
            self.current = self.period;
        }
        self.count
    }

    /// Sets the length of ticks from the next one on.
    pub fn set_period(&mut self, cycle: u64, period: u64) {
        self.read(cycle);
        self.period = period.max(2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cycles_and_nanoseconds_agree_at_even_and_odd_frequencies() {
        let clock = Clock::new(100_000_000);
        assert_eq!(clock.nanos(12_345), 123_450);
        assert_eq!(clock.cycle_at(123_450), 12_345);
        assert_eq!(clock.cycle_at(123_451), 12_346);
        let clock = Clock::new(33_333_333);
        for cycle in [0, 1, 2, 1_000_003, 33_333_333_000] {
            assert_eq!(clock.cycle_at(clock.nanos(cycle)), cycle);
        }
    }

    #[test]
    fn new_divider_counts_after_the_tick_that_is_running() {
        let mut timer = TickTimer::new();
        let start = timer.read(1_000);
        timer.set_period(1_000, 20_000);
        assert_eq!(timer.read(1_002), start.wrapping_add(1));
        assert_eq!(timer.read(21_001), start.wrapping_add(1));
        assert_eq!(timer.read(21_002), start.wrapping_add(2));
        timer.set_period(21_010, 200);
        assert_eq!(timer.read(41_001), start.wrapping_add(2));
        assert_eq!(timer.read(41_202), start.wrapping_add(4));
    }
}
