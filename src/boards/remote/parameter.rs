//! Parameters of a remote: what is not process data.

use alloc::format;
use alloc::vec::Vec;

use super::make::{in_unit, lower};
use crate::boards::BoardError;
use crate::discovery::{DataDirection, DataRecord, DataType};
use crate::hal::{GroupId, Param, PinError, Pins, Spec};
use crate::process_data::sign_extend;

/// A parameter of a remote and its pin-store counterpart.
///
/// The driver reads it in setup mode and [`publish`](Self::publish)es it; when the application
/// changes it, [`changed`](Self::changed) tells the bits to write.
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
    /// Its handle.
    pub handle: ParameterHandle,
    /// What the remote has, as far as known.
    known: Option<u64>,
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
    pub fn publish(&mut self, pins: &mut Pins, raw: u64) {
        let raw = raw & self.mask();
        self.known = Some(raw);
        match self.handle {
            ParameterHandle::Bit(param) => pins.publish_param(param, raw != 0),
            ParameterHandle::U32(param) => pins.publish_param(param, raw as u32),
            ParameterHandle::S32(param) => {
                pins.publish_param(param, sign_extend(raw, self.bits) as i32);
            }
            ParameterHandle::U64(param) => pins.publish_param(param, raw),
            ParameterHandle::S64(param) => pins.publish_param(param, sign_extend(raw, self.bits)),
            ParameterHandle::Float(param) if self.bits == 64 => {
                pins.publish_param(param, f64::from_bits(raw));
            }
            ParameterHandle::Float(param) => {
                pins.publish_param(param, f64::from(f32::from_bits(raw as u32)));
            }
        }
    }

    /// What the remote has, right-justified, as far as known.
    pub fn known(&self) -> Option<u64> {
        self.known
    }

    /// The bits to write, if the application has set something else than the remote has. `None`
    /// as well before it was read: nothing is written that was not known before.
    pub fn changed(&self, pins: &Pins) -> Option<u64> {
        let raw = match self.handle {
            ParameterHandle::Bit(param) => u64::from(pins.param(param)),
            ParameterHandle::U32(param) => u64::from(pins.param(param)),
            ParameterHandle::S32(param) => pins.param(param) as u64,
            ParameterHandle::U64(param) => pins.param(param),
            ParameterHandle::S64(param) => pins.param(param) as u64,
            ParameterHandle::Float(param) if self.bits == 64 => pins.param(param).to_bits(),
            ParameterHandle::Float(param) => u64::from((pins.param(param) as f32).to_bits()),
        } & self.mask();
        self.known.is_some_and(|known| known != raw).then_some(raw)
    }

    fn mask(&self) -> u64 {
        u64::MAX >> (64 - u32::from(self.bits.clamp(1, 64)))
    }
}

/// Makes the parameters of a remote. Those that no parameter type can hold are left out: pads, and
/// records wider than 64 bits.
pub(super) fn make(
    pins: &mut Pins,
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
            handle,
            known: None,
        });
    }
    Ok(parameters)
}

fn handle(
    pins: &mut Pins,
    group: GroupId,
    prefix: &str,
    record: &DataRecord,
) -> Result<ParameterHandle, PinError> {
    fn add<T: crate::hal::Value>(
        pins: &mut Pins,
        group: GroupId,
        spec: Spec,
        direction: DataDirection,
    ) -> Result<Param<T>, PinError> {
        if direction == DataDirection::Input {
            pins.add_property(group, spec, T::default())
        } else {
            pins.add_setting(group, spec, T::default())
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
