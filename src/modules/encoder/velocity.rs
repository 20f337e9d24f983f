//! Velocity from time stamps.

/// Estimates velocity from the times of count changes, for speeds far below one count per cycle.
///
/// - While counts arrive, velocity is the number of counts divided by the time between changes.
/// - While none arrive, velocity is at most one count divided by the time since the last change, so
///   that it decays towards zero as a stopping axis does; after the idle time it is zero.
/// - The first counts after a standstill give no more than is certain: the first of them only marks
///   the start, because the beginning of the movement is not known.
/// - A single count back is a dithering edge, or a turn: velocity is zero there.
///
/// # Real time
/// Constant time, no allocation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VelocityEstimator {
    /// In counts/s.
    pub velocity: f64,
    /// Time of the last change in ticks; `None` after a standstill long enough that time alone
    /// changes nothing.
    pub last_change: Option<u64>,
}

/// The counts of a cycle. Times are in ticks.
#[derive(Clone, Copy, Debug)]
pub struct CountStep {
    /// Counts since the previous cycle.
    pub counts: i64,
    /// Time of the last of these counts; ignored if there are none.
    pub changed_at: u64,
    /// Time of the previous cycle.
    pub from: u64,
    /// Time of this cycle.
    pub to: u64,
}

impl VelocityEstimator {
    /// Takes the counts of a cycle into account. `hz`: ticks per second. `idle_time`: in seconds.
    pub fn update(&mut self, step: CountStep, hz: f64, idle_time: f64) {
        let (change, changed_at) = (step.counts, step.changed_at);
        let seconds = |from: u64, to: u64| to.saturating_sub(from) as f64 / hz;
        if change != 0 {
            // Without a known last change, all of them arrived after the previous call.
            let first = if self.last_change.is_some() {
                0
            } else {
                change.signum()
            };
            let elapsed = seconds(self.last_change.unwrap_or(step.from), changed_at);
            self.moved(change, change.saturating_sub(first) as f64, elapsed);
            self.last_change = Some(changed_at);
        } else if let Some(last) = self.last_change {
            let elapsed = seconds(last, step.to);
            if elapsed >= idle_time {
                *self = Self::default();
            } else if elapsed > 0.0 {
                let bound = 1.0 / elapsed;
                self.velocity = self.velocity.clamp(-bound, bound);
            }
        }
    }

    /// Counts that the encoder has gone since its last change, at the present velocity: less than
    /// one, which would have been counted. `now` in ticks, `hz` ticks per second.
    pub fn ahead(&self, now: u64, hz: f64) -> f64 {
        let Some(last) = self.last_change else {
            return 0.0;
        };
        let elapsed = now.saturating_sub(last) as f64 / hz;
        (self.velocity * elapsed).clamp(-1.0, 1.0)
    }

    fn moved(&mut self, change: i64, counts: f64, elapsed: f64) {
        let turned = self.velocity * counts < 0.0;
        if turned && change.unsigned_abs() == 1 {
            self.velocity = 0.0;
        } else if elapsed > 0.0 {
            self.velocity = counts / elapsed;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 1e6;

    fn step(v: &mut VelocityEstimator, change: i64, at: u64, now: u64) -> f64 {
        let step = CountStep {
            counts: change,
            changed_at: at,
            from: now.saturating_sub(1_000),
            to: now,
        };
        v.update(step, HZ, 0.5);
        v.velocity
    }

    #[test]
    fn velocity_is_counts_by_time_between_changes() {
        let mut v = VelocityEstimator::default();
        assert!(step(&mut v, 1, 900, 1_000).abs() < 1e-9);
        assert!((step(&mut v, 1, 10_900, 11_000) - 100.0).abs() < 1e-9);
        assert!((step(&mut v, -3, 40_900, 41_000) + 100.0).abs() < 1e-9);
    }

    #[test]
    fn velocity_without_counts_is_at_most_one_count_per_time_passed() {
        let mut v = VelocityEstimator::default();
        step(&mut v, 1, 0, 0);
        step(&mut v, 10, 1_000, 1_000);
        let mut last = v.velocity;
        assert!((last - 10_000.0).abs() < 1e-9);
        for now in (2_000..501_000).step_by(1_000) {
            let velocity = step(&mut v, 0, 0, now);
            let bound = HZ / (now - 1_000) as f64;
            assert!(velocity <= bound + 1e-9 && velocity <= last && velocity > 0.0);
            last = velocity;
        }
        assert!(step(&mut v, 0, 0, 501_000).abs() < f64::EPSILON);
    }

    #[test]
    fn edge_that_dithers_has_no_velocity() {
        let mut v = VelocityEstimator::default();
        step(&mut v, 1, 100, 1_000);
        step(&mut v, 1, 1_100, 2_000);
        assert!((v.velocity - 1_000.0).abs() < 1e-9);
        assert!(step(&mut v, -1, 2_100, 3_000).abs() < f64::EPSILON);
    }
}
