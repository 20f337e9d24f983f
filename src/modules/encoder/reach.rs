//! How far an encoder can have moved while it was not read.
//!
//! Outputs keep their last values while nothing is written: a drive goes on with its last speed, or
//! with its last force. So the encoder goes on with its last speed and acceleration. They are those
//! of the last [`SPAN`] and the one before, from counts, because single edges dither; and those of
//! the last read where the encoder has just begun to move. The margin is half as much again, and
//! [`STRAY`] for an axis that stood still.

use crate::bus::Instant;

/// Least time between two marks, in nanoseconds.
const SPAN: u64 = 20_000_000;

/// Factor of the margin.
const MARGIN: f64 = 1.5;

/// Counts per second that any encoder can make.
const STRAY: f64 = 1_000.0;

/// Differences of speed that are none: of a count or two in a span, and of the times of reads.
const DITHER: f64 = 150.0;
const JITTER: f64 = 0.01;

/// Counts between two reads that are dither.
const EDGES: f64 = 2.0;

/// Part of the mean speed of a span from which on the speed of the last read is another.
const FASTER: f64 = 1.25;

/// A count and its time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Mark {
    at: Instant,
    count: i64,
}

/// The motion of an encoder in the last spans.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Reach {
    /// The newest first.
    marks: [Mark; 3],
    /// The last count, and the one before.
    last: [Mark; 2],
}

impl Reach {
    /// An encoder that stands at this count.
    pub fn standing(at: Instant, count: i64) -> Self {
        let mark = Mark { at, count };
        Self {
            marks: [mark; 3],
            last: [mark; 2],
        }
    }

    /// Notes the count of a read.
    #[inline]
    pub fn note(&mut self, at: Instant, count: i64) {
        let mark = Mark { at, count };
        let [last, _] = self.last;
        self.last = [mark, last];
        let [newest, before, _] = self.marks;
        if at.as_nanos().saturating_sub(newest.at.as_nanos()) >= SPAN {
            self.marks = [mark, newest, before];
        }
    }

    /// The most counts that it can move within `seconds` after the last read.
    pub fn farthest(&self, seconds: f64) -> f64 {
        let ([_, newer, older], [last, previous]) = (self.marks, self.last);
        let (mean, of_mean) = speed(newer, last);
        let (before, of_before) = speed(older, newer);
        let change = (mean - before).abs();
        let between = 0.5 * (of_mean + of_before);
        let mut acceleration = if change > DITHER + JITTER * mean.abs() && between > 0.0 {
            change / between
        } else {
            0.0
        };
        let mut fastest = mean.abs() + 0.5 * acceleration * of_mean;
        let (now, of_now) = speed(previous, last);
        let now = if of_now > 0.0 {
            now.abs() - EDGES / of_now
        } else {
            0.0
        };
        let moved = (mean * of_mean).abs();
        if now > FASTER * mean.abs() && moved > EDGES {
            // From the speed of before to this one, on the way of the span.
            let squares = now * now - before * before;
            acceleration = acceleration.max(0.5 * squares / moved);
            fastest = fastest.max(now + 0.5 * acceleration * of_now);
        }
        MARGIN * (fastest + 0.5 * acceleration * seconds) * seconds + STRAY * seconds
    }
}

/// The speed between two marks in counts per second, and the time between them in seconds.
fn speed(from: Mark, to: Mark) -> (f64, f64) {
    let time = to.at.since(from.at).as_secs_f64();
    let counts = to.count.wrapping_sub(from.count) as f64;
    (if time > 0.0 { counts / time } else { 0.0 }, time)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reach of an encoder that has run by this motion, in counts at a time in seconds, for
    /// half a second with a read in each millisecond.
    fn reach(motion: impl Fn(f64) -> f64, seconds: f64) -> f64 {
        let at = |ms: u64| Instant::from_nanos(ms * 1_000_000);
        let count = |ms: u64| motion(ms as f64 / 1e3) as i64;
        let mut reach = Reach::standing(at(0), count(0));
        for ms in 1..=500 {
            reach.note(at(ms), count(ms));
        }
        reach.farthest(seconds)
    }

    #[test]
    fn axis_goes_on_with_its_speed_and_acceleration() {
        for way in [1.0, -1.0] {
            for (speed, acceleration) in [(20_000.0, 0.0), (0.0, 100_000.0), (8_000.0, 1e6)] {
                let motion = |t: f64| way * (speed * t + 0.5 * acceleration * t * t);
                for gap in [0.05, 0.3, 1.0, 5.0] {
                    let moved = (motion(0.5 + gap) - motion(0.5)).abs();
                    let far = reach(motion, gap);
                    let told = format!("{speed}, {acceleration}, {gap}: {moved}, {far}");
                    assert!(far >= 1.2 * moved, "{told}");
                    assert!(far <= 1.8 * moved + STRAY * gap + 100.0, "{told}");
                }
            }
        }
    }

    #[test]
    fn axis_that_has_just_begun_to_move_goes_on_faster() {
        for begun in [0.495, 0.490, 0.480, 0.470, 0.440] {
            let motion = |t: f64| 0.5 * 1e7 * (t - begun).max(0.0) * (t - begun).max(0.0);
            for gap in [0.01, 0.05, 0.3] {
                let moved = motion(0.5 + gap) - motion(0.5);
                let far = reach(motion, gap);
                let told = format!("{begun}, {gap}: {moved}, {far}");
                assert!(far >= 1.1 * moved && far <= 3.0 * moved, "{told}");
            }
        }
    }

    #[test]
    fn axis_that_dithers_stays_within_the_stray_counts() {
        let far = reach(|t| ((t * 731.0) as i64 % 3) as f64, 5.0);
        assert!(far < 6.0 * STRAY, "{far}");
    }
}
