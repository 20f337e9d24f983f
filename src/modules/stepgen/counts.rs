//! The position of a generator: its accumulator without wrap-around.
//!
//! Source: FACTS 14.4.

use core::time::Duration;

use crate::modules::doubt::PositionDoubt;

/// Number of steps between two reads that is the same in either direction, less one.
pub(super) const AMBIGUOUS: f64 = 32_767.0;

/// Sub-counts of a step.
pub(super) const SUB_COUNTS: f64 = 65_536.0;

/// The position in sub-counts: 65536 for each step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StepCounts {
    /// Sub-counts since the start, the last reset or the last index.
    pub sub_counts: i64,
    /// The motor may stand elsewhere: steps were made while its pins were no outputs, or the
    /// accumulator may have wrapped around unseen. Kept until the next reset or index.
    pub doubt: PositionDoubt,
    /// The accumulator of the last read; `None` if the next one is the origin.
    last: Option<u32>,
}

/// The movement of a motor until its pins were released, in sub-counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Expected {
    /// As long, whatever the accumulator shows: it may have wrapped around.
    ByTime(i64),
    /// As long, and no longer than that of the accumulator.
    Within(i64),
    /// That of the accumulator, less this.
    Beyond(i64),
    /// In the time that it ran, of the whole time since the last read, both in seconds, with a
    /// change from one speed to the other, in sub-counts per second: the accumulator shows when.
    Changed {
        speeds: [f64; 2],
        ran: f64,
        gap: f64,
    },
}

impl Expected {
    /// The movement of the motor, if the accumulator has moved by `moved`.
    fn made(self, moved: i64) -> i64 {
        let made = match self {
            Self::ByTime(made) => return made,
            Self::Within(made) => made,
            Self::Beyond(beyond) => moved.saturating_sub(beyond),
            Self::Changed {
                speeds: [before, after],
                ran,
                gap,
            } => {
                let change = before - after;
                let changed_at = if change == 0.0 {
                    0.0
                } else {
                    ((moved as f64 - after * gap) / change).clamp(0.0, gap)
                };
                let first = changed_at.min(ran);
                return (before * first + after * (ran - first)) as i64;
            }
        };
        made.clamp(moved.min(0), moved.max(0))
    }
}

impl StepCounts {
    /// True if a position is known that can be lost.
    pub const fn has_begun(&self) -> bool {
        self.last.is_some()
    }

    /// Takes the accumulator; returns its movement since the last read.
    pub fn read(&mut self, accumulator: u32) -> i64 {
        let last = self.last.replace(accumulator).unwrap_or(accumulator);
        let moved = i64::from(accumulator.wrapping_sub(last) as i32);
        self.sub_counts = self.sub_counts.wrapping_add(moved);
        moved
    }

    /// Takes the time since the last read, before the next one: with the highest rate of that time
    /// in steps per second, the accumulator may have wrapped around. Returns true if so.
    pub fn observe_gap(&mut self, gap: Duration, fastest: f64) -> bool {
        let is_ambiguous = self.last.is_some() && gap.as_secs_f64() * fastest >= AMBIGUOUS;
        self.doubt.add(is_ambiguous);
        is_ambiguous
    }

    /// Takes the accumulator of a generator whose pins were released, after it had moved by
    /// `expected`: the motor has stood still since.
    pub fn released(&mut self, accumulator: u32, expected: Expected) {
        let before = self.sub_counts;
        let moved = self.read(accumulator);
        let made = expected.made(moved);
        self.sub_counts = before.wrapping_add(made);
        self.doubt.add(true);
    }

    /// Makes the present position 0.
    pub fn reset(&mut self) {
        self.sub_counts = 0;
        self.doubt.settle();
    }

    /// Makes the position 0 where the accumulator had a latched value.
    pub fn restart_at(&mut self, latched: u32) {
        let behind = self.behind(latched);
        self.sub_counts = behind;
        self.doubt.settle();
    }

    /// The position at which the accumulator had a latched value: its upper 24 bits.
    pub fn position_at(&self, latched: u32) -> i64 {
        self.sub_counts.wrapping_sub(self.behind(latched))
    }

    /// Distance of a latched value behind the present position.
    fn behind(&self, latched: u32) -> i64 {
        let accumulator = self.last.unwrap_or(0);
        i64::from(accumulator.wrapping_sub(latched << 8) as i32)
    }

    /// Takes the next accumulator as the origin: the position continues from here, whatever steps
    /// were made meanwhile.
    pub fn resume(&mut self) {
        self.doubt.add(self.last.is_some());
        self.last = None;
    }

    /// Whole steps, rounded down.
    pub const fn steps(&self) -> i32 {
        (self.sub_counts >> 16) as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);

    proptest! {
        #[test]
        fn position_is_that_of_a_wide_accumulator_over_any_walk(
            start: u32, moves in prop::collection::vec(i32::MIN..=i32::MAX, 1..200),
        ) {
            let mut counts = StepCounts::default();
            counts.read(start);
            let mut wide = i64::from(start);
            for change in moves {
                wide += i64::from(change);
                prop_assert_eq!(counts.read(wide as u32), i64::from(change));
                prop_assert_eq!(counts.sub_counts, wide - i64::from(start));
                prop_assert_eq!(counts.steps(), (counts.sub_counts >> 16) as i32);
            }
            prop_assert!(!counts.doubt.is_unsure());
        }

        #[test]
        fn latched_point_is_found_on_both_sides_of_a_wrap_around(
            start: u32, before in -1_000_000_000i64..1_000_000_000, after in -1_000_000_000i64..1_000_000_000,
        ) {
            let mut counts = StepCounts::default();
            counts.read(start);
            let at = i64::from(start) + before;
            let end = at + after;
            // In two reads, because of the distance.
            counts.read(at as u32);
            counts.read(end as u32);
            let latched = at as u32 >> 8;
            let below = at & 0xFF;
            prop_assert_eq!(counts.position_at(latched), before - below);
            counts.doubt.add(true);
            counts.restart_at(latched);
            prop_assert_eq!((counts.sub_counts, counts.doubt.is_unsure()), (after + below, false));
        }
    }

    #[test]
    fn gap_with_a_possible_wrap_is_unsure_until_a_reset() {
        let mut counts = StepCounts::default();
        assert!(!counts.observe_gap(MS * 9, 4e6));
        counts.read(5);
        assert!(!counts.observe_gap(MS * 8, 4e6));
        assert!(!counts.doubt.is_unsure());
        assert!(counts.observe_gap(MS * 9, 4e6));
        counts.read(7);
        assert!(!counts.observe_gap(MS, 4e6));
        assert!(counts.doubt.is_unsure());
        counts.reset();
        assert_eq!((counts.sub_counts, counts.doubt.is_unsure()), (0, false));
        counts.read(u32::MAX);
        assert_eq!(
            (counts.sub_counts, counts.steps()),
            (-8, -1),
            "rounded down"
        );
    }

    #[test]
    fn motor_stands_where_it_was_when_its_pins_were_released() {
        const STEP: i64 = 65_536;
        let changed = |speeds: [f64; 2]| Expected::Changed {
            speeds: speeds.map(|speed| speed * STEP as f64),
            ran: 0.02,
            gap: 0.1,
        };
        for (expected, moved, made) in [
            (Expected::ByTime(100), 7, 100),
            (Expected::Within(100), 500, 100),
            (Expected::Within(100), 80, 80),
            (Expected::Within(100), -5, 0),
            (Expected::Beyond(-400), -500, -100),
            (Expected::Beyond(400), 300, 0),
            // At once, in the middle of the time that it ran, and when it did not run any more.
            (changed([1_000.0, 5_000.0]), 500 * STEP, 100 * STEP),
            (changed([1_000.0, 5_000.0]), 460 * STEP, 60 * STEP),
            (changed([5_000.0, 0.0]), 50 * STEP, 50 * STEP),
            (changed([5_000.0, 0.0]), 400 * STEP, 100 * STEP),
            (changed([5_000.0, 5_000.0]), 500 * STEP, 100 * STEP),
        ] {
            let mut counts = StepCounts::default();
            counts.read(12);
            counts.released(12_u32.wrapping_add(moved as u32), expected);
            assert!(
                (counts.sub_counts - made).abs() <= 2,
                "{expected:?}: {}",
                counts.sub_counts
            );
            assert!(counts.doubt.is_unsure());
        }
    }

    #[test]
    fn position_resumes_where_it_was_after_unobserved_steps() {
        let mut counts = StepCounts::default();
        counts.resume();
        assert!(!counts.doubt.is_unsure(), "nothing to lose");
        counts.read(0);
        counts.read(9 << 16);
        counts.resume();
        assert_eq!(counts.read(500 << 16), 0);
        assert_eq!((counts.steps(), counts.doubt.is_unsure()), (9, true));
        counts.read(501 << 16);
        assert_eq!(counts.steps(), 10);
    }
}
