//! Limits the cost of restart attempts for the other remotes of a port.

use core::time::Duration;

use crate::bus::Instant;
use crate::settings::FaultPolicy;

/// Time that attempts have taken from the other remotes of a port, and its limit.
///
/// An attempt that takes [`USUAL`](Self::USUAL) is paid off after the longest pause of the policy;
/// while more than [`CREDIT`](Self::CREDIT) is owed, no further attempt begins. With the default
/// policy, attempts therefore take at most 320 ms of any minute, whatever the number of failing
/// remotes and the kind of their faults.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    /// In this time an attempt of the usual duration is paid off.
    longest_backoff: Duration,
    owed: Duration,
    at: Instant,
    began: Option<Instant>,
}

impl Cost {
    /// Duration of an attempt at a remote that does not answer, in a cycle of 1 ms (FACTS 5.7).
    const USUAL: Duration = Duration::from_millis(20);
    const CREDIT: Duration = Duration::from_millis(60);
    /// Upper limit for a single attempt, since an interrupted attempt has no end.
    const LONGEST: Duration = Duration::from_millis(60);

    /// Nothing is owed.
    pub fn new(policy: &FaultPolicy) -> Self {
        Self {
            longest_backoff: policy.longest_backoff,
            owed: Duration::ZERO,
            at: Instant::default(),
            began: None,
        }
    }

    /// Forgets what is owed, and an attempt that was begun.
    pub const fn forget(&mut self) {
        (self.owed, self.began) = (Duration::ZERO, None);
    }

    /// True if another attempt may begin.
    pub fn allows(&self, now: Instant) -> bool {
        self.owed_at(now) <= Self::CREDIT
    }

    pub fn begin(&mut self, now: Instant) {
        self.began.get_or_insert(now);
    }

    /// Ends the attempt, when the port can transfer again.
    pub fn end(&mut self, now: Instant) {
        if let Some(began) = self.began.take() {
            let took = now.since(began).min(Self::LONGEST);
            self.owed = self.owed_at(now).saturating_add(took);
            self.at = now;
        }
    }

    fn owed_at(&self, now: Instant) -> Duration {
        let usual = Self::USUAL.as_nanos();
        let longest = self.longest_backoff.as_nanos();
        let paid = now.since(self.at).as_nanos().saturating_mul(usual);
        let paid = paid.checked_div(longest).unwrap_or(u128::MAX);
        let paid = u64::try_from(paid).unwrap_or(u64::MAX);
        self.owed.saturating_sub(Duration::from_nanos(paid))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attempts_take_less_than_six_thousandths_of_any_minute() {
        let mut cost = Cost::new(&FaultPolicy::default());
        let mut taken = Vec::new();
        let mut now = 0;
        while now < 300_000 {
            let at = |ms: u64| Instant::from_nanos(ms * 1_000_000);
            if cost.allows(at(now)) {
                cost.begin(at(now));
                cost.end(at(now + 20));
                taken.push(now);
                now += 19;
            }
            now += 1;
        }
        for &from in &taken {
            let attempts = taken
                .iter()
                .filter(|&&t| (from..from + 60_000).contains(&t));
            assert!(attempts.count() * 20 < 360, "from {from} ms: {taken:?}");
        }
        assert!(taken.windows(2).all(|two| two[1] - two[0] <= 5_020));
    }

    #[test]
    fn unlimited_backoff_is_a_pause_like_any_other() {
        let policy = FaultPolicy {
            longest_backoff: Duration::MAX,
            ..FaultPolicy::default()
        };
        let mut cost = Cost::new(&policy);
        for ms in [0, 100] {
            cost.begin(Instant::from_nanos(ms * 1_000_000));
            cost.end(Instant::from_nanos((ms + 50) * 1_000_000));
        }
        assert!(!cost.allows(Instant::from_nanos(u64::MAX)));
    }
}
