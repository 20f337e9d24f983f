//! Parameters of a remote: reading and writing them by their record.

use super::{Fit, Scaling};
use crate::discovery::{DataDirection, DataRecord, DataType, RemoteParameters};
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
    #[error("the parameter has {bits} bits, expected 1 to 64; its record is damaged, leave it out")]
    Size {
        /// Its bits.
        bits: u8,
    },
    /// The record says that it can only be read.
    #[error("the parameter can only be read (its direction is input); nothing was written")]
    ReadOnly,
    /// The value is no number.
    #[error("the value is not finite; nothing was written, give a number")]
    NotFinite,
    /// The value is outside of what the record allows, or of what its bits hold.
    #[error("{value} is outside of {min} to {max}; nothing was written, give a value within")]
    OutOfRange {
        /// The value.
        value: f64,
        /// The least that is allowed.
        min: f64,
        /// The most that is allowed.
        max: f64,
    },
    /// Its limits make no scale.
    #[error(
        "the limits {min} to {max} of the parameter make no scale; use read_parameter_raw or write_parameter_raw"
    )]
    Limits {
        /// The record's minimum.
        min: f32,
        /// The record's maximum.
        max: f32,
    },
    /// The remote holds something else than what was written.
    #[error(
        "the parameter reads {read:#X} after {written:#X} was written; the remote refuses this value, or sets it itself"
    )]
    NotTaken {
        /// What was written.
        written: u64,
        /// What is there.
        read: u64,
    },
}

impl DataRecord {
    /// Reads the parameter that this record describes, from the memory it belongs to.
    pub fn read_parameter<M: RemoteParameters>(
        &self,
        memory: &mut M,
    ) -> Result<ParameterValue, ParameterError<M::Error>> {
        let raw = self.read_parameter_raw(memory)?;
        Ok(ParameterValue {
            raw,
            value: Meaning::of(self)?.value(raw),
        })
    }

    /// Reads the parameter that this record describes as it is in the remote, right-justified.
    pub fn read_parameter_raw<M: RemoteParameters>(
        &self,
        memory: &mut M,
    ) -> Result<u64, ParameterError<M::Error>> {
        let size = self.access_size()?;
        let word = if self.data_type.is_nonvolatile() {
            memory.read_nonvolatile(self.address, size)?
        } else {
            memory.read(self.address, size)?
        };
        Ok(word & self.raw_mask())
    }

    /// Writes the parameter that this record describes, in its unit.
    pub fn write_parameter<M: RemoteParameters>(
        &self,
        memory: &mut M,
        value: f64,
    ) -> Result<(), ParameterError<M::Error>> {
        let raw = Meaning::of(self)?.raw(value)?;
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
        u64::MAX >> (64 - u32::from(self.bits.clamp(1, 64)))
    }
}

/// How the bits of a parameter are meant, and which values may be written.
struct Meaning {
    form: Form,
    /// Limits that do not scale the value.
    limits: Option<(f64, f64)>,
}

enum Form {
    Float32,
    Float64,
    Boolean,
    Number(Scaling),
}

impl Meaning {
    fn of<E: core::error::Error + 'static>(record: &DataRecord) -> Result<Self, ParameterError<E>> {
        let (min, max, bits) = (record.min, record.max, record.bits);
        let scaled = matches!(record.data_type, DataType::Unsigned | DataType::Signed);
        let form = match record.data_type {
            DataType::Float | DataType::NonvolFloat => match bits {
                32 => Form::Float32,
                64 => Form::Float64,
                _ => return Err(ParameterError::Size { bits }),
            },
            DataType::Boolean => Form::Boolean,
            _ => {
                let scaling = Scaling::of(record);
                let scaling = scaling.or_else(|| {
                    // Counters, streams and the like: bits as they are.
                    (!scaled).then(|| Scaling::whole(bits, false)).flatten()
                });
                Form::Number(scaling.ok_or(ParameterError::Limits { min, max })?)
            }
        };
        // Equal limits are none.
        let limited = !scaled && !matches!(form, Form::Boolean) && min < max;
        let limits = limited.then(|| (f64::from(min), f64::from(max)));
        Ok(Self { form, limits })
    }

    fn value(&self, raw: u64) -> f64 {
        match self.form {
            Form::Float32 => f64::from(f32::from_bits(raw as u32)),
            Form::Float64 => f64::from_bits(raw),
            Form::Boolean => f64::from(u8::from(raw != 0)),
            Form::Number(scaling) => scaling.value(raw),
        }
    }

    /// What has to be written for `value`: nothing is clamped, and what was read goes back as it
    /// was.
    fn raw<E: core::error::Error + 'static>(&self, value: f64) -> Result<u64, ParameterError<E>> {
        if !value.is_finite() {
            return Err(ParameterError::NotFinite);
        }
        if let Some((min, max)) = self.limits
            && !(min..=max).contains(&value)
        {
            return Err(ParameterError::OutOfRange { value, min, max });
        }
        match self.form {
            Form::Float32 => Ok(u64::from((value as f32).to_bits())),
            Form::Float64 => Ok(value.to_bits()),
            Form::Boolean => Ok(u64::from(value != 0.0)),
            Form::Number(scaling) => {
                let raw = scaling.nearest(value);
                if raw.fit == Fit::Exact {
                    return Ok(raw.bits);
                }
                let (min, max) = (scaling.min(), scaling.max());
                Err(ParameterError::OutOfRange { value, min, max })
            }
        }
    }
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

    fn meaning(record: &DataRecord) -> Meaning {
        Meaning::of::<core::fmt::Error>(record).unwrap()
    }

    fn value_of(record: &DataRecord, raw: u64) -> f64 {
        meaning(record).value(raw)
    }

    fn raw_of(record: &DataRecord, value: f64) -> Option<u64> {
        meaning(record).raw::<core::fmt::Error>(value).ok()
    }

    /// FACTS 8.2: NVBaudRate 9 = 2.5 M; its record in gateware transcript t03 has the limits 0..11.
    #[test]
    fn nonvolatile_integers_are_limited_but_not_scaled() {
        let baud = record(DataType::NonvolUnsigned, 16, 0.0, 11.0);
        assert!((value_of(&baud, 9) - 9.0).abs() < f64::EPSILON);
        assert_eq!(raw_of(&baud, 9.0), Some(9));
        assert_eq!(raw_of(&baud, 12.0), None);
        assert_eq!(raw_of(&baud, f64::NAN), None);
        let signed = record(DataType::NonvolSigned, 16, -500.0, 500.0);
        assert!((value_of(&signed, 0xFFFF) + 1.0).abs() < f64::EPSILON);
        assert_eq!(raw_of(&signed, -1.0), Some(0xFFFF));
        assert_eq!(raw_of(&signed, -501.0), None);
    }

    /// FACTS 7.4.
    #[test]
    fn numbers_are_scaled_as_the_field_does_and_never_clamped() {
        let volts = record(DataType::Unsigned, 8, 0.0, 36.3);
        assert!((value_of(&volts, 255) - 36.3).abs() < 1e-5);
        assert_eq!(raw_of(&volts, value_of(&volts, 100)), Some(100));
        let analog = record(DataType::Signed, 13, -10.0, 10.0);
        assert!((value_of(&analog, 0x1000) + 10.0).abs() < 1e-12);
        assert_eq!(raw_of(&analog, -10.0), Some(0x1000));
        assert_eq!(raw_of(&analog, 10.0), Some(0x0FFF));
        assert_eq!(raw_of(&analog, 10.01), None);
    }

    #[test]
    fn a_unit_number_is_whole_although_its_limit_is_a_rounded_float() {
        let unit_number = record(DataType::Unsigned, 32, 0.0, u32::MAX as f32);
        let value = value_of(&unit_number, 0x1200_0001);
        assert_eq!(value.to_bits(), 301_989_889.0_f64.to_bits());
        assert_eq!(raw_of(&unit_number, value), Some(0x1200_0001));
        assert_eq!(raw_of(&unit_number, 4_294_967_296.0), None);
    }

    #[test]
    fn bits_without_a_scale_are_read_as_they_are() {
        let counter = record(DataType::Encoder, 16, 0.0, 0.0);
        assert!((value_of(&counter, 0xFFFF) - 65535.0).abs() < f64::EPSILON);
        assert_eq!(raw_of(&counter, 65536.0), None);
        let flag = record(DataType::Boolean, 8, 0.0, 1.0);
        assert!((value_of(&flag, 0x80) - 1.0).abs() < f64::EPSILON);
    }

    proptest! {
        /// A scaled value passes two roundings of 53 bits.
        #[test]
        fn integers_up_to_50_bits_come_back(bits in 1u8..=50, raw: u64, signed: bool) {
            let data_type = if signed { DataType::Signed } else { DataType::Unsigned };
            let record = record(data_type, bits, if signed { -10.0 } else { 0.0 }, 10.0);
            let raw = raw & record.raw_mask();
            prop_assert_eq!(raw_of(&record, value_of(&record, raw)), Some(raw));
        }

        #[test]
        fn no_record_and_value_panics(
            kind: u8, bits: u8, min: f32, max: f32, raw: u64, value: f64,
        ) {
            let record = record(DataType::from_byte(kind), bits, min, max);
            let Ok(meaning) = Meaning::of::<core::fmt::Error>(&record) else {
                return Ok(());
            };
            let _ = meaning.value(raw);
            if let Ok(raw) = meaning.raw::<core::fmt::Error>(value) {
                prop_assert_eq!(raw & !record.raw_mask(), 0);
            }
        }
    }
}
