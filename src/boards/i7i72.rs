//! The 7I72: 48 outputs.
//!
//! Source: manual 7I72, "TB3 CONNECTOR PINOUT", "TB2 CONNECTOR PINOUT" (OUTPUT1 is at pin 2: the
//! manual's table has pin 3 twice); FACTS 8.4.

use alloc::format;

use super::{BoardError, ElementTable, RemoteTable, Terminals, handles};
use crate::discovery::DataDirection;
use crate::hal::{AnalogIn, DigitalOut, Pins};
use crate::remote::RemotePins;

/// 48 outputs; mode 1 adds the field voltage, whose scale is not confirmed: the remote's own
/// description counts.
pub const REMOTE: RemoteTable = RemoteTable {
    title: "7I72",
    name: *b"7I72",
    unit_class: None,
    elements: &[
        ElementTable::bits("Output", 48, DataDirection::Output).at(OUTPUTS),
        ElementTable::volts_in("FieldVoltage", 16, 36.3)
            .in_modes(0b10)
            .with_limits_unknown(),
    ],
};

const OUTPUTS: &[Terminals] = &[
    Terminals::new("TB3 pin ", 0, &["OUTPUT#"], ALL_24),
    Terminals::new("TB2 pin ", 24, &["OUTPUT#"], ALL_24),
];

const ALL_24: &[u8] = &[
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24,
];

/// The pins of a 7I72.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct I7i72 {
    /// OUTPUT0 to OUTPUT47.
    pub outputs: [DigitalOut; 48],
    /// The field voltage, in mode 1.
    pub field_voltage: Option<AnalogIn>,
}

impl I7i72 {
    /// The handles of a 7I72's pins.
    ///
    /// # Errors
    /// [`BoardError::Pin`] if the remote has no such outputs.
    pub fn new(pins: &Pins, remote: &RemotePins) -> Result<Self, BoardError> {
        let prefix = remote.prefix();
        Ok(Self {
            outputs: handles(|n| DigitalOut::find(pins, &format!("{prefix}.output-{n:02}")))?,
            field_voltage: AnalogIn::find(pins, &format!("{prefix}.fieldvoltage")).ok(),
        })
    }
}
