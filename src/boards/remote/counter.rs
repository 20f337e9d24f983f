//! The pins of a counter in a remote, such as an MPG.

use core::cmp::Ordering;

use crate::hal::{Counter, PinStore};
use crate::process_data::{CounterExtension, Field};

/// A counter of a remote: its pins as LinuxCNC has them, and the count of 64 bits behind them.
#[derive(Debug)]
pub struct CounterPins {
    pub(super) field: Field,
    /// Upper bits that come first; 0 for a count in one piece.
    pub(super) high_bits: u8,
    pub(super) extension: CounterExtension,
    /// What `count` is 0 at.
    pub(super) zero: i64,
    pub(super) handles: Counter,
}

impl CounterPins {
    pub(super) fn new(field: Field, high_bits: u8, handles: Counter) -> Self {
        Self {
            field,
            high_bits,
            extension: CounterExtension::new(field.bits()),
            zero: 0,
            handles,
        }
    }

    pub(super) fn resynchronise(&mut self) {
        self.extension.resynchronise();
    }

    pub(super) fn take(&mut self, pins: &mut PinStore, words: &[u32]) {
        let before = self.extension.count();
        self.extension.update(self.raw(words));
        let now = self.extension.count();
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

    #[test]
    fn a_revolution_is_passed_in_both_directions() {
        assert_eq!(passed(255, 256, 256), Some(256));
        assert_eq!(passed(250, 260, 256), Some(256));
        assert_eq!(passed(1, -1, 256), Some(0));
        assert_eq!(passed(5, 6, 256), None);
        assert_eq!(passed(5, 600, 0), None);
    }
}
