//! Counters of few bits, continued to 64, and the pins of a counter in a remote, such as an MPG.

use core::cmp::Ordering;

use super::Field;
use super::scaling::sign_extend;
use crate::hal::{Counter, PinStore};

/// Continues a counter of n bits to 64: it takes the shortest way from one reading to the next, so
/// it is right as long as the counter moves by less than half its range between two readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct CounterExtension {
    bits: u8,
    last: Option<u64>,
    count: i64,
}

impl CounterExtension {
    /// For a counter of `bits` (1 to 64) bits, starting at zero wherever the counter stands.
    const fn new(bits: u8) -> Self {
        Self {
            bits,
            last: None,
            count: 0,
        }
    }

    /// Takes a reading; returns the count since the first one.
    fn update(&mut self, raw: u64) -> i64 {
        let moved = self
            .last
            .map_or(0, |last| sign_extend(raw.wrapping_sub(last), self.bits));
        self.last = Some(raw);
        self.count = self.count.wrapping_add(moved);
        self.count
    }

    /// Forgets the last reading: the next one moves nothing, and the count goes on from where it
    /// was. For after a gap in which the counter may have moved by any distance, or restarted.
    fn resynchronise(&mut self) {
        self.last = None;
    }
}

/// A counter of a remote: its bits, and the count of 64 bits behind its pins.
#[derive(Debug)]
pub(super) struct CounterPins {
    field: Field,
    /// Upper bits that come first; 0 for a count in one piece.
    high_bits: u8,
    extension: CounterExtension,
    /// What `count` is 0 at.
    zero: i64,
    handles: Counter,
}

impl CounterPins {
    pub fn new(field: Field, high_bits: u8, handles: Counter) -> Self {
        Self {
            field,
            high_bits,
            extension: CounterExtension::new(field.bits()),
            zero: 0,
            handles,
        }
    }

    pub fn resynchronise(&mut self) {
        self.extension.resynchronise();
    }

    pub fn take(&mut self, pins: &mut PinStore, words: &[u32]) {
        let before = self.extension.count;
        let now = self.extension.update(self.raw(words));
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
        // As in LinuxCNC, a scale of 0 would make no position at all, and counts as 1.
        let scale = pins.param(handles.scale);
        let scale = if scale == 0.0 { 1.0 } else { scale };
        pins.publish(handles.rawcounts, now as i32);
        pins.publish(handles.count, count as i32);
        pins.publish(handles.position, count as f64 / scale);
    }

    fn raw(&self, words: &[u32]) -> u64 {
        let bits = self.field.get(words);
        if self.high_bits == 0 {
            return bits;
        }
        let low_bits = self.field.bits() - self.high_bits;
        let high = bits & (u64::MAX >> (64 - u32::from(self.high_bits)));
        high << low_bits | bits >> self.high_bits
    }
}
/// The multiple of a revolution between two counts, the later one included.
fn passed(before: i64, now: i64, revolution: i64) -> Option<i64> {
    if revolution <= 0 {
        return None;
    }
    let (from, to) = (before.div_euclid(revolution), now.div_euclid(revolution));
    match to.cmp(&from) {
        Ordering::Greater => Some(to.wrapping_mul(revolution)),
        Ordering::Less => Some((to + 1).wrapping_mul(revolution)),
        Ordering::Equal => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_revolution_is_passed_in_both_directions() {
        assert_eq!(passed(255, 256, 256), Some(256));
        assert_eq!(passed(250, 260, 256), Some(256));
        assert_eq!(passed(1, -1, 256), Some(0));
        assert_eq!(passed(5, 6, 256), None);
        assert_eq!(passed(5, 600, 0), None);
    }

    #[test]
    fn the_first_reading_is_zero_wherever_the_counter_stands() {
        let mut counter = CounterExtension::new(8);
        assert_eq!(counter.update(200), 0);
        assert_eq!(counter.update(201), 1);
    }

    #[test]
    fn a_gap_moves_nothing() {
        let mut counter = CounterExtension::new(8);
        counter.update(0);
        counter.update(5);
        counter.resynchronise();
        assert_eq!(counter.update(100), 5);
        assert_eq!(counter.update(101), 6);
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
                prop_assert_eq!(counter.update(position as u64 & mask), position);
            }
        }
    }
}
