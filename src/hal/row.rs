//! Inputs that are published together.

use super::handle::Key;
use super::{AnyValue, PinError, PinId, PinStore, Role};

/// Inputs that were made one after the other: they are published with one look at their place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InputRow<const N: usize>(Key);

impl PinStore {
    /// The row of these inputs, in the order in which they were made.
    ///
    /// # Errors
    /// [`PinError::ForeignHandle`] unless they are inputs of this store, one behind the other.
    pub(crate) fn input_row<const N: usize>(
        &self,
        pins: [PinId; N],
    ) -> Result<InputRow<N>, PinError> {
        let first = pins.first().map_or(Key::default(), |pin| pin.key());
        let is_row = pins.iter().zip(first.index as usize..).all(|(pin, place)| {
            let is_input = self.info_of(*pin).map(|info| info.role) == Some(Role::Input);
            is_input && pin.index() == place
        });
        is_row
            .then_some(InputRow(first))
            .ok_or(PinError::ForeignHandle)
    }

    /// Gives a value to each input of a row, as [`publish`](Self::publish) does: one that is not
    /// finite is counted and not published.
    ///
    /// # Real time
    /// Constant time, no allocation.
    #[inline]
    pub(crate) fn publish_row<const N: usize>(&mut self, row: InputRow<N>, values: [AnyValue; N]) {
        let first = self.catalog.index(row.0);
        if !first.is_some_and(|first| self.values.publish_row(first, values)) {
            self.count_foreign();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hal::{Input, PinMaker};

    #[test]
    fn row_is_published_like_each_of_its_inputs() {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "row.");
        let before: Input<i32> = make.input("before").unwrap();
        let (a, b): (Input<f64>, Input<i32>) = (make.input("a").unwrap(), make.input("b").unwrap());
        let (c, d): (Input<bool>, Input<f64>) =
            (make.input("c").unwrap(), make.input("d").unwrap());
        let after: Input<f64> = make.input("after").unwrap();
        let row = store.input_row([a.into(), b.into(), c.into(), d.into()]);
        let row = row.unwrap();
        for wrong in [[b.into(), a.into()], [a.into(), c.into()]] {
            assert!(store.input_row::<2>(wrong).is_err(), "{wrong:?}");
        }
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
        assert!(other.input_row([a.into()]).is_err());
        other.publish_row(row, strange);
        assert_eq!(other.foreign_handles(), 1);
    }
}
