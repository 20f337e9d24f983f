//! What a pin can hold, and how it is kept.

mod sealed {
    pub trait Sealed {}
    impl Sealed for bool {}
    impl Sealed for f64 {}
    impl Sealed for i32 {}
    impl Sealed for u32 {}
    impl Sealed for i64 {}
    impl Sealed for u64 {}
}

/// The type of a pin or parameter, as LinuxCNC calls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum HalType {
    /// A truth value; `bool` here.
    Bit,
    /// A real number; `f64` here.
    Float,
    /// `i32`.
    S32,
    /// `u32`.
    U32,
    /// `i64`.
    S64,
    /// `u64`.
    U64,
}

impl HalType {
    /// LinuxCNC's word for it, for example `bit`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Bit => "bit",
            Self::Float => "float",
            Self::S32 => "s32",
            Self::U32 => "u32",
            Self::S64 => "s64",
            Self::U64 => "u64",
        }
    }
}

impl core::fmt::Display for HalType {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.as_str())
    }
}

/// A type that pins and parameters can have: `bool`, `f64`, `i32`, `u32`, `i64`, `u64`.
///
/// Sealed: the list is LinuxCNC's.
pub trait Value:
    Copy + PartialEq + PartialOrd + Default + core::fmt::Debug + sealed::Sealed
{
    /// Its name in LinuxCNC.
    const TYPE: HalType;

    /// The value as the 64 bits a store keeps.
    fn to_bits(self) -> u64;

    /// The value from the 64 bits a store keeps.
    fn from_bits(bits: u64) -> Self;

    /// Whether it is finite; only a real number can fail to be.
    fn is_finite(self) -> bool {
        true
    }

    /// The opposite of a truth value; numbers stay.
    #[must_use]
    fn inverted(self) -> Self {
        self
    }

    /// Applies `change` to a real number; other values stay.
    #[must_use]
    fn map_real(self, change: impl FnOnce(f64) -> f64) -> Self {
        let _ = change;
        self
    }

    /// The smallest and the largest value.
    fn bounds() -> (Self, Self);

    /// The nearest value of this type to a real number; zero for NaN.
    fn from_f64(value: f64) -> Self;
}

impl Value for bool {
    const TYPE: HalType = HalType::Bit;

    fn to_bits(self) -> u64 {
        u64::from(self)
    }

    fn from_bits(bits: u64) -> Self {
        bits != 0
    }

    fn inverted(self) -> Self {
        !self
    }

    fn bounds() -> (Self, Self) {
        (false, true)
    }

    fn from_f64(value: f64) -> Self {
        value.abs() > 0.0
    }
}

impl Value for f64 {
    const TYPE: HalType = HalType::Float;

    fn to_bits(self) -> u64 {
        f64::to_bits(self)
    }

    fn from_bits(bits: u64) -> Self {
        f64::from_bits(bits)
    }

    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }

    fn map_real(self, change: impl FnOnce(f64) -> f64) -> Self {
        change(self)
    }

    fn bounds() -> (Self, Self) {
        (f64::MIN, f64::MAX)
    }

    fn from_f64(value: f64) -> Self {
        value
    }
}

macro_rules! integer {
    ($type:ty, $through:ty, $hal:ident) => {
        impl Value for $type {
            const TYPE: HalType = HalType::$hal;

            fn to_bits(self) -> u64 {
                // Sign-extended, so that a debugger shows a number and not half of one.
                self as $through as u64
            }

            fn from_bits(bits: u64) -> Self {
                bits as Self
            }

            fn bounds() -> (Self, Self) {
                (Self::MIN, Self::MAX)
            }

            fn from_f64(value: f64) -> Self {
                // A cast from a real number saturates, and makes zero of NaN.
                libm::round(value) as Self
            }
        }
    };
}

integer!(i32, i64, S32);
integer!(u32, u64, U32);
integer!(i64, i64, S64);
integer!(u64, u64, U64);

/// A value and its type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnyValue {
    /// A truth value.
    Bit(bool),
    /// A real number.
    Float(f64),
    /// A 32-bit number with sign.
    S32(i32),
    /// A 32-bit number.
    U32(u32),
    /// A 64-bit number with sign.
    S64(i64),
    /// A 64-bit number.
    U64(u64),
}

impl AnyValue {
    /// The value from the 64 bits a store keeps.
    pub(super) fn from_bits(hal_type: HalType, bits: u64) -> Self {
        match hal_type {
            HalType::Bit => Self::Bit(Value::from_bits(bits)),
            HalType::Float => Self::Float(Value::from_bits(bits)),
            HalType::S32 => Self::S32(Value::from_bits(bits)),
            HalType::U32 => Self::U32(Value::from_bits(bits)),
            HalType::S64 => Self::S64(Value::from_bits(bits)),
            HalType::U64 => Self::U64(Value::from_bits(bits)),
        }
    }
}

macro_rules! any_value {
    ($($type:ty => $variant:ident),*) => {
        $(impl From<$type> for AnyValue {
            fn from(value: $type) -> Self {
                Self::$variant(value)
            }
        })*
    };
}

any_value!(bool => Bit, f64 => Float, i32 => S32, u32 => U32, i64 => S64, u64 => U64);

impl core::fmt::Display for AnyValue {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bit(value) => value.fmt(f),
            Self::Float(value) => value.fmt(f),
            Self::S32(value) => value.fmt(f),
            Self::U32(value) => value.fmt(f),
            Self::S64(value) => value.fmt(f),
            Self::U64(value) => value.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_value_survives_being_kept(
            f in any::<f64>(), i in any::<i32>(), u in any::<u32>(), l in any::<i64>(), b in any::<bool>(),
        ) {
            prop_assert_eq!(<f64 as Value>::from_bits(Value::to_bits(f)).to_bits(), f.to_bits());
            prop_assert_eq!(i32::from_bits(i.to_bits()), i);
            prop_assert_eq!(<u32 as Value>::from_bits(u.to_bits()), u);
            prop_assert_eq!(i64::from_bits(l.to_bits()), l);
            prop_assert_eq!(bool::from_bits(b.to_bits()), b);
        }
    }

    #[test]
    fn real_numbers_become_the_nearest_integer_and_never_wrap() {
        assert_eq!(i32::from_f64(1e300), i32::MAX);
        assert_eq!(u32::from_f64(-1.0), 0);
        assert_eq!(u32::from_f64(f64::NAN), 0);
        assert_eq!(i64::from_f64(-2.5), -3);
    }
}
