//! Pins of a counter in a remote, such as an MPG: a few bits, extended to 64.

use core::cmp::Ordering;

use super::field::Field;
use super::scaling::{mask, sign_extend};
use crate::hal::{Counter, PinStore};

/// A counter of a remote: its bits, and the 64-bit count behind its pins.
///
/// The count follows the shortest way from one reading to the next, so it is correct as long as the
/// counter moves by less than half its range between two readings. It starts at zero, whatever the
/// first reading is.
#[derive(Debug)]
pub(super) struct CounterPins {
    pub field: Field,
    /// Number of upper bits if these come first; 0 for a count in one piece.
    pub high_bits: u8,
    pub handles: Counter,
    /// The last reading.
    pub last: Option<u64>,
    /// Counts since the first reading.
    pub now: i64,
    /// The count at which the `count` pin is 0.
    pub zero: i64,
}

impl CounterPins {
    /// Forgets the last reading: the next one moves nothing, and the count continues from its
    /// present value. For use after a gap in which the counter may have moved by any distance, or
    /// restarted.
    pub fn resynchronise(&mut self) {
        self.last = None;
    }

    pub fn take(&mut self, pins: &mut PinStore, words: &[u32]) {
        let (raw, before) = (self.raw(words), self.now);
        if let Some(last) = self.last.replace(raw) {
            let moved = sign_extend(raw.wrapping_sub(last), self.field.bits);
            self.now = before.wrapping_add(moved);
        }
        let now = self.now;
        let handles = self.handles;
        if pins.read(handles.index_enable).value {
            let revolution = handles
                .counts_per_rev
                .map_or(0, |param| i64::from(pins.param(param)));
            if let Some(index) = passed(before, now, revolution) {
                self.zero = index;
                pins.publish(handles.index_enable, false);
            }
        }
        if pins.commanded(handles.reset) {
            self.zero = now;
        }
        let count = now.wrapping_sub(self.zero);
        let scale = pins.param(handles.scale);
        pins.publish(handles.rawcounts, now as i32);
        pins.publish(handles.count, count as i32);
        pins.publish(handles.position, count as f64 / scale);
    }

    fn raw(&self, words: &[u32]) -> u64 {
        let bits = self.field.get(words);
        if self.high_bits == 0 {
            return bits;
        }
        let low_bits = self.field.bits.saturating_sub(self.high_bits);
        let high = bits & mask(self.high_bits);
        high << low_bits | bits >> self.high_bits
    }
}

/// The multiple of a revolution that was passed between two counts, the later one included.
fn passed(before: i64, now: i64, revolution: i64) -> Option<i64> {
    if revolution <= 0 {
        return None;
    }
    let (from, to) = (before.div_euclid(revolution), now.div_euclid(revolution));
    match to.cmp(&from) {
        Ordering::Greater => Some(to.wrapping_mul(revolution)),
        Ordering::Less => Some(to.wrapping_add(1).wrapping_mul(revolution)),
        Ordering::Equal => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn revolution_is_passed_in_both_directions() {
        assert_eq!(passed(255, 256, 256), Some(256));
        assert_eq!(passed(250, 260, 256), Some(256));
        assert_eq!(passed(1, -1, 256), Some(0));
        assert_eq!(passed(5, 6, 256), None);
        assert_eq!(passed(5, 600, 0), None);
    }

    /// A counter of `bits` bits, as a function from each reading to the count after it.
    fn counter(bits: u8) -> impl FnMut(Option<u64>) -> i64 {
        let mut pins = PinStore::default();
        let mut counter = CounterPins {
            field: Field::new(Some(0), bits.into()).unwrap(),
            high_bits: 0,
            handles: Counter::default(),
            last: None,
            now: 0,
            zero: 0,
        };
        move |reading| {
            match reading {
                Some(raw) => counter.take(&mut pins, &[raw as u32, (raw >> 32) as u32]),
                None => counter.resynchronise(),
            }
            counter.now
        }
    }

    #[test]
    fn first_reading_is_zero_wherever_the_counter_stands() {
        let mut counts = counter(8);
        assert_eq!(counts(Some(200)), 0);
        assert_eq!(counts(Some(201)), 1);
    }

    #[test]
    fn gap_moves_nothing() {
        let mut counts = counter(8);
        counts(Some(0));
        counts(Some(5));
        counts(None);
        assert_eq!(counts(Some(100)), 5);
        assert_eq!(counts(Some(101)), 6);
    }

    proptest! {
        #[test]
        fn counter_follows_movements_below_half_the_range(
            bits in 2..=64u8, steps in prop::collection::vec(any::<i64>(), 0..200),
        ) {
            let mut counts = counter(bits);
            let mut position = 0_i64;
            counts(Some(0));
            let mask = u64::MAX >> (64 - u32::from(bits));
            for step in steps {
                let step = sign_extend(step as u64, bits).max(-(i64::MAX >> (64 - bits)));
                position = position.wrapping_add(step);
                prop_assert_eq!(counts(Some(position as u64 & mask)), position);
            }
        }
    }
}
