//! A phase accumulator: divides a clock by any fraction.

/// A divider that adds its rate to 16 bits at each clock, and ticks when they overflow. Times are
/// in clocks.
///
/// Ticks are not stepped but computed from the time of the last change of the rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Divider {
    segment: Segment,
    /// The next rate, and the clock from which it applies.
    next: Option<(u64, u32)>,
}

/// A span of time with a constant rate.
#[derive(Clone, Copy, Debug)]
struct Segment {
    from: u64,
    ticks: u64,
    phase: u32,
    rate: u32,
}

impl Segment {
    /// The accumulated sum, in 65536ths of a tick.
    fn total(self, clock: u64) -> u64 {
        u64::from(self.phase) + clock.saturating_sub(self.from) * u64::from(self.rate)
    }

    fn followed_by(self, from: u64, rate: u32) -> Self {
        let total = self.total(from);
        Self {
            from,
            ticks: self.ticks + (total >> 16),
            phase: (total & 0xFFFF) as u32,
            rate,
        }
    }

    fn reaches(self, ticks: u64) -> Option<u64> {
        let Some(missing) = ticks.checked_sub(self.ticks).filter(|&ticks| ticks > 0) else {
            return Some(self.from);
        };
        let missing = (missing << 16) - u64::from(self.phase);
        (self.rate > 0).then(|| self.from + missing.div_ceil(u64::from(self.rate)))
    }
}

impl Divider {
    /// A stopped divider, from a clock on.
    pub(super) const fn new(from: u64) -> Self {
        let segment = Segment {
            from,
            ticks: 0,
            phase: 0,
            rate: 0,
        };
        Self {
            segment,
            next: None,
        }
    }

    /// The rate that was last written.
    pub(super) fn rate(&self) -> u32 {
        self.next.map_or(self.segment.rate, |(_, rate)| rate)
    }

    /// Writes a rate at `now` that is added from `from` on; clocks before `now` cannot be queried
    /// any more.
    pub(super) fn set_rate(&mut self, now: u64, from: u64, rate: u32) {
        if let Some((since, rate)) = self.next.filter(|&(since, _)| since <= now) {
            self.segment = self.segment.followed_by(since, rate);
        }
        self.next = Some((from, rate));
    }

    /// Ticks up to a clock.
    pub(super) fn ticks(&self, clock: u64) -> u64 {
        let segment = self.segment_at(clock);
        segment.ticks + (segment.total(clock) >> 16)
    }

    /// The clock of this many ticks; `None` if the divider stands still.
    pub(super) fn reaches(&self, ticks: u64) -> Option<u64> {
        let end = self.next.map_or(u64::MAX, |(from, _)| from);
        let reached = self.segment.reaches(ticks).filter(|&clock| clock <= end);
        let (from, rate) = self.next.unwrap_or((end, 0));
        reached.or_else(|| self.segment.followed_by(from, rate).reaches(ticks))
    }

    fn segment_at(&self, clock: u64) -> Segment {
        match self.next {
            Some((from, rate)) if from <= clock => self.segment.followed_by(from, rate),
            _ => self.segment,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn computed_ticks_match_adding_up_clock_by_clock(
            rates in proptest::collection::vec((0u32..0x1_0000, 1u64..400), 1..6),
        ) {
            let mut divider = Divider::new(0);
            let (mut now, mut phase, mut ticks, mut rate) = (0, 0, 0, 0);
            for (next, clocks) in rates {
                divider.set_rate(now, now + 4, next);
                for step in 1..=clocks.max(5) {
                    if step == 5 {
                        rate = next;
                    }
                    now += 1;
                    phase += rate;
                    let tick = phase >> 16;
                    phase &= 0xFFFF;
                    ticks += u64::from(tick);
                    prop_assert_eq!(divider.ticks(now), ticks);
                    if tick == 1 {
                        prop_assert_eq!(divider.reaches(ticks), Some(now));
                    }
                }
            }
        }
    }
}
