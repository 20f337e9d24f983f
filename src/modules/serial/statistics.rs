//! Port statistics.

use crate::tally::Tally;
use core::time::Duration;

/// Statistics of a port since the driver was built.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PortStatistics {
    /// Complete transfers, of all channels together.
    pub transfers: u64,
    /// Reads that found an incomplete transfer: the period is too short.
    pub too_short: u64,
    /// Transfers that may or may not have happened, because the bus lost a write.
    pub unknown: u64,
    /// Number of times that COMMAND never became 0 and had to be freed.
    pub stuck: u64,
    /// Attempts to restart channels.
    pub starts: u64,
    /// Durations of transfers, where
    /// [`Driver::wait_transfers`](crate::driver::Driver::wait_transfers) waited for their end.
    pub doit: TimeHistogram,
}

/// Number of buckets of one microsecond.
const BUCKETS: usize = 512;

/// Histogram of times, in microseconds.
#[derive(Clone, Debug)]
pub struct TimeHistogram {
    buckets: [u32; BUCKETS],
    count: u64,
    /// The shortest and the longest.
    range: Option<(Duration, Duration)>,
}

impl Default for TimeHistogram {
    fn default() -> Self {
        Self {
            buckets: [0; BUCKETS],
            count: 0,
            range: None,
        }
    }
}

impl TimeHistogram {
    /// Counts one time.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn record(&mut self, time: Duration) {
        self.count.tally(1);
        let (min, max) = self.range.unwrap_or((time, time));
        self.range = Some((min.min(time), max.max(time)));
        let micros = usize::try_from(time.as_micros()).unwrap_or(usize::MAX);
        if let Some(bucket) = self.buckets.get_mut(micros) {
            *bucket = bucket.saturating_add(1);
        }
    }

    /// Number of recorded times.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The shortest and the longest time; `None` if none was recorded.
    pub const fn range(&self) -> Option<(Duration, Duration)> {
        self.range
    }

    /// The time that `percent` of the recorded times did not exceed, to the microsecond; above half
    /// a millisecond, the longest time.
    pub fn percentile(&self, percent: u8) -> Option<Duration> {
        let (min, max) = self.range?;
        let of_hundred = self.count.saturating_mul(percent.min(100).into());
        let wanted = of_hundred.div_ceil(100).max(1);
        let mut seen = 0_u64;
        let bucket = self.buckets.iter().position(|&count| {
            seen.tally(count.into());
            seen >= wanted
        });
        let time = bucket.map_or(max, |micros| Duration::from_micros(micros as u64));
        // A bucket begins at a whole microsecond, which may be below the shortest time.
        Some(time.clamp(min, max))
    }
}

/// The count, and times in seconds, `null` where none was recorded.
#[cfg(feature = "serde")]
impl serde::Serialize for TimeHistogram {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let seconds = |time: Option<Duration>| time.map(|time| time.as_secs_f64());
        let range = self.range;
        let mut fields = serializer.serialize_struct("TimeHistogram", 5)?;
        fields.serialize_field("count", &self.count)?;
        fields.serialize_field("shortest", &seconds(range.map(|(min, _)| min)))?;
        fields.serialize_field("median", &seconds(self.percentile(50)))?;
        fields.serialize_field("percentile_99", &seconds(self.percentile(99)))?;
        fields.serialize_field("longest", &seconds(range.map(|(_, max)| max)))?;
        fields.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_times() {
        let mut times = TimeHistogram::default();
        assert_eq!((times.percentile(50), times.range()), (None, None));
        for micros in 1..=99 {
            times.record(Duration::from_micros(micros));
        }
        times.record(Duration::from_millis(9));
        assert_eq!(times.percentile(50), Some(Duration::from_micros(50)));
        assert_eq!(times.percentile(99), Some(Duration::from_micros(99)));
        assert_eq!(times.percentile(100), Some(Duration::from_millis(9)));
        let range = (Duration::from_micros(1), Duration::from_millis(9));
        assert_eq!(times.range(), Some(range));
        assert_eq!(times.count(), 100);
    }

    #[test]
    fn percentile_is_never_shorter_than_the_shortest() {
        let mut times = TimeHistogram::default();
        times.record(Duration::from_nanos(71_600));
        times.record(Duration::from_nanos(71_900));
        let shortest = Some(Duration::from_nanos(71_600));
        assert_eq!(times.percentile(50), shortest);
        assert_eq!(times.percentile(100), shortest);
    }
}
