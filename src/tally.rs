//! Counters that stop at their greatest value.

/// A counter of events. It saturates: a number that a person compares with an earlier one never
/// restarts at 0.
pub(crate) trait Tally {
    /// Counts `more` events.
    fn tally(&mut self, more: Self);
}

macro_rules! tally {
    ($($type:ty),*) => {
        $(impl Tally for $type {
            #[inline]
            fn tally(&mut self, more: Self) {
                *self = self.saturating_add(more);
            }
        })*
    };
}

tally!(u16, u32, u64, usize, i64);

#[cfg(test)]
mod tests {
    use super::Tally;

    #[test]
    fn counter_stops_at_its_greatest_value() {
        let mut count = u32::MAX - 1;
        count.tally(1);
        assert_eq!(count, u32::MAX);
        count.tally(1);
        assert_eq!(count, u32::MAX);
    }
}
