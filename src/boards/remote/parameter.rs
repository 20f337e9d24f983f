//! Parameters of a remote: what is not process data.

use alloc::format;
use alloc::vec::Vec;

use super::make::{in_unit, lower};
use crate::boards::BoardError;
use crate::discovery::{DataDirection, DataRecord, DataType};
use crate::hal::{AnyValue, GroupId, HalType, Param, PinError, PinStore, Spec};
use crate::process_data::sign_extend;

/// A parameter of a remote and its pin-store counterpart.
///
/// It lives in the remote, which is reached in setup mode only: the driver reads it there and
/// [`publish`](Self::publish)es it. To change it is an operation of its own, before the driver is
/// built or while its port stands still:
/// [`Builder::remote_parameter`](crate::driver::Builder::remote_parameter),
/// [`Driver::write_remote_parameter`](crate::driver::Driver::write_remote_parameter).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemoteParameter {
    /// The place of its record in the descriptor's `parameters`.
    pub record: usize,
    /// Where it is in the remote's memory.
    pub address: u16,
    /// Its width in bits.
    pub bits: u8,
    /// Whether it survives a power cycle, and takes effect only after one.
    pub nonvolatile: bool,
    /// The remote says that it can be written.
    pub writable: bool,
    /// Its handle.
    pub handle: ParameterHandle,
    /// What the remote had when it was read first.
    first: Option<u64>,
    /// What the remote has, as far as known.
    known: Option<u64>,
}

/// Why a value is not one that a parameter can have.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterValueError {
    /// The remote says that the parameter can only be read.
    #[error("the remote's parameter can only be read")]
    ReadOnly,
    /// The value does not fit.
    #[error("{value} does not fit: the parameter is {kind}, {bits} bits wide")]
    DoesNotFit {
        /// The value.
        value: AnyValue,
        /// What the parameter is.
        kind: HalType,
        /// Its width.
        bits: u8,
    },
}

/// The handle of a parameter, by type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterHandle {
    /// A truth value.
    Bit(Param<bool>),
    /// A number without sign.
    U32(Param<u32>),
    /// A number with sign.
    S32(Param<i32>),
    /// A real number.
    Float(Param<f64>),
    /// A wide number without sign.
    U64(Param<u64>),
    /// A wide number with sign.
    S64(Param<i64>),
}

impl RemoteParameter {
    /// Takes what was read from the remote, right-justified.
    pub fn publish(&mut self, pins: &mut PinStore, raw: u64) {
        let raw = raw & self.mask();
        self.first.get_or_insert(raw);
        self.known = Some(raw);
        match self.handle {
            ParameterHandle::Bit(param) => pins.publish(param, raw != 0),
            ParameterHandle::U32(param) => pins.publish(param, raw as u32),
            ParameterHandle::S32(param) => {
                pins.publish(param, sign_extend(raw, self.bits) as i32);
            }
            ParameterHandle::U64(param) => pins.publish(param, raw),
            ParameterHandle::S64(param) => pins.publish(param, sign_extend(raw, self.bits)),
            ParameterHandle::Float(param) if self.bits == 64 => {
                pins.publish(param, f64::from_bits(raw));
            }
            ParameterHandle::Float(param) => {
                pins.publish(param, f64::from(f32::from_bits(raw as u32)));
            }
        }
    }

    /// What the remote has, right-justified, as far as known.
    pub fn known(&self) -> Option<u64> {
        self.known
    }

    /// What the remote had when it was read first: one that is non-volatile is used from the next
    /// power-up on, so this may be what is in use still.
    pub fn first(&self) -> Option<u64> {
        self.first
    }

    /// The bits to write for a value. Whole numbers fit every kind of number that can hold them.
    ///
    /// # Errors
    /// [`ParameterValueError`]: the parameter can only be read, or can not be this value.
    pub fn raw(&self, value: AnyValue) -> Result<u64, ParameterValueError> {
        if !self.writable {
            return Err(ParameterValueError::ReadOnly);
        }
        let bits = u32::from(self.bits.clamp(1, 64));
        let whole = whole(value);
        let unsigned = |largest: u64| {
            whole
                .and_then(|n| u64::try_from(n).ok())
                .filter(|&n| n <= largest)
        };
        let raw = match self.handle {
            ParameterHandle::Bit(_) => unsigned(1),
            ParameterHandle::U32(_) | ParameterHandle::U64(_) => unsigned(self.mask()),
            ParameterHandle::S32(_) | ParameterHandle::S64(_) => {
                let half = 1_i128 << (bits - 1);
                whole
                    .filter(|n| (-half..half).contains(n))
                    .map(|n| n as u64 & self.mask())
            }
            ParameterHandle::Float(_) => real(value).and_then(|real| self.real_bits(real)),
        };
        raw.ok_or(ParameterValueError::DoesNotFit {
            value,
            kind: self.kind(),
            bits: self.bits,
        })
    }

    fn real_bits(&self, real: f64) -> Option<u64> {
        if self.bits == 64 {
            return real.is_finite().then(|| real.to_bits());
        }
        let short = real as f32;
        short.is_finite().then(|| u64::from(short.to_bits()))
    }

    fn kind(&self) -> HalType {
        match self.handle {
            ParameterHandle::Bit(_) => HalType::Bit,
            ParameterHandle::U32(_) => HalType::U32,
            ParameterHandle::S32(_) => HalType::S32,
            ParameterHandle::Float(_) => HalType::Float,
            ParameterHandle::U64(_) => HalType::U64,
            ParameterHandle::S64(_) => HalType::S64,
        }
    }

    fn mask(&self) -> u64 {
        u64::MAX >> (64 - u32::from(self.bits.clamp(1, 64)))
    }
}

/// A value as a whole number, if it is one.
fn whole(value: AnyValue) -> Option<i128> {
    match value {
        AnyValue::Bit(value) => Some(i128::from(value)),
        AnyValue::S32(value) => Some(i128::from(value)),
        AnyValue::U32(value) => Some(i128::from(value)),
        AnyValue::S64(value) => Some(i128::from(value)),
        AnyValue::U64(value) => Some(i128::from(value)),
        // Beyond 2^53 a real number does not say which whole one is meant.
        AnyValue::Float(value) => (libm::trunc(value) == value
            && libm::fabs(value) <= 9_007_199_254_740_992.0)
            .then_some(value as i128),
    }
}

fn real(value: AnyValue) -> Option<f64> {
    match value {
        AnyValue::Float(value) => Some(value),
        other => whole(other).map(|n| n as f64),
    }
}

/// Makes the parameters of a remote. Those that no parameter type can hold are left out: pads, and
/// records wider than 64 bits.
pub(super) fn make(
    pins: &mut PinStore,
    group: GroupId,
    prefix: &str,
    records: &[DataRecord],
) -> Result<Vec<RemoteParameter>, BoardError> {
    let mut parameters = Vec::with_capacity(records.len());
    for (index, record) in records.iter().enumerate() {
        if record.data_type == DataType::Pad || !(1..=64).contains(&record.bits) {
            continue;
        }
        let handle =
            handle(pins, group, prefix, record).map_err(|source| BoardError::Parameter {
                parameter: index,
                source,
            })?;
        parameters.push(RemoteParameter {
            record: index,
            address: record.address,
            bits: record.bits,
            nonvolatile: record.data_type.is_nonvolatile(),
            writable: record.direction != DataDirection::Input,
            handle,
            first: None,
            known: None,
        });
    }
    Ok(parameters)
}

fn handle(
    pins: &mut PinStore,
    group: GroupId,
    prefix: &str,
    record: &DataRecord,
) -> Result<ParameterHandle, PinError> {
    fn add<T: crate::hal::Value>(
        pins: &mut PinStore,
        group: GroupId,
        spec: Spec,
        direction: DataDirection,
    ) -> Result<Param<T>, PinError> {
        if direction == DataDirection::Input {
            pins.add_property(group, spec, T::default())
        } else {
            pins.add_in_remote(group, spec, T::default())
        }
    }
    let name = format!("{prefix}.{}", lower(&record.name));
    let spec = in_unit(Spec::new(name), &record.unit, "");
    let direction = record.direction;
    let wide = record.bits > 32;
    // A number as wide as its type takes every value; a narrower one only what its bits hold.
    let unsigned = |spec: Spec| match record.bits {
        32 | 64 => spec,
        bits => spec.limits(0.0, largest_below(bits)),
    };
    let signed = |spec: Spec| match record.bits {
        32 | 64 => spec,
        bits => {
            let half = (1_u64 << (bits - 1)) as f64;
            spec.limits(-half, largest_below(bits - 1))
        }
    };
    match record.data_type {
        DataType::Boolean => add(pins, group, spec, direction).map(ParameterHandle::Bit),
        DataType::Float | DataType::NonvolFloat if matches!(record.bits, 32 | 64) => {
            add(pins, group, spec, direction).map(ParameterHandle::Float)
        }
        DataType::Signed | DataType::NonvolSigned if wide => {
            add(pins, group, signed(spec), direction).map(ParameterHandle::S64)
        }
        DataType::Signed | DataType::NonvolSigned => {
            add(pins, group, signed(spec), direction).map(ParameterHandle::S32)
        }
        _ if wide => add(pins, group, unsigned(spec), direction).map(ParameterHandle::U64),
        _ => add(pins, group, unsigned(spec), direction).map(ParameterHandle::U32),
    }
}

/// The largest real number that is no more than `2^bits - 1`: for wide numbers that is less, and
/// rounding it up would let one more bit through.
pub(super) fn largest_below(bits: u8) -> f64 {
    let largest = ((1_u128 << bits) - 1) as f64;
    if bits > 53 {
        libm::nextafter(largest, 0.0)
    } else {
        largest
    }
}
