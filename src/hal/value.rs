//! Types and values of pins, and their storage as bits.

mod sealed {
    pub trait Sealed {}
}

/// The type of a pin or parameter, as LinuxCNC calls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
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

    /// The opposite of a truth value; numbers stay.
    #[must_use]
    fn inverted(self) -> Self {
        self
    }

    /// The smallest and the largest value.
    fn bounds() -> (Self, Self);

    /// The nearest value of this type to a real number; zero for NaN.
    fn from_f64(value: f64) -> Self;
}

impl sealed::Sealed for bool {}
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

impl sealed::Sealed for f64 {}
impl Value for f64 {
    const TYPE: HalType = HalType::Float;

    fn to_bits(self) -> u64 {
        f64::to_bits(self)
    }

    fn from_bits(bits: u64) -> Self {
        f64::from_bits(bits)
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
        impl sealed::Sealed for $type {}
        impl Value for $type {
            const TYPE: HalType = HalType::$hal;

            fn to_bits(self) -> u64 {
                // Sign-extended, so that a debugger shows the whole number.
                self as $through as u64
            }

            fn from_bits(bits: u64) -> Self {
                bits as Self
            }

            fn bounds() -> (Self, Self) {
                (Self::MIN, Self::MAX)
            }

            fn from_f64(value: f64) -> Self {
                // A cast from a float saturates, and makes zero of NaN.
                libm::round(value) as Self
            }
        }
    };
}

integer!(i32, i64, S32);
integer!(u32, u64, U32);
integer!(i64, i64, S64);
integer!(u64, u64, U64);

/// A value whose type is known at run time only.
///
/// With the feature `serde` it is serialized as a plain truth value or number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnyValue {
    /// Its type.
    pub hal_type: HalType,
    /// The value as the bits that [`Value::to_bits`] returns for that type.
    pub bits: u64,
}

impl AnyValue {
    /// True if the value is finite; always true for types other than float.
    pub fn is_finite(self) -> bool {
        self.hal_type != HalType::Float || f64::from_bits(self.bits).is_finite()
    }

    /// 0, or NaN if the value is not finite: the sum over many values is one look at all of them.
    #[inline]
    pub(super) fn nonfinite_part(self) -> f64 {
        match self.hal_type {
            HalType::Float => f64::from_bits(self.bits) - f64::from_bits(self.bits),
            _ => 0.0,
        }
    }

    /// The value as a real number; a bit is 0 or 1.
    pub fn as_f64(self) -> f64 {
        match self.hal_type {
            HalType::Bit => f64::from(u8::from(bool::from_bits(self.bits))),
            HalType::Float => f64::from_bits(self.bits),
            HalType::S32 | HalType::S64 => i64::from_bits(self.bits) as f64,
            HalType::U32 | HalType::U64 => self.bits as f64,
        }
    }

    /// The value of a bit; `None` for a number.
    pub const fn as_bool(self) -> Option<bool> {
        match self.hal_type {
            HalType::Bit => Some(self.bits != 0),
            _ => None,
        }
    }

    /// The value of an integer; a bit is 0 or 1. `None` for a float, and for an integer that is too
    /// large.
    ///
    /// ```
    /// use mesa_hal::hal::AnyValue;
    /// let values = [(-7).into(), true.into(), 1.5.into(), u64::MAX.into()];
    /// assert_eq!(values.map(AnyValue::as_i64), [Some(-7), Some(1), None, None]);
    /// ```
    pub fn as_i64(self) -> Option<i64> {
        match self.hal_type {
            HalType::Bit => Some(i64::from(self.bits != 0)),
            HalType::Float => None,
            HalType::S32 | HalType::S64 => Some(i64::from_bits(self.bits)),
            HalType::U32 | HalType::U64 => i64::try_from(self.bits).ok(),
        }
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for AnyValue {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.hal_type {
            HalType::Bit => serializer.serialize_bool(bool::from_bits(self.bits)),
            HalType::Float => serializer.serialize_f64(f64::from_bits(self.bits)),
            HalType::S32 | HalType::S64 => serializer.serialize_i64(i64::from_bits(self.bits)),
            HalType::U32 | HalType::U64 => serializer.serialize_u64(self.bits),
        }
    }
}

impl<T: Value> From<T> for AnyValue {
    fn from(value: T) -> Self {
        Self {
            hal_type: T::TYPE,
            bits: value.to_bits(),
        }
    }
}

impl core::fmt::Display for AnyValue {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.hal_type {
            HalType::Bit => bool::from_bits(self.bits).fmt(f),
            HalType::Float => f64::from_bits(self.bits).fmt(f),
            HalType::S32 | HalType::S64 => i64::from_bits(self.bits).fmt(f),
            HalType::U32 | HalType::U64 => self.bits.fmt(f),
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
    fn any_value_is_a_real_number_too() {
        let values = [
            AnyValue::from(true),
            (-7_i32).into(),
            7_u64.into(),
            (-0.5).into(),
        ];
        assert_eq!(values.map(AnyValue::as_f64), [1.0, -7.0, 7.0, -0.5]);
        assert_eq!(
            values.map(AnyValue::as_bool),
            [Some(true), None, None, None]
        );
    }

    #[test]
    fn real_numbers_become_the_nearest_integer_and_never_wrap() {
        assert_eq!(i32::from_f64(1e300), i32::MAX);
        assert_eq!(u32::from_f64(-1.0), 0);
        assert_eq!(u32::from_f64(f64::NAN), 0);
        assert_eq!(i64::from_f64(-2.5), -3);
    }
}
