//! Which modes a remote has.

use super::{ModeRecord, ModeType};
use core::fmt;

/// A set of mode indexes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ModeSet([u64; 4]);

impl ModeSet {
    /// The software modes among `records`.
    pub fn software(records: &[ModeRecord]) -> Self {
        records
            .iter()
            .filter(|record| record.mode_type == ModeType::Software)
            .map(|record| record.index)
            .collect()
    }

    /// Whether mode `index` is in it.
    pub fn contains(self, index: u8) -> bool {
        let word = self.0.get(usize::from(index / 64));
        word.is_some_and(|word| word >> (index % 64) & 1 != 0)
    }

    /// The indexes, in ascending order.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        (0..=u8::MAX).filter(move |&index| self.contains(index))
    }
}

impl FromIterator<u8> for ModeSet {
    fn from_iter<I: IntoIterator<Item = u8>>(indexes: I) -> Self {
        let mut set = Self::default();
        for index in indexes {
            if let Some(word) = set.0.get_mut(usize::from(index / 64)) {
                *word |= 1 << (index % 64);
            }
        }
        set
    }
}

impl fmt::Display for ModeSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for index in self.iter() {
            write!(f, "{separator}{index}")?;
            separator = ", ";
        }
        if separator.is_empty() {
            f.write_str("it tells of none")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::{string::ToString, vec::Vec};

    #[test]
    fn a_set_of_modes_holds_every_index_and_reads_as_a_list() {
        let all: ModeSet = (0..=255).collect();
        assert_eq!(all.iter().count(), 256);
        let some: ModeSet = [255, 0, 64, 3].into_iter().collect();
        assert_eq!(some.iter().collect::<Vec<_>>(), [0, 3, 64, 255]);
        assert_eq!(some.to_string(), "0, 3, 64, 255");
        assert_eq!(ModeSet::default().to_string(), "it tells of none");
    }
}
