//! Inputs that are published together.

use super::handle::Key;
use super::{AnyValue, PinId, PinStore, Rejection};

/// Inputs that were made one after the other: they are published with one look at their place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InputRow<const N: usize>(Key);

impl<const N: usize> InputRow<N> {
    /// The row of these inputs, in the order in which they were made.
    pub fn new(pins: [PinId; N]) -> Self {
        let first = pins.first().copied().map_or(Key::default(), PinId::key);
        let numbers = pins.iter().map(|pin| pin.index());
        debug_assert!(numbers.eq((first.index as usize..).take(N)), "a row");
        Self(first)
    }
}

impl PinStore {
    /// Gives a value to each input of a row, as [`publish`](Self::publish) does: one that is not
    /// finite is counted and not published.
    ///
    /// # Real time
    /// Constant time, no allocation.
    #[inline]
    pub(crate) fn publish_row<const N: usize>(&mut self, row: InputRow<N>, values: [AnyValue; N]) {
        let first = self.index(row.0);
        let slots = first.and_then(|first| self.slots.get_mut(first..));
        let Some(slots) = slots.and_then(|slots| slots.first_chunk_mut::<N>()) else {
            return self.count_foreign();
        };
        let mut are_finite = true;
        for (slot, value) in slots.iter_mut().zip(&values) {
            slot.bad = !value.is_finite();
            if slot.bad {
                are_finite = false;
            } else {
                slot.bits = value.bits;
            }
        }
        if !are_finite {
            self.reject_some(row.0, &values);
        }
    }

    #[cold]
    fn reject_some(&mut self, first: Key, values: &[AnyValue]) {
        for (index, value) in (first.index..).zip(values) {
            if !value.is_finite() {
                self.reject(Key { index, ..first }, Rejection::NotFinite);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hal::{Input, PinMaker};

    #[test]
    fn a_row_is_published_like_each_of_its_inputs() {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "row.");
        let before: Input<i32> = make.input("before").unwrap();
        let (a, b): (Input<f64>, Input<i32>) = (make.input("a").unwrap(), make.input("b").unwrap());
        let (c, d): (Input<bool>, Input<f64>) =
            (make.input("c").unwrap(), make.input("d").unwrap());
        let after: Input<f64> = make.input("after").unwrap();
        let row = InputRow::new([a.into(), b.into(), c.into(), d.into()]);
        store.group_good(group);
        store.publish_row(row, [1.5.into(), (-7).into(), true.into(), 2.5.into()]);
        let shown = |store: &PinStore| {
            (
                store.read(a).ok(),
                store.read(b).ok(),
                store.read(c).ok(),
                store.read(d).ok(),
            )
        };
        assert_eq!(shown(&store), (Some(1.5), Some(-7), Some(true), Some(2.5)));
        let strange = [
            f64::NAN.into(),
            8.into(),
            false.into(),
            f64::INFINITY.into(),
        ];
        store.publish_row(row, strange);
        assert_eq!(shown(&store), (None, Some(8), Some(false), None));
        assert_eq!(store.read(a).value, 1.5, "the last one");
        assert_eq!(store.rejections(a).not_finite, 1);
        assert_eq!(store.total_rejections().not_finite, 2);
        store.publish_row(row, [3.5.into(), 9.into(), true.into(), 4.5.into()]);
        assert_eq!(shown(&store), (Some(3.5), Some(9), Some(true), Some(4.5)));
        assert_eq!(
            (store.read(before).value, store.read(after).value),
            (0, 0.0)
        );
        let mut other = PinStore::default();
        other.publish_row(row, strange);
        assert_eq!(other.foreign_handles(), 1);
    }
}
