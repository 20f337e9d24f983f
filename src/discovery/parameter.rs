//! Parameters of a remote: reading and writing them by their record.

use super::{DataDirection, DataRecord, DataType, RemoteDescriptor, RemoteParameters};
use crate::sslbp::AccessSize;
use thiserror::Error;

/// The value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterValue {
    /// As it is in the remote, right-justified.
    pub raw: u64,
    /// In the record's unit.
    pub value: f64,
}

/// Why a parameter could not be read or written.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ParameterError<E: core::error::Error + 'static> {
    /// The access failed.
    #[error(transparent)]
    Memory(#[from] E),
    /// The record has a size that no access has.
    #[error("the parameter has {bits} bits; parameters have 1 to 64")]
    Size {
        /// Its bits.
        bits: u8,
    },
    /// The record says that it can only be read.
    #[error("the parameter can only be read (its direction is input)")]
    ReadOnly,
    /// The value is no number.
    #[error("the value is not finite; nothing was written")]
    NotFinite,
    /// The value is outside of what the record allows, or of what its bits hold.
    #[error("{value} is outside of {min} to {max}; nothing was written")]
    OutOfRange {
        /// The value.
        value: f64,
        /// The least that is allowed.
        min: f64,
        /// The most that is allowed.
        max: f64,
    },
    /// The remote holds something else than what was written.
    #[error("the parameter reads {read:#X} after {written:#X} was written")]
    NotTaken {
        /// What was written.
        written: u64,
        /// What is there.
        read: u64,
    },
}

impl RemoteDescriptor {
    /// The parameter of that name; upper and lower case are the same.
    pub fn parameter(&self, name: &str) -> Option<&DataRecord> {
        self.parameters
            .iter()
            .find(|record| record.name.eq_ignore_ascii_case(name))
    }
}

impl DataRecord {
    /// Reads the parameter that this record describes, from the memory it belongs to.
    pub fn read_parameter<M: RemoteParameters>(
        &self,
        memory: &mut M,
    ) -> Result<ParameterValue, ParameterError<M::Error>> {
        let size = self.access_size()?;
        let word = if self.data_type.is_nonvolatile() {
            memory.read_nonvolatile(self.address, size)?
        } else {
            memory.read(self.address, size)?
        };
        let raw = word & self.raw_mask();
        Ok(ParameterValue {
            raw,
            value: self.value_of(raw),
        })
    }

    /// Writes the parameter that this record describes, in its unit.
    pub fn write_parameter<M: RemoteParameters>(
        &self,
        memory: &mut M,
        value: f64,
    ) -> Result<(), ParameterError<M::Error>> {
        let raw = self.raw_of(value)?;
        self.write_parameter_raw(memory, raw)
    }

    /// Writes the parameter that this record describes, as it is in the remote, and reads it back.
    ///
    /// A non-volatile one is written through the EC sequence (FACTS 6.3).
    pub fn write_parameter_raw<M: RemoteParameters>(
        &self,
        memory: &mut M,
        raw: u64,
    ) -> Result<(), ParameterError<M::Error>> {
        if self.direction == DataDirection::Input {
            return Err(ParameterError::ReadOnly);
        }
        let size = self.access_size()?;
        let mask = self.raw_mask();
        if raw & !mask != 0 {
            return Err(ParameterError::OutOfRange {
                value: raw as f64,
                min: 0.0,
                max: mask as f64,
            });
        }
        if self.data_type.is_nonvolatile() {
            return Ok(memory.write_nonvolatile(self.address, size, raw)?);
        }
        memory.write(self.address, size, raw)?;
        let read = memory.read(self.address, size)? & mask;
        if read == raw {
            Ok(())
        } else {
            Err(ParameterError::NotTaken { written: raw, read })
        }
    }

    fn access_size<E: core::error::Error + 'static>(
        &self,
    ) -> Result<AccessSize, ParameterError<E>> {
        let bits = self.bits;
        AccessSize::for_bits(bits).ok_or(ParameterError::Size { bits })
    }

    fn raw_mask(&self) -> u64 {
        match self.bits {
            0 => 0,
            bits @ 1..=63 => (1 << bits) - 1,
            _ => u64::MAX,
        }
    }

    /// What `raw` means.
    ///
    /// Non-volatile integers are not scaled: their limits are limits only (NVBaudRate is 9 for
    /// 2.5 Mbaud, with a maximum of 11). FACTS 7.4, 8.2.
    fn value_of(&self, raw: u64) -> f64 {
        match self.data_type {
            DataType::Float | DataType::NonvolFloat if self.bits == 32 => {
                f64::from(f32::from_bits(raw as u32))
            }
            DataType::Float | DataType::NonvolFloat => f64::from_bits(raw),
            DataType::NonvolSigned => self.sign_extended(raw) as f64,
            DataType::Boolean => f64::from(u8::from(raw != 0)),
            DataType::Unsigned | DataType::Signed => {
                let Scale { offset, step } = self.scale();
                self.counts(raw) * step + offset
            }
            _ => raw as f64,
        }
    }

    /// What has to be written for `value`; nothing is clamped.
    fn raw_of<E: core::error::Error + 'static>(
        &self,
        value: f64,
    ) -> Result<u64, ParameterError<E>> {
        if !value.is_finite() {
            return Err(ParameterError::NotFinite);
        }
        self.require_limits(value)?;
        match self.data_type {
            DataType::Float | DataType::NonvolFloat if self.bits == 32 => {
                return Ok(u64::from((value as f32).to_bits()));
            }
            DataType::Float | DataType::NonvolFloat => return Ok(value.to_bits()),
            DataType::Boolean => return Ok(u64::from(value != 0.0)),
            _ => {}
        }
        let counts = match self.data_type {
            DataType::Unsigned | DataType::Signed => {
                let Scale { offset, step } = self.scale();
                (value - offset) / step
            }
            _ => value,
        };
        let (min, max) = self.count_range();
        let rounded = libm::round(counts);
        if rounded < min || rounded > max {
            return Err(ParameterError::OutOfRange { value, min, max });
        }
        Ok((rounded as i128 as u64) & self.raw_mask())
    }

    /// The record's own limits, unless both are the same, which means that there are none.
    fn require_limits<E: core::error::Error + 'static>(
        &self,
        value: f64,
    ) -> Result<(), ParameterError<E>> {
        let (min, max) = (f64::from(self.min), f64::from(self.max));
        let limited = !matches!(
            self.data_type,
            DataType::Unsigned | DataType::Signed | DataType::Boolean
        );
        if limited && min < max && !(min..=max).contains(&value) {
            return Err(ParameterError::OutOfRange { value, min, max });
        }
        Ok(())
    }

    fn is_signed(&self) -> bool {
        matches!(self.data_type, DataType::Signed | DataType::NonvolSigned)
    }

    /// The smallest and largest count.
    fn count_range(&self) -> (f64, f64) {
        let half = libm::exp2(f64::from(self.bits) - 1.0);
        if self.is_signed() {
            (-half, half - 1.0)
        } else {
            (0.0, 2.0 * half - 1.0)
        }
    }

    fn counts(&self, raw: u64) -> f64 {
        if self.is_signed() {
            self.sign_extended(raw) as f64
        } else {
            raw as f64
        }
    }

    fn sign_extended(&self, raw: u64) -> i64 {
        let unused = 64u32.saturating_sub(u32::from(self.bits)).min(63);
        ((raw << unused) as i64) >> unused
    }

    /// FACTS 7.4: unsigned from 0, or signed and symmetric, as the field does it; the manual's form
    /// with a minimum otherwise.
    fn scale(&self) -> Scale {
        let (min, max) = if self.min < self.max {
            (f64::from(self.min), f64::from(self.max))
        } else {
            (0.0, 1.0)
        };
        let (least, most) = self.count_range();
        if self.is_signed() && (min == -max || min == 0.0) {
            return Scale {
                offset: 0.0,
                step: max / -least,
            };
        }
        let step = (max - min) / (most - least);
        Scale {
            offset: min - least * step,
            step,
        }
    }
}

/// A value is `counts * step + offset`.
struct Scale {
    offset: f64,
    step: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn record(data_type: DataType, bits: u8, min: f32, max: f32) -> DataRecord {
        DataRecord {
            record_address: 0,
            bits,
            data_type,
            direction: DataDirection::Bidirectional,
            min,
            max,
            address: 0x24,
            unit: alloc::string::String::new(),
            name: alloc::string::String::from("p"),
        }
    }

    fn raw_of(record: &DataRecord, value: f64) -> Option<u64> {
        record.raw_of::<core::fmt::Error>(value).ok()
    }

    /// FACTS 8.2: NVBaudRate 9 = 2.5 M; its record in gateware transcript t03 has the limits 0..11.
    #[test]
    fn nonvolatile_integers_are_limited_but_not_scaled() {
        let baud = record(DataType::NonvolUnsigned, 16, 0.0, 11.0);
        assert!((baud.value_of(9) - 9.0).abs() < f64::EPSILON);
        assert_eq!(raw_of(&baud, 9.0), Some(9));
        assert_eq!(raw_of(&baud, 12.0), None);
        assert_eq!(raw_of(&baud, f64::NAN), None);
    }

    /// FACTS 7.4.
    #[test]
    fn numbers_are_scaled_as_the_field_does() {
        let volts = record(DataType::Unsigned, 8, 0.0, 36.3);
        assert!((volts.value_of(255) - 36.3).abs() < 1e-5);
        assert_eq!(raw_of(&volts, volts.value_of(100)), Some(100));
        let analog = record(DataType::Signed, 13, -10.0, 10.0);
        assert!((analog.value_of(0x1000) + 10.0).abs() < 1e-12);
        assert_eq!(raw_of(&analog, -10.0), Some(0x1000));
        assert_eq!(raw_of(&analog, 10.0), None);
    }

    proptest! {
        #[test]
        fn integers_up_to_52_bits_come_back(bits in 1u8..=52, raw: u64, signed: bool) {
            let data_type = if signed { DataType::Signed } else { DataType::Unsigned };
            let record = record(data_type, bits, if signed { -10.0 } else { 0.0 }, 10.0);
            let raw = raw & record.raw_mask();
            prop_assert_eq!(raw_of(&record, record.value_of(raw)), Some(raw));
        }

        #[test]
        fn no_record_and_value_panics(
            kind: u8, bits: u8, min: f32, max: f32, raw: u64, value: f64,
        ) {
            let record = record(DataType::from_byte(kind), bits, min, max);
            let _ = record.value_of(raw);
            if let Some(raw) = raw_of(&record, value) {
                prop_assert_eq!(raw & !record.raw_mask(), 0);
            }
        }
    }
}
