//! Histogram of times.

use alloc::boxed::Box;
use core::time::Duration;

use crate::tally::Tally;

/// Buckets of each doubling of the time: a bucket is 1/32 of its times wide, about 3 %.
const STEPS: usize = 1 << STEP_BITS;
const STEP_BITS: u32 = 5;
/// Doublings after the first [`STEPS`] nanoseconds: times up to 2^38 ns, 275 s, are distinguished.
const DOUBLINGS: usize = 33;
const BUCKETS: usize = STEPS * (DOUBLINGS + 1);

/// Histogram of times from 1 ns to 4 minutes, in buckets that are about 3 % wide.
///
/// The shortest and the longest time are exact.
#[derive(Clone, Debug)]
pub struct Histogram {
    buckets: Box<[u64; BUCKETS]>,
    count: u64,
    sum: Duration,
    range: Option<(Duration, Duration)>,
}

/// Summary of a histogram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Distribution {
    /// Number of times recorded; if zero, all other fields are zero.
    pub count: u64,
    /// The shortest time.
    pub min: Duration,
    /// The median: half of the times did not exceed it.
    pub median: Duration,
    /// Limit that 99 of 100 times did not exceed.
    pub p99: Duration,
    /// Limit that 9,999 of 10,000 times did not exceed.
    pub p99_99: Duration,
    /// The longest time.
    pub max: Duration,
    /// The mean.
    pub mean: Duration,
}

impl Histogram {
    /// An empty histogram. The only function that allocates.
    pub fn new() -> Self {
        Self {
            buckets: Box::new([0; BUCKETS]),
            count: 0,
            sum: Duration::ZERO,
            range: None,
        }
    }

    /// Records one time.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn record(&mut self, time: Duration) {
        self.count.tally(1);
        self.sum = self.sum.saturating_add(time);
        let (min, max) = self.range.unwrap_or((time, time));
        self.range = Some((min.min(time), max.max(time)));
        let bucket = self.buckets.get_mut(bucket_of(time));
        debug_assert!(bucket.is_some(), "no bucket for {time:?}");
        if let Some(bucket) = bucket {
            bucket.tally(1);
        }
    }

    /// Number of times recorded.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The longest time; zero if none was recorded.
    pub fn max(&self) -> Duration {
        self.range.map_or(Duration::ZERO, |(_, max)| max)
    }

    /// The limit that `share` of the times, 0.0 to 1.0, did not exceed: at most 3 % too high, never
    /// above the longest time.
    pub fn quantile(&self, share: f64) -> Option<Duration> {
        let (min, max) = self.range?;
        let wanted = libm::ceil(self.count as f64 * share.clamp(0.0, 1.0)) as u64;
        let mut seen = 0;
        let bucket = self.buckets.iter().position(|&count| {
            seen.tally(count);
            seen >= wanted.max(1)
        });
        Some(bucket.map_or(max, |bucket| edge(bucket.saturating_add(1)).clamp(min, max)))
    }

    /// Summary of all times.
    pub fn distribution(&self) -> Distribution {
        let Some((min, max)) = self.range else {
            return Distribution::default();
        };
        let quantile = |share| self.quantile(share).unwrap_or(max);
        let mean = self
            .sum
            .as_nanos()
            .checked_div(self.count.into())
            .unwrap_or(0);
        Distribution {
            count: self.count,
            min,
            median: quantile(0.5),
            p99: quantile(0.99),
            p99_99: quantile(0.9999),
            max,
            mean: Duration::from_nanos(mean as u64),
        }
    }

    /// Number of times longer than `time`. The bucket of `time` is included if any of its times can
    /// be longer: the result is never too low, and a time counted in excess is less than 3 %
    /// shorter.
    pub fn longer_than(&self, time: Duration) -> u64 {
        if self.max() <= time {
            return 0;
        }
        let bucket = bucket_of(time);
        let next = bucket.saturating_add(1);
        let first = if edge(next) > time.saturating_add(Duration::from_nanos(1)) {
            bucket
        } else {
            next
        };
        self.buckets.iter().skip(first).sum()
    }

    /// Number of times from each of these edges up to the next, and from the last on; times before
    /// the first edge are included in the first number. Exact to the width of a bucket.
    pub fn between(&self, edges: &[Duration]) -> impl Iterator<Item = u64> {
        let ends = edges.iter().skip(1).map(|edge| bucket_of(*edge));
        let mut begin = 0;
        ends.chain([BUCKETS]).map(move |end| {
            let counts = self.buckets.get(begin..end).unwrap_or(&[]);
            begin = end;
            counts.iter().sum()
        })
    }
}

impl Default for Histogram {
    fn default() -> Self {
        Self::new()
    }
}

/// The first [`STEPS`] buckets are a nanosecond wide; then each doubling has the same number.
fn bucket_of(time: Duration) -> usize {
    let nanos = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
    let doublings = nanos.checked_ilog2().unwrap_or(0).saturating_sub(STEP_BITS);
    let step = (nanos >> doublings) as usize;
    let bucket = match doublings {
        0 => step,
        _ => (doublings as usize).wrapping_mul(STEPS).wrapping_add(step),
    };
    bucket.min(BUCKETS - 1)
}

/// The lower edge of a bucket.
fn edge(bucket: usize) -> Duration {
    let doublings = (bucket / STEPS).saturating_sub(1);
    let step = bucket.wrapping_sub(doublings.wrapping_mul(STEPS));
    Duration::from_nanos((step as u64) << doublings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn nanos(nanos: u64) -> Duration {
        Duration::from_nanos(nanos)
    }

    fn of(times: impl IntoIterator<Item = Duration>) -> Histogram {
        let mut histogram = Histogram::new();
        times.into_iter().for_each(|time| histogram.record(time));
        histogram
    }

    #[test]
    fn empty_histogram_has_no_quantile_and_zero_counts() {
        let empty = Histogram::new();
        assert_eq!(empty.quantile(0.5), None);
        assert_eq!(empty.distribution(), Distribution::default());
        assert_eq!(empty.longer_than(Duration::ZERO), 0);
        assert_eq!(
            empty.between(&[nanos(1), nanos(9)]).collect::<Vec<_>>(),
            [0, 0]
        );
    }

    #[test]
    fn million_times_have_their_percentiles() {
        let all = of((1..=1_000_000).map(nanos)).distribution();
        assert_eq!(
            (all.count, all.min, all.max),
            (1_000_000, nanos(1), nanos(1_000_000))
        );
        assert_eq!(all.mean, nanos(500_000));
        for (is, wanted) in [
            (all.median, 500_000),
            (all.p99, 990_000),
            (all.p99_99, 999_900),
        ] {
            let most = nanos(wanted + wanted / 32 + 1);
            assert!(
                (nanos(wanted)..=most).contains(&is),
                "{is:?} for {wanted} ns"
            );
        }
    }

    #[test]
    fn one_of_ten_thousand_is_what_the_last_percentile_leaves_out() {
        let mut histogram = of((0..9_999).map(|_| nanos(1000)));
        histogram.record(nanos(90_000));
        let all = histogram.distribution();
        assert!(all.p99_99 < nanos(1100), "{all:?}");
        assert_eq!(all.max, nanos(90_000));
        histogram.record(nanos(80_000));
        assert!(histogram.distribution().p99_99 >= nanos(80_000));
        assert_eq!(histogram.longer_than(nanos(50_000)), 2);
        assert_eq!(histogram.longer_than(nanos(89_999)), 1);
        assert_eq!(histogram.longer_than(nanos(90_000)), 0);
    }

    #[test]
    fn each_is_counted_between_its_edges() {
        let edges = [0, 1_000, 2_000, 5_000].map(nanos);
        let times = [0, 990, 1_100, 1_900, 4_000, 9_000, 60_000_000].map(nanos);
        assert_eq!(of(times).between(&edges).collect::<Vec<_>>(), [2, 2, 1, 2]);
        assert_eq!(
            of(times).between(&edges[1..]).collect::<Vec<_>>(),
            [4, 1, 2]
        );
    }

    proptest! {
        #[test]
        fn every_time_is_in_a_bucket_that_is_no_wider_than_3_percent(time: u64) {
            let bucket = bucket_of(nanos(time));
            prop_assert!(bucket < BUCKETS);
            prop_assert!(edge(bucket) <= nanos(time));
            if bucket + 1 < BUCKETS {
                prop_assert!(nanos(time) < edge(bucket + 1));
                let width = edge(bucket + 1).saturating_sub(edge(bucket));
                prop_assert!(width <= nanos(time / 32 + 1));
            }
        }
    }
}
