//! The 7I72: 48 outputs.
//!
//! Source: manual 7I72, "TB3 CONNECTOR PINOUT", "TB2 CONNECTOR PINOUT" (OUTPUT1 is at pin 2: the
//! manual's table has pin 3 twice); FACTS 8.4.

use super::{AttachError, Finder, RemoteHandles};
use crate::discovery::{DataType, ElementTable, RemoteTable};
use crate::hal::{AnalogIn, DigitalOut, Terminals};

/// 48 outputs; mode 1 adds the field voltage, whose scale is not confirmed: the remote's own
/// description takes precedence.
pub const REMOTE: RemoteTable = RemoteTable::new(
    "7I72",
    *b"7I72",
    &[
        ElementTable::output("Output", 48, DataType::Bits).at(OUTPUTS),
        ElementTable {
            unit: "V",
            ..ElementTable::input("FieldVoltage", 16, DataType::Unsigned).in_modes(0b10)
        },
    ],
);

const OUTPUTS: &[Terminals] = &[
    Terminals::new("TB3 pin ", 0, &["OUTPUT#"], ALL_24),
    Terminals::new("TB2 pin ", 24, &["OUTPUT#"], ALL_24),
];

const ALL_24: &[u8] = &[
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24,
];

/// The pins of a 7I72.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct I7i72 {
    /// OUTPUT0 to OUTPUT47.
    pub outputs: [DigitalOut; 48],
    /// The field voltage, in mode 1.
    pub field_voltage: Option<AnalogIn>,
}

impl RemoteHandles for I7i72 {
    const TABLE: &'static RemoteTable = &REMOTE;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        Ok(Self {
            outputs: pins.numbered("output-", DigitalOut::find)?,
            field_voltage: pins.optional("fieldvoltage", AnalogIn::find)?,
        })
    }
}
