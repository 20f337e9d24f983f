//! Values as 64-bit words, which other threads can take without a lock: events and snapshots.

use core::time::Duration;

use crate::bus::Instant;
use crate::tally::Tally;

/// Destination of words.
pub(crate) trait WordSink {
    fn put(&mut self, word: u64);
}

/// Counts the words.
impl WordSink for usize {
    fn put(&mut self, _: u64) {
        self.tally(1);
    }
}

/// A value that is a fixed number of words.
///
/// # Real time
/// Constant time, no allocation, no panic.
pub(crate) trait Packed: Sized {
    /// Number of words.
    const WORDS: usize;

    fn pack(&self, to: &mut impl WordSink);

    /// Restores a value from the words of [`pack`](Self::pack); `None` for the words of no value.
    fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self>;
}

/// An enum of [`packed_enum!`]: its first word is the number of the variant, from 0 on.
pub(crate) trait Variants: Packed {
    /// Number of variants.
    const COUNT: usize;
}

/// Implements [`Packed`] for a value that is one word: its conversions to a word, and back.
macro_rules! packed_word {
    ($type:ty, $to:expr, $from:expr $(,)?) => {
        impl $crate::packed::Packed for $type {
            const WORDS: usize = 1;

            fn pack(&self, to: &mut impl $crate::packed::WordSink) {
                let word: fn(&Self) -> u64 = $to;
                to.put(word(self));
            }

            fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self> {
                let value: fn(u64) -> Option<Self> = $from;
                value(from.next()?)
            }
        }
    };
}

packed_word!(u64, |number| *number, Some);
packed_word!(u32, |number| (*number).into(), |word| Some(word as u32));
packed_word!(i64, |number| *number as u64, |word| Some(word as i64));
packed_word!(Instant, |at| at.as_nanos(), |nanos| Some(Self::from_nanos(
    nanos
)),);
// The largest number stands for `None`.
packed_word!(
    Option<Instant>,
    |at| at.map_or(u64::MAX, Instant::as_nanos),
    |nanos| Some((nanos != u64::MAX).then(|| Instant::from_nanos(nanos))),
);
// In nanoseconds; the largest number stands for `Duration::MAX`.
packed_word!(
    Duration,
    |time| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX),
    |nanos| Some(match nanos {
        u64::MAX => Self::MAX,
        nanos => Self::from_nanos(nanos),
    }),
);

/// `None` has the first number that no variant has.
impl<T: Variants> Packed for Option<T> {
    const WORDS: usize = T::WORDS;

    fn pack(&self, to: &mut impl WordSink) {
        if let Some(value) = self {
            value.pack(to);
        } else {
            to.put(T::COUNT as u64);
            fill::<T>(1, to);
        }
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self> {
        let number = from.next()?;
        if number == T::COUNT as u64 {
            skip::<T>(1, from)?;
            return Some(None);
        }
        T::unpack(&mut core::iter::once(number).chain(from)).map(Some)
    }
}

/// The greatest of these numbers of words.
pub(crate) const fn longest(mut numbers: &[usize]) -> usize {
    let mut longest = 0;
    while let [number, rest @ ..] = numbers {
        if *number > longest {
            longest = *number;
        }
        numbers = rest;
    }
    longest
}

/// Fills the words of a value after those that are `used`.
pub(crate) fn fill<T: Packed>(used: usize, to: &mut impl WordSink) {
    for _ in used..T::WORDS {
        to.put(0);
    }
}

/// Skips the words of [`fill`].
pub(crate) fn skip<T: Packed>(used: usize, from: &mut impl Iterator<Item = u64>) -> Option<()> {
    for _ in used..T::WORDS {
        from.next()?;
    }
    Some(())
}

/// Implements [`Packed`] for a struct: its fields, one after the other.
macro_rules! packed {
    ($name:ident { $($field:ident: $type:ty),* $(,)? }) => {
        impl $crate::packed::Packed for $name {
            const WORDS: usize = 0 $(+ <$type as $crate::packed::Packed>::WORDS)*;

            fn pack(&self, to: &mut impl $crate::packed::WordSink) {
                $($crate::packed::Packed::pack(&self.$field, to);)*
            }

            fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self> {
                Some(Self { $($field: <$type as $crate::packed::Packed>::unpack(from)?,)* })
            }
        }
    };
}

/// Defines an enum and implements [`Packed`] for it: the number of the variant, by its position,
/// and its fields, one after the other. A variant has named fields, one field without a name, or
/// none.
macro_rules! packed_enum {
    (@bind $name:ident $type:ty) => { $name };
    (
        $(#[$($enum_attribute:tt)*])*
        $visibility:vis enum $name:ident {
            $(
                $(#[$($attribute:tt)*])*
                $variant:ident
                $(( $(#[$($one_attribute:tt)*])* $one:ty $(,)? ))?
                $({ $( $(#[$($field_attribute:tt)*])* $field:ident: $type:ty ),* $(,)? })?
            ),* $(,)?
        }
    ) => {
        $(#[$($enum_attribute)*])*
        $visibility enum $name {
            $(
                $(#[$($attribute)*])*
                $variant
                $(( $(#[$($one_attribute)*])* $one ))?
                $({ $( $(#[$($field_attribute)*])* $field: $type, )* })?,
            )*
        }

        const _: () = {
            use $crate::packed::{Packed, Variants, WordSink, fill, longest, skip};

            /// Positions of the variants.
            enum Number { $($variant,)* }

            impl Variants for $name {
                const COUNT: usize = [$(Number::$variant),*].len();
            }

            impl Packed for $name {
                const WORDS: usize = longest(&[
                    $(1 $(+ <$one as Packed>::WORDS)? $($(+ <$type as Packed>::WORDS)*)?),*
                ]);

                fn pack(&self, to: &mut impl WordSink) {
                    match self {
                        $(
                            Self::$variant
                            $(($crate::packed::packed_enum!(@bind one $one)))? $({ $($field),* })? => {
                                to.put(Number::$variant as u64);
                                $(<$one as Packed>::pack(one, to);)?
                                $($(<$type as Packed>::pack($field, to);)*)?
                                let used = 1 $(+ <$one as Packed>::WORDS)?
                                    $($(+ <$type as Packed>::WORDS)*)?;
                                fill::<Self>(used, to);
                            }
                        )*
                    }
                }

                fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self> {
                    match from.next()? {
                        $(
                            number if number == Number::$variant as u64 => {
                                let value = Self::$variant
                                    $((<$one as Packed>::unpack(from)?))?
                                    $({ $($field: <$type as Packed>::unpack(from)?,)* })?;
                                let used = 1 $(+ <$one as Packed>::WORDS)?
                                    $($(+ <$type as Packed>::WORDS)*)?;
                                skip::<Self>(used, from)?;
                                Some(value)
                            }
                        )*
                        _ => None,
                    }
                }
            }
        };
    };
}

pub(crate) use {packed, packed_enum, packed_word};

#[cfg(all(test, feature = "std"))]
pub(crate) mod tests {
    use super::{Packed, Variants, WordSink};
    use alloc::vec::Vec;

    impl WordSink for Vec<u64> {
        fn put(&mut self, word: u64) {
            self.push(word);
        }
    }

    /// The value that the words of a value make, if they are as many as its type says.
    pub(crate) fn again<T: Packed>(value: &T) -> Option<T> {
        let mut words = Vec::new();
        value.pack(&mut words);
        assert_eq!(words.len(), T::WORDS);
        let mut rest = words.into_iter();
        let again = T::unpack(&mut rest);
        assert_eq!(rest.next(), None, "as many words are read as were written");
        again
    }

    /// One value of each variant, in their order, with fields from these words.
    pub(crate) fn every<T: Variants>(fields: &[u64]) -> Vec<T> {
        let numbers = 0..=T::COUNT as u64;
        let rest = || fields.iter().copied().cycle().take(T::WORDS - 1);
        let values: Vec<_> = numbers
            .filter_map(|number| T::unpack(&mut core::iter::once(number).chain(rest())))
            .collect();
        assert_eq!(values.len(), T::COUNT, "each variant takes these fields");
        values
    }
}
