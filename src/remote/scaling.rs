//! Conversion between raw numbers and engineering values.

use crate::discovery::{DataRecord, DataType};

/// Conversion between raw values and engineering values.
///
/// Three forms, by type and limits (FACTS 7.4):
///
/// | form | when | value |
/// |---|---|---|
/// | whole | limits are those of the raw number itself | `raw` |
/// | signed | two's complement, `min` = -`max` | `raw * max / 2^(n-1)` |
/// | offset | other limits | `raw * (max - min) / (2^n - 1) + min`, raw unsigned |
///
/// The manuals' signed formula would make `min` of raw 0; no implementation in the field does so.
/// The offset form is the manuals' unsigned one, and the only sensible interpretation of limits
/// that fit no other. `min` = `max` means 0 to 1 (two's complement: -1 to 1), and so do limits that
/// are not finite.
///
/// Records contain their limits as 32-bit floats, in which 2^32 - 1 is 4294967296: such limits
/// still count as those of the raw number, and 0x12000001 of 32 bits is 301989889, not
/// 301989889.07.
///
/// # Towards the wire
/// Whole and offset round to the nearest raw value, so that a value from the wire converts back to
/// the same raw value.
///
/// Signed follows LinuxCNC up to 31 bits: it first computes a fraction of `2^31 - 1` (rounded
/// towards zero) and then drops the low `32 - n` bits (rounding down). Full scale, which is one
/// more than the largest raw value, thus needs no special case; the price is that a value exactly
/// on a positive step goes one step lower: with 13 bits for +-10 V, 5.0 V is just under 2048
/// (1073741823.5 of `2^31 - 1`) and becomes 2047, and -10 V becomes -4096 (0x1000). The error of
/// the value on the wire is less than `1 + 2^(n-32)` steps: one step at the widths of existing
/// devices, one and a half at 31 bits. From 32 bits on, where this method has larger errors (and
/// LinuxCNC has no such numbers), the nearest raw value is used.
///
/// Both ends are exact at every width: `max` is the largest raw value, `min` the smallest. Values
/// beyond them are limited to the ends; NaN and infinity count as 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaling {
    form: Form,
    bits: u8,
    /// The value of the smallest raw value.
    pub(super) min: f64,
    /// The value of full scale.
    pub(super) max: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Whole { signed: bool },
    Signed,
    Offset,
}

impl Scaling {
    /// The scaling of the number that a record describes.
    ///
    /// Non-volatile numbers, and types that are not numbers, are whole whatever their limits, which
    /// then are only limits: `NVBaudRate` is 9 for 2.5 Mbaud, with a maximum of 11 (FACTS 8.2).
    pub fn of(record: &DataRecord) -> Self {
        let (min, max) = (f64::from(record.min), f64::from(record.max));
        match record.data_type {
            DataType::Unsigned => Self::new(record.bits, false, min, max),
            DataType::Signed => Self::new(record.bits, true, min, max),
            DataType::NonvolSigned => Self::whole(record.bits, true),
            _ => Self::whole(record.bits, false),
        }
    }

    fn whole(bits: u8, signed: bool) -> Self {
        let bits = bits.clamp(1, 64);
        let (min, max) = whole_range(bits, signed);
        Self {
            form: Form::Whole { signed },
            bits,
            min: min as f64,
            max: max as f64,
        }
    }

    /// The scaling of a number of `bits` bits, 1 to 64, in two's complement if it is `signed`.
    pub fn new(bits: u8, signed: bool, min: f64, max: f64) -> Self {
        let whole = Self::whole(bits, signed);
        let (_, highest) = whole_range(whole.bits, signed);
        // The ends of the number itself, or the 32-bit floats nearest to them; for two's complement
        // also symmetrical. The lowest is a power of two, or zero: exact in any float.
        let is_highest = max == whole.max || max == f64::from(highest as f32);
        if min == whole.min && (is_highest || signed && max == -whole.min) {
            return whole;
        }
        let is_scale = min != max && (max - min).is_finite();
        let (form, min, max) = match signed {
            true if !is_scale => (Form::Signed, -1.0, 1.0),
            true if min == -max => (Form::Signed, min, max),
            _ if !is_scale => (Form::Offset, 0.0, 1.0),
            _ => (Form::Offset, min, max),
        };
        Self {
            form,
            min,
            max,
            ..whole
        }
    }

    /// True if a raw value is its own value.
    pub fn is_whole(self) -> bool {
        matches!(self.form, Form::Whole { .. })
    }

    /// The value of a raw value; bits above the width are ignored.
    pub fn value(self, raw: u64) -> f64 {
        let raw = raw & self.mask();
        match self.form {
            Form::Whole { signed: false } => raw as f64,
            Form::Whole { signed: true } => sign_extend(raw, self.bits) as f64,
            Form::Signed => sign_extend(raw, self.bits) as f64 / self.half() * self.max,
            Form::Offset => {
                let fraction = raw as f64 / self.mask() as f64;
                // Not `min + fraction * (max - min)`: that misses `max` by rounding.
                self.min * (1.0 - fraction) + self.max * fraction
            }
        }
    }

    /// The raw value for a value, as in the field on the wire: right-justified, with zeros above
    /// the width.
    pub fn raw(self, value: f64) -> u64 {
        let value = if value.is_finite() { value } else { 0.0 };
        let raw = match self.form {
            Form::Whole { signed } => nearest_whole(value, self.bits, signed),
            Form::Offset => {
                let fraction = (value - self.min) / (self.max - self.min);
                // A cast from a float saturates: 2^64 becomes 2^64 - 1.
                let raw = libm::round(fraction.clamp(0.0, 1.0) * self.mask() as f64) as u64;
                raw.min(self.mask())
            }
            Form::Signed => {
                let (fraction, highest) = (value / self.max, (self.mask() >> 1) as i64);
                let number = match fraction.min(1.0) {
                    ..=-1.0 => !highest,
                    fraction if self.bits < 32 => {
                        (fraction * 2_147_483_647.0) as i64 >> 32_u8.wrapping_sub(self.bits)
                    }
                    fraction => libm::round(fraction * self.half()) as i64,
                };
                // Full scale may be one too large.
                number.min(highest) as u64
            }
        };
        raw & self.mask()
    }

    fn mask(self) -> u64 {
        mask(self.bits)
    }

    /// 2^(n-1)
    fn half(self) -> f64 {
        (1_u64 << self.bits.wrapping_sub(1)) as f64
    }
}

/// The smallest and the largest number of `bits` (1 to 64) bits.
pub(super) fn whole_range(bits: u8, signed: bool) -> (i128, i128) {
    if signed {
        let highest = i128::from(mask(bits) >> 1);
        (!highest, highest)
    } else {
        (0, i128::from(mask(bits)))
    }
}

/// The whole number of that width nearest to a value, in two's complement.
// Separate function, because its wide numbers would occupy the registers of the other forms.
#[inline(never)]
fn nearest_whole(value: f64, bits: u8, signed: bool) -> u64 {
    let (lowest, highest) = whole_range(bits, signed);
    // Exact, or saturated far outside of every range.
    (libm::round(value) as i128).clamp(lowest, highest) as u64
}

/// The range of numbers of this width as floats, never exceeding it, for a width below the 32 or 64
/// bits of the type; `None` for a number with the full width.
pub(super) fn narrow_limits(bits: u8, signed: bool) -> Option<(f64, f64)> {
    let (lowest, highest) = whole_range(bits, signed);
    let (min, mut max) = (lowest as f64, highest as f64);
    if max as i128 > highest {
        // Rounded up, it would allow one more bit.
        max = libm::nextafter(max, 0.0);
    }
    (!matches!(bits, 32 | 64)).then_some((min, max))
}

/// Ones in the low `bits` bits; at least one, at most 64.
pub(super) const fn mask(bits: u8) -> u64 {
    match bits {
        0 => 1,
        1..64 => !(u64::MAX << bits),
        _ => u64::MAX,
    }
}

/// The two's complement number in the low `bits` (1 to 64) bits.
pub(super) fn sign_extend(raw: u64, bits: u8) -> i64 {
    let unused = 64_u32.saturating_sub(u32::from(bits)).min(63);
    ((raw << unused) as i64) >> unused
}

/// The float encoded in 32 or 64 bits.
pub(super) fn real(raw: u64, bits: u8) -> f64 {
    if bits == 64 {
        f64::from_bits(raw)
    } else {
        f64::from(f32::from_bits(raw as u32))
    }
}

/// The encoding of a float in 32 or 64 bits.
pub(super) fn real_bits(value: f64, bits: u8) -> u64 {
    if bits == 64 {
        value.to_bits()
    } else {
        u64::from((value as f32).to_bits())
    }
}

#[cfg(test)]
mod tests;
