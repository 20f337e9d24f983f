//! Times of the pulses: from nanoseconds to registers, and the highest rate that they allow.
//!
//! Source: FACTS 14.9 to 14.11.

/// The largest number of ticks that a register holds: 14 bits.
const LONGEST: u32 = 0x3FFF;

/// Times of the pulses in nanoseconds, as the parameters have them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PulseTimes {
    /// Length of a pulse.
    pub step_len: u32,
    /// Least time between two pulses.
    pub step_space: u32,
    /// From a change of the direction to the next pulse.
    pub dir_setup: u32,
    /// From the end of a pulse to a change of the direction.
    pub dir_hold: u32,
}

impl PulseTimes {
    /// The longest time of the registers in nanoseconds: 163830 at 100 MHz.
    pub fn longest(clock_hz: u32) -> u32 {
        let parts = u64::from(LONGEST).saturating_mul(1_000_000_000);
        let longest = parts.checked_div(clock_hz.into()).unwrap_or(0);
        u32::try_from(longest).unwrap_or(u32::MAX)
    }

    /// These times, each as long as a register allows.
    pub fn clipped(self, clock_hz: u32) -> Self {
        let longest = Self::longest(clock_hz);
        Self {
            step_len: self.step_len.min(longest),
            step_space: self.step_space.min(longest),
            dir_setup: self.dir_setup.min(longest),
            dir_hold: self.dir_hold.min(longest),
        }
    }
}

/// The registers of the times, in ticks of the clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PulseTicks {
    /// The register STEPLEN; never 0, which would set the output for ever.
    pub step_len: u32,
    /// The register STEPSPACE.
    pub step_space: u32,
    /// The register DIRSETUP.
    pub dir_setup: u32,
    /// The register DIRHOLD, which counts from the beginning of the pulse: it includes the pulse,
    /// so that the direction never changes inside one.
    pub dir_hold: u32,
}

impl PulseTicks {
    /// The registers for these times. Times are rounded down as in LinuxCNC: the generator adds a
    /// tick or more to each, so that none is shorter than asked for. The hold is rounded up. With a
    /// pulse that leaves no room for the hold, the direction changes at the end of the pulse or
    /// later.
    pub fn new(times: PulseTimes, clock_hz: u32) -> Self {
        let step_len = ticks(times.step_len, clock_hz).clamp(1, LONGEST);
        let hold = ticks(times.dir_hold, clock_hz).saturating_add(1);
        Self {
            step_len,
            step_space: ticks(times.step_space, clock_hz).min(LONGEST),
            dir_setup: ticks(times.dir_setup, clock_hz).min(LONGEST),
            dir_hold: step_len.saturating_add(hold).min(LONGEST),
        }
    }

    /// The time from the end of a pulse to a change of the direction, in nanoseconds: less than
    /// asked for if the pulse leaves no room for it in the register.
    pub fn hold_left(&self, clock_hz: u32) -> u32 {
        let left = u64::from(self.dir_hold.saturating_sub(self.step_len));
        let ns = left
            .saturating_mul(1_000_000_000)
            .checked_div(clock_hz.into());
        ns.and_then(|ns| u32::try_from(ns).ok()).unwrap_or(u32::MAX)
    }

    /// The highest rate in steps per second: beyond it the accumulator waits for the timers, and
    /// the position lags.
    pub fn highest_rate(&self, clock_hz: u32) -> f64 {
        let low = match self.step_space {
            0 => 2,
            space => space.saturating_add(3),
        };
        let period = self.step_len.saturating_add(1).saturating_add(low);
        f64::from(clock_hz) / f64::from(period)
    }

    /// The time that the timers of one step take at most, in seconds: after it a generator with a
    /// rate of 0 rests.
    pub fn settling(&self, clock_hz: u32) -> f64 {
        let all = [
            self.step_len,
            self.step_space,
            self.dir_setup,
            self.dir_hold,
        ];
        let ticks: f64 = all.into_iter().map(f64::from).sum();
        (ticks + 16.0) / f64::from(clock_hz)
    }
}

/// Nanoseconds as whole ticks of the clock.
fn ticks(ns: u32, clock_hz: u32) -> u32 {
    let ticks = u64::from(ns).saturating_mul(clock_hz.into()) / 1_000_000_000;
    u32::try_from(ticks).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CLOCK: u32 = 100_000_000;

    fn times(step_len: u32, step_space: u32, dir_setup: u32, dir_hold: u32) -> PulseTimes {
        PulseTimes {
            step_len,
            step_space,
            dir_setup,
            dir_hold,
        }
    }

    #[test]
    fn registers_are_ticks_and_the_hold_includes_the_pulse() {
        let ticks = PulseTicks::new(times(2_500, 5_009, 10_000, 4_000), CLOCK);
        assert_eq!((ticks.step_len, ticks.step_space), (250, 500));
        assert_eq!((ticks.dir_setup, ticks.dir_hold), (1_000, 250 + 401));
    }

    /// 10/10 ticks are 4.17 MHz, and without a space the period is STEPLEN + 3.
    #[test]
    fn highest_rate_is_that_of_the_gateware() {
        let highest =
            |len, space| PulseTicks::new(times(len, space, 0, 0), CLOCK).highest_rate(CLOCK);
        assert_eq!(highest(100, 100), 1e8 / 24.0);
        assert_eq!(highest(100, 0), 1e8 / 13.0);
        assert_eq!(highest(0, 0), 1e8 / 4.0);
        assert_eq!(highest(163_830, 163_830), 1e8 / 32_770.0);
    }

    #[test]
    fn times_that_a_register_does_not_hold_are_the_longest() {
        assert_eq!(PulseTimes::longest(CLOCK), 163_830);
        let clipped = times(u32::MAX, 163_831, 163_830, 5).clipped(CLOCK);
        assert_eq!(clipped, times(163_830, 163_830, 163_830, 5));
        let ticks = PulseTicks::new(times(163_830, 163_830, 163_830, 163_830), CLOCK);
        let all = [
            ticks.step_len,
            ticks.step_space,
            ticks.dir_setup,
            ticks.dir_hold,
        ];
        assert_eq!(all, [LONGEST; 4]);
    }

    proptest! {
        /// The generator's own ticks: pulse +1, space +3 (2 for 0), set-up +2, hold +1.
        #[test]
        fn no_step_time_is_too_short_and_direction_holds_during_a_pulse(
            len in 0u32..163_831, space in 0u32..163_831, setup in 0u32..163_831, hold in 0u32..163_831,
            clock in 33_000_000u32..200_000_000,
        ) {
            let longest = PulseTimes::longest(clock);
            let asked = times(len, space, setup, hold).clipped(clock);
            let made = PulseTicks::new(asked, clock);
            let ns = |ticks: u32| f64::from(ticks) * 1e9 / f64::from(clock) + 1e-6;
            prop_assert!(ns(made.step_len + 1) >= asked.step_len.into());
            let low = if made.step_space == 0 { 2 } else { made.step_space + 3 };
            prop_assert!(ns(low) >= asked.step_space.into());
            prop_assert!(ns(made.dir_setup + 2) >= asked.dir_setup.into());
            prop_assert!(made.dir_hold >= made.step_len && made.step_len >= 1);
            let held = ns(made.dir_hold - made.step_len);
            prop_assert!((f64::from(made.hold_left(clock)) - held).abs() <= 1.0);
            let fits = u64::from(asked.step_len) + u64::from(hold) + 100 < longest.into();
            prop_assert!(!fits || held >= hold.into());
            prop_assert!([made.step_len, made.step_space, made.dir_setup, made.dir_hold].iter().all(|t| *t <= LONGEST));
        }
    }
}
