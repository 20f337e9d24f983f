//! Values of parameters in files and on the command line.

use mesa_hal::hal::{AnyValue, HalType};

/// Value of a parameter as in LinuxCNC: without its scale.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(untagged))]
pub enum SavedValue {
    /// A whole number, or a Boolean as 0 or 1.
    Whole(i64),
    /// A whole number of 2^63 or more.
    Wide(u64),
    /// A real number.
    Real(f64),
}

impl From<AnyValue> for SavedValue {
    fn from(value: AnyValue) -> Self {
        match value.hal_type {
            HalType::Float => Self::Real(f64::from_bits(value.bits)),
            HalType::S32 | HalType::S64 => Self::Whole(value.bits as i64),
            HalType::Bit | HalType::U32 | HalType::U64 => {
                i64::try_from(value.bits).map_or(Self::Wide(value.bits), Self::Whole)
            }
        }
    }
}

impl From<SavedValue> for AnyValue {
    fn from(value: SavedValue) -> Self {
        match value {
            SavedValue::Whole(value) => value.into(),
            SavedValue::Wide(value) => value.into(),
            SavedValue::Real(value) => value.into(),
        }
    }
}

impl core::fmt::Display for SavedValue {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Whole(value) => value.fmt(f),
            Self::Wide(value) => value.fmt(f),
            Self::Real(value) => value.fmt(f),
        }
    }
}

/// Parses a number: decimal, hexadecimal after `0x`, or real.
///
/// # Errors
/// Returns the text if it is not a number.
pub fn parse_value(text: &str) -> Result<AnyValue, &str> {
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let whole = match hex {
        Some(hex) => u64::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    };
    let signed = || text.parse::<i64>().ok().map(AnyValue::from);
    let real = || text.parse::<f64>().ok().filter(|real| real.is_finite());
    whole
        .map(AnyValue::from)
        .or_else(signed)
        .or_else(|| real().map(AnyValue::from))
        .ok_or(text)
}
