//! The divider that the master rate sets: the ticks in which the accumulators add.

/// Values of the lower part of the sum; the bit above is its top bit.
const TURN: u64 = 1 << 32;

/// Number of additions that [`Divider::until`] looks ahead.
const LOOK_AHEAD: u64 = 1 << 31;

/// A 33-bit sum of the master rate. FACTS 14.5.
///
/// Each change of the top bit makes the accumulators add two ticks later: at FFFFFFFF in every
/// tick, but for one in 2^32. In a firmware without DPLL FFFFFFFF adds in every tick from the one
/// after its write on. T:sg02, T:sg58.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Divider {
    rate: u32,
    /// True in a firmware without DPLL.
    skips_at_full_rate: bool,
    sum: u64,
    /// The top bit of the sum one tick ago.
    was_high: bool,
    /// True if the accumulators add in the next tick.
    adds: bool,
}

impl Divider {
    /// The divider of a firmware with or without a DPLL.
    pub(super) fn new(has_dpll: bool) -> Self {
        Self {
            skips_at_full_rate: !has_dpll,
            ..Self::default()
        }
    }

    /// The master rate.
    pub(super) fn rate(&self) -> u32 {
        self.rate
    }

    /// Sets the master rate; the sum restarts at 0, which can change its top bit, too.
    pub(super) fn set_rate(&mut self, rate: u32) {
        self.rate = rate;
        self.sum = 0;
    }

    /// True if the accumulators add in the next tick.
    pub(super) fn adds_next(&self) -> bool {
        self.adds || self.is_skipped()
    }

    /// Number of additions in the next `ticks`, which are fewer than 2^31.
    pub(super) fn adds(&self, ticks: u64) -> u64 {
        match ticks {
            _ if self.is_skipped() => ticks,
            0 => 0,
            1 => self.adds.into(),
            _ => u64::from(self.adds) + u64::from(self.changes()) + self.carries(ticks - 2),
        }
    }

    /// Ticks up to the one that makes the `count`th addition from now on. `u64::MAX` if there is
    /// none; not more than the real number for an addition that is far away.
    pub(super) fn until(&self, count: u64) -> u64 {
        if self.is_skipped() {
            return count;
        }
        let pending = u64::from(self.adds) + u64::from(self.changes());
        let Some(count) = count.checked_sub(pending).filter(|&count| count > 0) else {
            return if self.adds && count == 1 { 1 } else { 2 };
        };
        if self.rate == 0 {
            return u64::MAX;
        }
        let missing = count.min(LOOK_AHEAD) * TURN - self.sum % TURN;
        missing.div_ceil(self.rate.into()) + 2
    }

    /// Lets `ticks` pass, fewer than 2^31.
    pub(super) fn advance(&mut self, ticks: u64) {
        let Some(before) = ticks.checked_sub(1) else {
            return;
        };
        self.adds = match before.checked_sub(1) {
            None => self.changes(),
            Some(earlier) => self.carries(before) != self.carries(earlier),
        };
        self.was_high = is_high(self.sum_after(before));
        self.sum = self.sum_after(ticks);
    }

    /// True if the accumulators add in every tick, whatever the sum is.
    fn is_skipped(&self) -> bool {
        self.skips_at_full_rate && self.rate == u32::MAX
    }

    /// True if the top bit has changed in the last tick.
    fn changes(&self) -> bool {
        is_high(self.sum) != self.was_high
    }

    /// Number of changes of the top bit in the next `ticks`.
    fn carries(&self, ticks: u64) -> u64 {
        (self.sum % TURN + u64::from(self.rate) * ticks) / TURN
    }

    fn sum_after(&self, ticks: u64) -> u64 {
        (self.sum + u64::from(self.rate) * ticks) % (2 * TURN)
    }
}

fn is_high(sum: u64) -> bool {
    sum & TURN != 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn skipped_ticks_give_the_same_additions_as_single_ticks(
            rates in proptest::collection::vec((any::<u32>(), 0_u32..5, 0_u64..60), 1..5),
            has_dpll: bool,
        ) {
            let mut divider = Divider::new(has_dpll);
            for (rate, shift, ticks) in rates {
                // The last one is FFFFFFFF.
                divider.set_rate(rate | u32::MAX.checked_shl(32 - 8 * shift).unwrap_or(0));
                let (mut single, mut adds) = (divider, 0);
                for tick in 1..=ticks {
                    if single.adds_next() {
                        adds += 1;
                        prop_assert_eq!(divider.until(adds), tick);
                    }
                    single.advance(1);
                    prop_assert_eq!(divider.adds(tick), adds);
                }
                prop_assert!(divider.until(adds + 1) > ticks);
                divider.advance(ticks);
                prop_assert_eq!(
                    (divider.sum, divider.was_high, divider.adds),
                    (single.sum, single.was_high, single.adds)
                );
            }
        }
    }
}
