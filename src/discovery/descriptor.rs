//! Results of discovery about a remote.

use super::ProblemKind;
use crate::sslbp::{AccessSize, RemoteName, in_hal};
use alloc::{format, string::String, vec::Vec};

/// Complete description of a remote, in the software mode in which it was started.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RemoteDescriptor {
    /// Its name.
    pub name: RemoteName,
    /// Its unit number: printed on the card's label, or set by the user.
    pub unit_number: u32,
    /// The software mode in which it was started.
    pub software_mode: u8,
    /// The elements of its process data, in PTOC order: the order in which they are packed.
    pub process_data: Vec<DataRecord>,
    /// The parameters: records of the GTOC that are not process data.
    pub parameters: Vec<DataRecord>,
    /// The modes listed in its tables.
    pub modes: Vec<ModeRecord>,
}

impl RemoteDescriptor {
    /// The parameter with that name, as spelled by the remote or, in lower case, by LinuxCNC.
    pub fn parameter(&self, name: &str) -> Option<&DataRecord> {
        self.parameters.iter().find(|record| record.is_named(name))
    }
}

/// A process-data record: an element of process data, or a parameter.
///
/// Source: manual 7I77, "PROCESS DATA DESCRIPTOR"; FACTS 7.1.
#[derive(Clone, Debug, PartialEq)]
pub struct DataRecord {
    /// Address of the record itself in the remote's memory.
    pub record_address: u16,
    /// Size in bits, 1 to 255.
    pub bits: u8,
    /// Encoding of its bits.
    pub data_type: DataType,
    /// Direction of the data.
    pub direction: DataDirection,
    /// Value of the smallest raw value, in [`unit`](Self::unit)s.
    pub min: f32,
    /// Value of the largest raw value, in [`unit`](Self::unit)s.
    pub max: f32,
    /// Address of the data in the remote's memory.
    pub address: u16,
    /// The unit, for example `volts`; often empty.
    pub unit: String,
    /// The name, for example `Input`.
    pub name: String,
}

impl DataRecord {
    /// True if it has this name, as spelled by the remote or, in lower case, by LinuxCNC.
    pub fn is_named(&self, name: &str) -> bool {
        hal_name(&self.name) == hal_name(name)
    }

    /// True if it is worth saving in a file: non-volatile, writable, and of a size that an access
    /// can have.
    pub fn is_kept(&self) -> bool {
        self.data_type.is_nonvolatile()
            && self.direction != DataDirection::Input
            && self.is_readable()
    }

    /// True if it is a value of a size that an access can have. Pads are none, nor are bits,
    /// counters and streams: a card lists the process data of its other software modes with its
    /// parameters. As in LinuxCNC.
    pub fn is_readable(&self) -> bool {
        let is_value = !matches!(
            self.data_type,
            DataType::Pad
                | DataType::Bits
                | DataType::Stream
                | DataType::Encoder
                | DataType::EncoderHigh
                | DataType::EncoderLow
        );
        is_value && AccessSize::for_bits(self.bits).is_some()
    }
}

/// A remote's own name for an item in HAL spelling: lower case, with `_` for characters that a HAL
/// file cannot hold.
pub(crate) fn hal_name(name: &str) -> String {
    let small = name.chars().map(|c| c.to_ascii_lowercase());
    small.map(in_hal).collect()
}

/// A mode record.
///
/// Source: manual 7I77, "MODE DESCRIPTOR".
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ModeRecord {
    /// Address of the record in the remote's memory.
    pub record_address: u16,
    /// Number of the mode.
    pub index: u8,
    /// Hardware or software mode.
    pub mode_type: ModeType,
    /// Its name, for example `io_analog`.
    pub name: String,
}

/// Source of a mode setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModeType {
    /// 00: EEPROM or jumper.
    Hardware,
    /// 01: the host, before START.
    Software,
    /// Not in the manuals.
    Other(u8),
}

impl ModeType {
    /// From the record's byte.
    pub const fn from_byte(byte: u8) -> Self {
        match byte {
            0 => Self::Hardware,
            1 => Self::Software,
            other => Self::Other(other),
        }
    }
}

/// Encoding of an element's bits.
///
/// Source: manual 7I77, "DATA_TYPE"; FACTS 7.3 for 08 and above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DataType {
    /// 00: alignment only.
    Pad,
    /// 01: packed bits, bit 0 first.
    Bits,
    /// 02: unsigned number.
    Unsigned,
    /// 03: two's complement number.
    Signed,
    /// 04: unsigned number kept in non-volatile memory.
    NonvolUnsigned,
    /// 05: two's complement number kept in non-volatile memory.
    NonvolSigned,
    /// 06: continuous data stream.
    Stream,
    /// 07: non-zero is true, whatever the width.
    Boolean,
    /// 08: counter of n bits, to be extended by the driver.
    Encoder,
    /// 10: IEEE-754 number of 32 or 64 bits.
    Float,
    /// 11: IEEE-754 number kept in non-volatile memory.
    NonvolFloat,
    /// 18: high part of a count.
    EncoderHigh,
    /// 28: low part of a count.
    EncoderLow,
    /// A type that this crate does not support.
    Unknown(u8),
}

impl DataType {
    /// From the record's byte.
    pub const fn from_byte(byte: u8) -> Self {
        match byte {
            0x00 => Self::Pad,
            0x01 => Self::Bits,
            0x02 => Self::Unsigned,
            0x03 => Self::Signed,
            0x04 => Self::NonvolUnsigned,
            0x05 => Self::NonvolSigned,
            0x06 => Self::Stream,
            0x07 => Self::Boolean,
            0x08 => Self::Encoder,
            0x10 => Self::Float,
            0x11 => Self::NonvolFloat,
            0x18 => Self::EncoderHigh,
            0x28 => Self::EncoderLow,
            other => Self::Unknown(other),
        }
    }

    /// Checks that an element of this type can have `bits` bits.
    pub(super) fn check_width(self, bits: u16) -> Result<(), ProblemKind> {
        let expected = match (self, bits) {
            (Self::Float | Self::NonvolFloat, 32 | 64) => return Ok(()),
            (Self::Float | Self::NonvolFloat, _) => "32 or 64",
            (Self::Pad | Self::Bits | Self::Unknown(_), 1..) | (_, 1..=64) => return Ok(()),
            (Self::Pad | Self::Bits | Self::Unknown(_), 0) => "1 to 255",
            _ => "1 to 64",
        };
        let found = format!("{bits} bits");
        Err(ProblemKind::illegal("width", found, expected))
    }

    /// True if values of this type survive a power cycle of the remote.
    pub const fn is_nonvolatile(self) -> bool {
        matches!(
            self,
            Self::NonvolUnsigned | Self::NonvolSigned | Self::NonvolFloat
        )
    }
}

/// Direction of an element, seen from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DataDirection {
    /// 00: read from the remote.
    Input,
    /// 40: in both directions.
    Bidirectional,
    /// 80: written to the remote.
    Output,
}

impl DataDirection {
    /// From the record's byte; `None` for a value the manuals do not list.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0x00 => Some(Self::Input),
            0x40 => Some(Self::Bidirectional),
            0x80 => Some(Self::Output),
            _ => None,
        }
    }

    /// True if the element is part of the data that the remote sends.
    pub const fn is_input(self) -> bool {
        matches!(self, Self::Input | Self::Bidirectional)
    }

    /// True if the element is part of the data that the remote receives.
    pub const fn is_output(self) -> bool {
        matches!(self, Self::Output | Self::Bidirectional)
    }
}
