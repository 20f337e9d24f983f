//! Raw numbers and engineering values.

use crate::discovery::{DataRecord, DataType};

/// What a raw value means, and which raw value a value becomes.
///
/// Four forms, by type and limits (FACTS 7.4):
///
/// | form | when | value |
/// |---|---|---|
/// | whole | limits are those of the raw number itself | `raw` |
/// | unsigned | unsigned, `min` = 0 | `raw * max / (2^n - 1)` |
/// | signed | two's complement, `min` = -`max` | `raw * max / 2^(n-1)` |
/// | offset | other limits | `raw * (max - min) / (2^n - 1) + min`, raw unsigned |
///
/// The manuals' signed formula would make `min` of raw 0; nothing in the field does so. The offset
/// form is the manuals' unsigned one, and the only sensible reading of limits that fit no other.
/// `min` = `max` means 0 to 1 (two's complement: -1 to 1).
///
/// Records hold their limits as 32-bit floats, in which 2^32 - 1 is 4294967296: such limits still
/// are those of the raw number, and 0x12000001 of 32 bits is 301989889, not 301989889.07.
///
/// # Towards the wire
/// Whole, unsigned and offset round to the nearest raw value, so that a value from the wire goes
/// back to the same raw value.
///
/// Signed follows LinuxCNC on the wire up to 31 bits: it makes a fraction of `2^31 - 1` first
/// (towards zero) and then drops the low `32 - n` bits (downwards). Full scale, which is one more
/// than the largest raw value, needs no special case that way; the price is that a value that falls
/// exactly on a positive step goes one step lower: of 13 bits for +-10 V, 5.0 V is just under 2048
/// (1073741823.5 of `2^31 - 1`) and becomes 2047, and -10 V becomes -4096 (0x1000). The value
/// on the wire is less than `1 + 2^(n-32)` steps off: one step at the widths devices have, one and a
/// half at 31 bits. From 32 bits on, where that way errs more (and LinuxCNC itself does
/// not go), it is the nearest. [`nearest`](Self::nearest) is the nearest at every width.
///
/// Both ends are exact at every width: `max` is the largest raw value, `min` the smallest. Beyond
/// them the end is taken, and said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaling {
    form: Form,
    bits: u8,
    min: f64,
    max: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Whole { signed: bool },
    Unsigned,
    Signed,
    Offset,
}

/// A raw value, and what had to be done to get it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Raw {
    /// The bits, right-justified; bits above the width are zero.
    pub bits: u64,
    /// Whether the value fitted.
    pub fit: Fit,
}

/// Whether a value fitted what the wire can carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// It did.
    Exact,
    /// It lay outside and became the nearest end.
    Clamped,
    /// It was no number; the bits are those of zero, or of the end nearest to zero.
    NotFinite,
}

impl Scaling {
    /// For the number that a record describes; `None` if it describes no number, or as for
    /// [`unsigned`](Self::unsigned).
    ///
    /// Non-volatile numbers are whole whatever their limits, which are limits only: `NVBaudRate`
    /// is 9 for 2.5 Mbaud, with a maximum of 11 (FACTS 8.2).
    pub fn of(record: &DataRecord) -> Option<Self> {
        let (bits, min, max) = (record.bits, f64::from(record.min), f64::from(record.max));
        match record.data_type {
            DataType::Unsigned => Self::unsigned(bits, min, max),
            DataType::Signed => Self::signed(bits, min, max),
            DataType::NonvolUnsigned => Self::whole(bits, false),
            DataType::NonvolSigned => Self::whole(bits, true),
            _ => None,
        }
    }

    /// For a number of `bits` bits that is its own value. `None` for no bits, or more than 64.
    pub fn whole(bits: u8, signed: bool) -> Option<Self> {
        (1..=64).contains(&bits).then(|| {
            let (min, max) = whole_range(bits, signed);
            Self {
                form: Form::Whole { signed },
                bits,
                min: min as f64,
                max: max as f64,
            }
        })
    }

    /// For an unsigned number of `bits` bits. `None` for no bits, more than 64, or limits that are
    /// not finite.
    pub fn unsigned(bits: u8, min: f64, max: f64) -> Option<Self> {
        if is_whole(bits, false, min, max) {
            return Self::whole(bits, false);
        }
        let form = if min == 0.0 || min == max {
            Form::Unsigned
        } else {
            Form::Offset
        };
        Self::scaled(form, bits, min, max)
    }

    /// For a two's complement number of `bits` bits. `None` as for [`unsigned`](Self::unsigned).
    pub fn signed(bits: u8, min: f64, max: f64) -> Option<Self> {
        if is_whole(bits, true, min, max) {
            return Self::whole(bits, true);
        }
        let form = if min == -max || min == max {
            Form::Signed
        } else {
            Form::Offset
        };
        Self::scaled(form, bits, min, max)
    }

    fn scaled(form: Form, bits: u8, min: f64, max: f64) -> Option<Self> {
        let width = (1..=64).contains(&bits);
        if !width || !min.is_finite() || !max.is_finite() || !(max - min).is_finite() {
            return None;
        }
        let (min, max) = match form {
            Form::Signed if min == max => (-1.0, 1.0),
            _ if min == max => (0.0, 1.0),
            _ => (min, max),
        };
        Some(Self {
            form,
            bits,
            min,
            max,
        })
    }

    /// Whether raw values are their own values.
    pub fn is_whole(self) -> bool {
        matches!(self.form, Form::Whole { .. })
    }

    /// The value of the smallest raw value.
    pub fn min(self) -> f64 {
        self.min
    }

    /// The value of full scale.
    pub fn max(self) -> f64 {
        self.max
    }

    /// The value of a raw value; bits above the width are ignored.
    pub fn value(self, raw: u64) -> f64 {
        let raw = raw & self.mask();
        match self.form {
            Form::Whole { signed: false } => raw as f64,
            Form::Whole { signed: true } => sign_extend(raw, self.bits) as f64,
            Form::Unsigned => raw as f64 / self.steps() * self.max,
            Form::Signed => sign_extend(raw, self.bits) as f64 / self.half() * self.max,
            Form::Offset => {
                let fraction = raw as f64 / self.steps();
                // Not `min + fraction * (max - min)`: that misses `max` by rounding.
                self.min * (1.0 - fraction) + self.max * fraction
            }
        }
    }

    /// The raw value of a value, as the field has it on the wire.
    pub fn raw(self, value: f64) -> Raw {
        match self.form {
            Form::Signed if value.is_finite() && self.bits < 32 => self
                .signed_raw(value / self.max, |fraction| {
                    (fraction * 2_147_483_647.0) as i64 >> (32 - self.bits)
                }),
            _ => self.nearest(value),
        }
    }

    /// The raw value whose value is the nearest: `nearest(value(raw))` is `raw`, up to the 53 bits
    /// that a real number holds.
    pub fn nearest(self, value: f64) -> Raw {
        if !value.is_finite() {
            let zero = 0.0_f64.clamp(self.min.min(self.max), self.min.max(self.max));
            return Raw {
                bits: self.nearest(zero).bits,
                fit: Fit::NotFinite,
            };
        }
        match self.form {
            Form::Whole { signed } => self.whole_raw(value, signed),
            Form::Unsigned => self.unsigned_raw(value / self.max),
            Form::Offset => self.unsigned_raw((value - self.min) / (self.max - self.min)),
            Form::Signed => self.signed_raw(value / self.max, |fraction| {
                libm::round(fraction * self.half()) as i64
            }),
        }
    }

    fn whole_raw(self, value: f64, signed: bool) -> Raw {
        let (lowest, highest) = whole_range(self.bits, signed);
        // Exact, or saturated far outside of every range.
        let asked = libm::round(value) as i128;
        let number = asked.clamp(lowest, highest);
        Raw {
            bits: number as u64 & self.mask(),
            fit: if number == asked {
                Fit::Exact
            } else {
                Fit::Clamped
            },
        }
    }

    fn unsigned_raw(self, fraction: f64) -> Raw {
        let (fraction, fit) = clamped(fraction, 0.0);
        // A cast from a real number saturates: 2^64 becomes 2^64 - 1.
        let bits = libm::round(fraction * self.steps()) as u64;
        Raw {
            bits: bits.min(self.mask()),
            fit,
        }
    }

    /// `number` makes the two's complement number of a fraction from -1 to 1; full scale may be
    /// one too large.
    fn signed_raw(self, fraction: f64, number: impl FnOnce(f64) -> i64) -> Raw {
        let (fraction, fit) = clamped(fraction, -1.0);
        let highest = (self.mask() >> 1) as i64;
        let number = if fraction <= -1.0 {
            -highest - 1
        } else {
            number(fraction).min(highest)
        };
        Raw {
            bits: number as u64 & self.mask(),
            fit,
        }
    }

    fn mask(self) -> u64 {
        u64::MAX >> (64 - u32::from(self.bits))
    }

    fn steps(self) -> f64 {
        self.mask() as f64
    }

    /// 2^(n-1)
    fn half(self) -> f64 {
        (1_u64 << (self.bits - 1)) as f64
    }
}

/// The smallest and the largest number of `bits` (1 to 64) bits.
fn whole_range(bits: u8, signed: bool) -> (i128, i128) {
    if signed {
        let half = 1_i128 << (bits - 1);
        (-half, half - 1)
    } else {
        (0, (1_i128 << bits) - 1)
    }
}

/// Whether limits are those of a number of `bits` bits itself, exactly or as the 32-bit floats
/// nearest to them; for two's complement also symmetrical, from -2^(n-1) to 2^(n-1).
fn is_whole(bits: u8, signed: bool, min: f64, max: f64) -> bool {
    if !(1..=64).contains(&bits) {
        return false;
    }
    let (lowest, highest) = whole_range(bits, signed);
    let symmetrical = signed && max == -(lowest as f64);
    // Both are powers of two, or zero: exact in any float.
    min == lowest as f64
        && (max == highest as f64 || max == f64::from(highest as f32) || symmetrical)
}

fn clamped(fraction: f64, lowest: f64) -> (f64, Fit) {
    if fraction > 1.0 {
        (1.0, Fit::Clamped)
    } else if fraction < lowest {
        (lowest, Fit::Clamped)
    } else {
        (fraction, Fit::Exact)
    }
}

/// The two's complement number in the low `bits` (1 to 64) bits.
pub fn sign_extend(raw: u64, bits: u8) -> i64 {
    let unused = 64_u32.saturating_sub(u32::from(bits)).min(63);
    ((raw << unused) as i64) >> unused
}

#[cfg(test)]
mod tests;
