//! Counters of few bits, continued to 64.

use super::sign_extend;

/// Continues a counter of n bits to 64: it takes the shortest way from one reading to the next, so
/// it is right as long as the counter moves by less than half its range between two readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CounterExtension {
    bits: u8,
    last: Option<u64>,
    count: i64,
}

impl CounterExtension {
    /// For a counter of `bits` (1 to 64) bits, starting at zero wherever the counter stands.
    pub const fn new(bits: u8) -> Self {
        Self {
            bits,
            last: None,
            count: 0,
        }
    }

    /// Takes a reading; what the counter moved by since the last one.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn update(&mut self, raw: u64) -> i64 {
        let moved = self
            .last
            .map_or(0, |last| sign_extend(raw.wrapping_sub(last), self.bits));
        self.last = Some(raw);
        self.count = self.count.wrapping_add(moved);
        moved
    }

    /// The count since the first reading.
    pub fn count(&self) -> i64 {
        self.count
    }

    /// Forgets the last reading: the next one moves nothing.
    ///
    /// For after a gap in which the counter may have moved by any distance, or restarted: the count
    /// goes on from where it was.
    pub fn resynchronise(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_first_reading_is_zero_wherever_the_counter_stands() {
        let mut counter = CounterExtension::new(8);
        assert_eq!(counter.update(200), 0);
        assert_eq!(counter.update(201), 1);
        assert_eq!(counter.count(), 1);
    }

    #[test]
    fn a_gap_moves_nothing() {
        let mut counter = CounterExtension::new(8);
        counter.update(0);
        counter.update(5);
        counter.resynchronise();
        counter.update(100);
        assert_eq!(counter.count(), 5);
    }

    proptest! {
        #[test]
        fn it_follows_any_movement_of_less_than_half_the_range(
            bits in 2..=64u8, steps in prop::collection::vec(any::<i64>(), 0..200),
        ) {
            let mut counter = CounterExtension::new(bits);
            let mut position = 0_i64;
            counter.update(0);
            let mask = u64::MAX >> (64 - u32::from(bits));
            for step in steps {
                let step = sign_extend(step as u64, bits).max(-(i64::MAX >> (64 - bits)));
                position = position.wrapping_add(step);
                prop_assert_eq!(counter.update(position as u64 & mask), step);
                prop_assert_eq!(counter.count(), position);
            }
        }
    }
}
