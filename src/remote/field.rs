//! A run of bits in the interface registers.

use super::scaling::mask;

/// 1 to 64 adjacent bits in the words of the interface registers, least significant bit first;
/// shift and mask are computed once.
///
/// # Real time
/// Constant time, no allocation. Missing words read as zero and are not written: the plan has
/// checked that there are enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Field {
    word: u8,
    shift: u8,
    /// Its width.
    pub bits: u8,
    /// Mask of its width, right-justified.
    pub mask: u64,
}

impl Field {
    /// The widest field.
    pub const MAX_BITS: u8 = 64;

    /// The `bits` bits from bit `offset` on, which is at most 8191; `None` if `bits` is 0 or more
    /// than 64.
    pub fn new(offset: Option<u16>, bits: u16) -> Option<Self> {
        let bits = u8::try_from(bits).ok()?;
        let is_width = (1..=Self::MAX_BITS).contains(&bits);
        offset.filter(|_| is_width).map(|offset| Self {
            word: (offset / 32) as u8,
            shift: (offset % 32) as u8,
            bits,
            mask: mask(bits),
        })
    }

    /// The value of the bits as an unsigned number.
    pub fn get(self, words: &[u32]) -> u64 {
        let first = self.word as usize;
        let word =
            |index: usize| u128::from(words.get(first.wrapping_add(index)).copied().unwrap_or(0));
        if self.shift.wrapping_add(self.bits) <= 32 {
            return (word(0) >> self.shift) as u64 & self.mask;
        }
        let wide = word(0) | word(1) << 32 | word(2) << 64;
        (wide >> self.shift) as u64 & self.mask
    }

    /// Sets the bits to the low bits of `value`; no other bit changes.
    pub fn put(self, words: &mut [u32], value: u64) {
        if self.shift.wrapping_add(self.bits) <= 32 {
            // Fast path for most fields.
            if let Some(word) = words.get_mut(self.word as usize) {
                let mask = (self.mask as u32) << self.shift;
                *word = *word & !mask | (value as u32) << self.shift & mask;
            }
            return;
        }
        let mask = u128::from(self.mask) << self.shift;
        let value = u128::from(value & self.mask) << self.shift;
        let touched = words.iter_mut().skip(self.word as usize).take(3);
        for (part, word) in (0_u32..).step_by(32).zip(touched) {
            *word = *word & !((mask >> part) as u32) | (value >> part) as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn field_has_1_to_64_bits() {
        assert_eq!(Field::new(Some(0), 0), None);
        assert_eq!(Field::new(Some(0), 65), None);
        assert_eq!(Field::new(None, 1), None);
        assert_eq!(Field::new(Some(31), 64).map(|field| field.bits), Some(64));
    }

    #[test]
    fn field_of_any_width_and_place_round_trips_without_side_effect() {
        for bits in 1..=64u16 {
            for offset in 0..=(224 - bits) {
                let field = Field::new(Some(offset), bits).unwrap();
                for background in [0, u32::MAX, 0xA5A5_5A5A] {
                    let mut words = [background; 7];
                    let value = 0x9E37_79B9_7F4A_7C15 ^ u64::from(offset);
                    field.put(&mut words, value);
                    assert_eq!(field.get(&words), value & field.mask, "{field:?}");
                    for bit in 0..224u16 {
                        let word = words[usize::from(bit / 32)] >> (bit % 32) & 1;
                        let expected = if (offset..offset + bits).contains(&bit) {
                            (value >> (bit - offset) & 1) as u32
                        } else {
                            background >> (bit % 32) & 1
                        };
                        assert_eq!(word, expected, "{field:?} bit {bit}");
                    }
                }
            }
        }
    }

    proptest! {
        #[test]
        fn words_that_are_not_there_are_zero_and_left_alone(
            offset in 0..8192u16, bits in 1..=64u16, value in any::<u64>(), len in 0..4usize,
        ) {
            if let Some(field) = Field::new(Some(offset), bits) {
                let mut words = [0; 4];
                field.put(&mut words[..len], value);
                prop_assert!(words[len..].iter().all(|&w| w == 0));
                prop_assert_eq!(field.get(&words[..len]) & !value, 0);
            }
        }
    }
}
