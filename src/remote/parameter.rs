//! Parameters of a remote: its data apart from process data.

use alloc::format;
use alloc::string::String;
use core::ops::RangeInclusive;

use super::Scaling;
use super::baud_rate::{BAUD_RATE_PARAMETER, HIGHEST_INDEX, operate_baud_rate};
use super::scaling::{mask, narrow_limits, real, real_bits, sign_extend, whole_range};
use crate::advice::{self, Advice, MesaError};
use crate::discovery::{DataDirection, DataRecord, DataType};
use crate::hal::{
    AnyValue, GroupId, HalType, Param, PinError, PinId, PinMaker, PinStore, Role, Spec, Value,
};
use crate::lbp::{RemoteLink, RemoteLinkError};
use crate::sslbp::{AccessSize, Channel, NonvolatileMemory, RemoteAccess};

/// The value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterValue {
    /// The bits in the remote, right-justified.
    pub raw: u64,
    /// The value in the record's unit.
    pub value: f64,
}

/// Reason why a parameter was not read or written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterError {
    /// The access failed.
    #[error(transparent)]
    Link(#[from] RemoteLinkError),
    /// The remote does not have the parameter.
    #[error("the remote has no parameter of that name")]
    Unknown,
    /// The record has a size for which there is no access.
    #[error("the parameter has {bits} bits, expected 1 to 64; its record is damaged")]
    Size {
        /// Number of bits in the record.
        bits: u8,
    },
    /// The remote declares the parameter as read-only.
    #[error("the parameter is read-only")]
    ReadOnly,
    /// The value does not fit.
    #[error("{value} does not fit: allowed is {}", range(*.kind, *.bits))]
    DoesNotFit {
        /// The value.
        value: AnyValue,
        /// Type of the parameter.
        kind: HalType,
        /// Its width.
        bits: u8,
    },
    /// The value is outside the limits of the record.
    #[error("{value} is out of range {min} to {max}")]
    OutOfRange {
        /// The value.
        value: AnyValue,
        /// Lower limit.
        min: f32,
        /// Upper limit.
        max: f32,
    },
    /// The value is no index of a baud rate.
    #[error(
        "{value} selects no baud rate: allowed is 0 (9600 baud) to {HIGHEST_INDEX} (10000000 baud)"
    )]
    NoBaudRate {
        /// The value.
        value: AnyValue,
    },
    /// The remote contains another value than the one written.
    #[error(
        "the parameter reads {read:#X} after {written:#X} was written; the remote refuses this value, or sets it itself"
    )]
    NotTaken {
        /// Value written.
        written: u64,
        /// Value read back.
        read: u64,
    },
}

impl MesaError for ParameterError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Unknown => Some(advice::LIST_PARAMETERS),
            Self::Size { .. } => Some(advice::LEAVE_PARAMETER_OUT),
            Self::OutOfRange { .. } | Self::NoBaudRate { .. } => Some(advice::CHOOSE_VALUE),
            Self::Link(error) => error.advice(),
            Self::ReadOnly | Self::DoesNotFit { .. } | Self::NotTaken { .. } => None,
        }
    }
}

/// Access to the parameter that a record describes, in the remote's memory.
impl DataRecord {
    /// Reads the parameter from the memory that contains it.
    ///
    /// # Errors
    /// [`ParameterError`] if the access failed, or no access has this size.
    pub fn read_parameter<M: RemoteLink>(
        &self,
        memory: &mut M,
    ) -> Result<ParameterValue, ParameterError> {
        let (kept_in, size) = self.place()?;
        let address = self.address;
        let read = RemoteAccess::Read { address, size };
        let raw = memory.access(kept_in, read)? & mask(self.bits);
        let value = self.value_of(raw);
        Ok(ParameterValue { raw, value })
    }

    /// Writes the parameter and reads it back. A whole number is written in its stored form,
    /// without scale, as in LinuxCNC.
    ///
    /// A non-volatile parameter is written through the EC sequence (FACTS 6.3).
    ///
    /// # Errors
    /// [`ParameterError`]. If it concerns the value or the size, nothing was written.
    pub fn write_parameter<M: RemoteLink>(
        &self,
        memory: &mut M,
        value: impl Into<AnyValue>,
    ) -> Result<(), ParameterError> {
        let (kept_in, size) = self.place()?;
        let address = self.address;
        let value = self.raw_of(value.into())?;
        let write = RemoteAccess::Write {
            address,
            size,
            value,
        };
        memory.access(kept_in, write)?;
        if kept_in.is_some() {
            // The EC sequence has read it back already.
            return Ok(());
        }
        let read = RemoteAccess::Read { address, size };
        match memory.access(None, read)? & mask(self.bits) {
            read if read == value => Ok(()),
            read => Err(ParameterError::NotTaken {
                written: value,
                read,
            }),
        }
    }

    /// The bits of the parameter for a value. A whole number fits every numeric type that can hold
    /// it.
    ///
    /// # Errors
    /// [`ParameterError`] if the parameter is read-only or cannot hold this value.
    pub fn raw_of(&self, value: AnyValue) -> Result<u64, ParameterError> {
        if self.direction == DataDirection::Input {
            return Err(ParameterError::ReadOnly);
        }
        let (kind, bits) = (self.parameter_type(), self.bits);
        let raw = if kind == HalType::Float {
            let raw = real_bits(real_of(value), bits);
            real(raw, bits).is_finite().then_some(raw)
        } else {
            let fitting = whole_numbers(kind, bits);
            let whole = whole_of(value).filter(|n| fitting.contains(n));
            whole.map(|n| n as u64 & mask(bits))
        };
        let raw = raw.ok_or(ParameterError::DoesNotFit { value, kind, bits })?;
        if self.is_named(BAUD_RATE_PARAMETER) && operate_baud_rate(raw).is_none() {
            return Err(ParameterError::NoBaudRate { value });
        }
        let (min, max) = (self.min, self.max);
        // Limits of scaled numbers are in units; equal limits are no limits.
        let is_scaled = matches!(self.data_type, DataType::Unsigned | DataType::Signed);
        let is_limited = !is_scaled && kind != HalType::Bit && min < max;
        if is_limited && !(f64::from(min)..=f64::from(max)).contains(&real_of(value)) {
            return Err(ParameterError::OutOfRange { value, min, max });
        }
        Ok(raw)
    }

    /// The range of whole numbers that the parameter can hold; `None` for a float.
    pub fn whole_numbers(&self) -> Option<RangeInclusive<i128>> {
        let kind = self.parameter_type();
        if self.is_named(BAUD_RATE_PARAMETER) {
            return Some(0..=HIGHEST_INDEX.into());
        }
        (kind != HalType::Float).then(|| whole_numbers(kind, self.bits))
    }

    /// Value of the bits in the record's unit; without a scale, the whole number itself.
    fn value_of(&self, raw: u64) -> f64 {
        match self.parameter_type() {
            HalType::Bit | HalType::Float => real_of(self.typed(raw)),
            _ => Scaling::of(self).value(raw),
        }
    }

    /// Value of the bits as in LinuxCNC: without the scale.
    pub fn typed(&self, raw: u64) -> AnyValue {
        let hal_type = self.parameter_type();
        let bits = match hal_type {
            HalType::Bit => u64::from(raw != 0),
            HalType::Float => real(raw, self.bits).to_bits(),
            HalType::S32 | HalType::S64 => sign_extend(raw, self.bits) as u64,
            HalType::U32 | HalType::U64 => raw,
        };
        AnyValue { hal_type, bits }
    }

    /// The write of the parameter, which is number `parameter` of the remote on `channel`; `None`
    /// for a size for which there is no access.
    pub(super) fn write_of(
        &self,
        channel: Channel,
        parameter: u8,
        raw: u64,
    ) -> Option<ParameterWrite> {
        let (memory, size) = self.place().ok()?;
        Some(ParameterWrite {
            channel,
            parameter,
            memory,
            access: RemoteAccess::Write {
                address: self.address,
                size,
                value: raw,
            },
            mask: mask(self.bits),
        })
    }

    /// The memory that contains it, and the size of an access to it.
    fn place(&self) -> Result<(Option<NonvolatileMemory>, AccessSize), ParameterError> {
        let bits = self.bits;
        let size = AccessSize::for_bits(bits).ok_or(ParameterError::Size { bits })?;
        let is_nonvolatile = self.data_type.is_nonvolatile();
        Ok((is_nonvolatile.then_some(NonvolatileMemory::Eeprom), size))
    }

    /// Type of the parameter in LinuxCNC.
    fn parameter_type(&self) -> HalType {
        let is_wide = self.bits > 32;
        match self.data_type {
            DataType::Boolean => HalType::Bit,
            DataType::Float | DataType::NonvolFloat if matches!(self.bits, 32 | 64) => {
                HalType::Float
            }
            DataType::Signed | DataType::NonvolSigned if is_wide => HalType::S64,
            DataType::Signed | DataType::NonvolSigned => HalType::S32,
            _ if is_wide => HalType::U64,
            _ => HalType::U32,
        }
    }
}

/// A write of a parameter, access by access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ParameterWrite {
    /// The channel of the remote.
    pub channel: Channel,
    /// Index in [`RemotePins::parameters`](super::RemotePins::parameters).
    pub parameter: u8,
    /// The memory that contains it; `None` for the working memory.
    pub memory: Option<NonvolatileMemory>,
    /// The write, with the value.
    pub access: RemoteAccess,
    /// The bits of the value that belong to the parameter.
    pub mask: u64,
}

/// The range of whole numbers that this number of bits can hold.
fn whole_numbers(kind: HalType, bits: u8) -> RangeInclusive<i128> {
    let width = if kind == HalType::Bit { 1 } else { bits };
    let (lowest, highest) = whole_range(width.clamp(1, 64), is_signed(kind));
    lowest..=highest
}

/// The values that a parameter can hold, as text.
fn range(kind: HalType, bits: u8) -> String {
    if kind == HalType::Float {
        return format!("a real number of {bits} bits");
    }
    let numbers = whole_numbers(kind, bits);
    format!("{} to {}", numbers.start(), numbers.end())
}

/// A parameter of a remote in the pin store.
///
/// The parameter is kept in the remote and is accessible in setup mode only: the driver reads it
/// there and [`publish`](Self::publish)es it. Changing it is a separate operation, before the
/// driver starts or while its port is stopped:
/// [`Configured::write_remote_parameter`](crate::driver::Configured::write_remote_parameter),
/// [`Driver::write_remote_parameter`](crate::driver::Driver::write_remote_parameter).
#[derive(Clone, Debug, PartialEq)]
pub struct RemoteParameter {
    /// Record of the parameter.
    pub record: DataRecord,
    /// Value at the first read. A changed non-volatile parameter takes effect at the next power-up,
    /// so this value may still be in use.
    pub first: Option<u64>,
    /// Present value in the remote, right-justified, if known.
    pub known: Option<u64>,
    param: Param<AnyValue>,
}

impl RemoteParameter {
    /// Makes the parameter of a record; `None` for one that no parameter type can hold
    /// ([`DataRecord::is_readable`]).
    pub(super) fn new(
        pins: &mut PinStore,
        group: GroupId,
        name: &str,
        record: &DataRecord,
    ) -> Result<Option<Self>, PinError> {
        if !record.is_readable() {
            return Ok(None);
        }
        let kind = record.parameter_type();
        let spec = Spec {
            unit: record.unit.clone(),
            limits: match kind {
                HalType::Bit | HalType::Float => None,
                _ => narrow_limits(record.bits, is_signed(kind)),
            },
            ..Spec::from(name)
        };
        let role = match record.direction {
            DataDirection::Input => Role::Property,
            _ => Role::InRemote,
        };
        Ok(Some(Self {
            record: record.clone(),
            first: None,
            known: None,
            param: PinMaker::new(pins, group, "").of_remote(spec, role, kind)?,
        }))
    }

    /// The pin that shows it.
    pub fn pin(&self) -> PinId {
        self.param.into()
    }

    /// Publishes the bits read from the remote, right-justified.
    pub fn publish(&mut self, pins: &mut PinStore, raw: u64) {
        let raw = raw & mask(self.record.bits);
        self.first.get_or_insert(raw);
        self.known = Some(raw);
        pins.publish(self.param, self.record.typed(raw));
    }
}

fn is_signed(kind: HalType) -> bool {
    matches!(kind, HalType::S32 | HalType::S64)
}

/// A value as a whole number; `None` if it is not whole.
fn whole_of(value: AnyValue) -> Option<i128> {
    match value.hal_type {
        HalType::Float => {
            // Beyond 2^53 a float does not identify a unique whole number.
            let real = real_of(value);
            let is_whole = libm::trunc(real) == real && libm::fabs(real) <= 9_007_199_254_740_992.0;
            is_whole.then_some(real as i128)
        }
        HalType::S32 | HalType::S64 => Some(i64::from_bits(value.bits).into()),
        HalType::Bit | HalType::U32 | HalType::U64 => Some(value.bits.into()),
    }
}

/// A value as a float, rounded to the nearest one for a large whole number.
fn real_of(value: AnyValue) -> f64 {
    match value.hal_type {
        HalType::Float => Value::from_bits(value.bits),
        HalType::S32 | HalType::S64 => i64::from_bits(value.bits) as f64,
        HalType::Bit | HalType::U32 | HalType::U64 => value.bits as f64,
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

    fn bits_of(record: &DataRecord, value: impl Into<AnyValue>) -> Option<u64> {
        record.raw_of(value.into()).ok()
    }

    /// FACTS 8.2: NVBaudRate 9 = 2.5 M; its record in gateware transcript t03 has the limits 0..11.
    #[test]
    fn nonvolatile_integers_are_limited_but_not_scaled() {
        let baud = record(DataType::NonvolUnsigned, 16, 0.0, 11.0);
        assert!((baud.value_of(9) - 9.0).abs() < f64::EPSILON);
        assert_eq!(bits_of(&baud, 9.0), Some(9));
        assert_eq!(bits_of(&baud, 12.0), None);
        assert_eq!(bits_of(&baud, f64::NAN), None);
        let signed = record(DataType::NonvolSigned, 16, -500.0, 500.0);
        assert!((signed.value_of(0xFFFF) + 1.0).abs() < f64::EPSILON);
        assert_eq!(bits_of(&signed, -1.0), Some(0xFFFF));
        assert_eq!(bits_of(&signed, -501.0), None);
    }

    /// Manual: 7I77, "OPERATE MODE BAUD RATE".
    #[test]
    fn baud_rate_index_outside_the_table_is_always_refused() {
        let baud = DataRecord {
            name: "NVBAUDRATE".into(),
            ..record(DataType::NonvolUnsigned, 16, 0.0, 65_535.0)
        };
        for index in 0..=HIGHEST_INDEX {
            assert_eq!(bits_of(&baud, u32::from(index)), Some(u64::from(index)));
        }
        for value in [12_u32, 255, 65_535] {
            let value = AnyValue::from(value);
            let refused = baud.raw_of(value);
            assert_eq!(refused, Err(ParameterError::NoBaudRate { value }));
        }
        assert_eq!(baud.whole_numbers(), Some(0..=11));
        let rates = [0, 4, 8, 9, 10, 11, 12].map(operate_baud_rate);
        let [lowest, setup, half, usual, twice, highest, none] = rates;
        assert_eq!((lowest, setup, none), (Some(9_600), Some(115_200), None));
        let fast = [half, usual, twice, highest].map(|rate| rate.unwrap_or(0) / 1000);
        assert_eq!(fast, [1_250, 2_500, 5_000, 10_000]);
    }

    /// FACTS 7.4.
    #[test]
    fn numbers_are_read_in_units_and_written_as_raw_values() {
        let volts = record(DataType::Unsigned, 8, 0.0, 36.3);
        assert!((volts.value_of(255) - 36.3).abs() < 1e-5);
        assert_eq!(bits_of(&volts, 100_u32), Some(100));
        let analog = record(DataType::Signed, 13, -10.0, 10.0);
        assert!((analog.value_of(0x1000) + 10.0).abs() < 1e-12);
        assert_eq!(bits_of(&analog, -4096), Some(0x1000));
        assert_eq!(bits_of(&analog, 4095), Some(0x0FFF));
        assert_eq!(bits_of(&analog, 4096), None);
    }

    #[test]
    fn unit_number_is_whole_although_its_limit_is_a_rounded_float() {
        let unit_number = record(DataType::Unsigned, 32, 0.0, u32::MAX as f32);
        let value = unit_number.value_of(0x1200_0001);
        assert_eq!(value.to_bits(), 301_989_889.0_f64.to_bits());
        assert_eq!(bits_of(&unit_number, value), Some(0x1200_0001));
        assert_eq!(bits_of(&unit_number, 4_294_967_296.0), None);
    }

    #[test]
    fn bits_without_a_scale_are_read_as_they_are() {
        let counter = record(DataType::Encoder, 16, 0.0, 0.0);
        assert!((counter.value_of(0xFFFF) - 65535.0).abs() < f64::EPSILON);
        assert_eq!(bits_of(&counter, 65536.0), None);
        let flag = record(DataType::Boolean, 8, 0.0, 1.0);
        assert!((flag.value_of(0x80) - 1.0).abs() < f64::EPSILON);
    }

    proptest! {
        #[test]
        fn whole_numbers_of_every_width_come_back(bits in 1u8..=64, raw: u64, signed: bool) {
            let data_type = if signed { DataType::Signed } else { DataType::Unsigned };
            let record = record(data_type, bits, if signed { -10.0 } else { 0.0 }, 10.0);
            let raw = raw & mask(record.bits);
            let value = if signed { AnyValue::from(sign_extend(raw, bits)) } else { AnyValue::from(raw) };
            prop_assert_eq!(bits_of(&record, value), Some(raw));
        }

        #[test]
        fn no_record_and_value_panics(
            kind: u8, bits: u8, min: f32, max: f32, raw: u64, value: f64,
        ) {
            let record = record(DataType::from_byte(kind), bits, min, max);
            let _ = record.value_of(raw);
            if let Some(raw) = bits_of(&record, value) {
                prop_assert_eq!(raw & !mask(record.bits), 0);
            }
        }
    }
}
