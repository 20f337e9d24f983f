//! The 7I72: 48 outputs.
//!
//! Source: manual 7I72, "TB3 CONNECTOR PINOUT", "TB2 CONNECTOR PINOUT" (OUTPUT1 is at pin 2: the
//! manual's table has pin 3 twice); FACTS 8.4.

use alloc::format;

use super::table::terminals;
use super::{BoardError, ElementTable, RemotePins, RemoteTable, Terminal, handles};
use crate::discovery::DataDirection;
use crate::hal::{AnalogIn, DigitalOut, Pins};

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

const OUTPUTS: &[Terminal] = terminals![
    "TB3 pin 1" "OUTPUT0",
    "TB3 pin 2" "OUTPUT1",
    "TB3 pin 3" "OUTPUT2",
    "TB3 pin 4" "OUTPUT3",
    "TB3 pin 5" "OUTPUT4",
    "TB3 pin 6" "OUTPUT5",
    "TB3 pin 7" "OUTPUT6",
    "TB3 pin 8" "OUTPUT7",
    "TB3 pin 9" "OUTPUT8",
    "TB3 pin 10" "OUTPUT9",
    "TB3 pin 11" "OUTPUT10",
    "TB3 pin 12" "OUTPUT11",
    "TB3 pin 13" "OUTPUT12",
    "TB3 pin 14" "OUTPUT13",
    "TB3 pin 15" "OUTPUT14",
    "TB3 pin 16" "OUTPUT15",
    "TB3 pin 17" "OUTPUT16",
    "TB3 pin 18" "OUTPUT17",
    "TB3 pin 19" "OUTPUT18",
    "TB3 pin 20" "OUTPUT19",
    "TB3 pin 21" "OUTPUT20",
    "TB3 pin 22" "OUTPUT21",
    "TB3 pin 23" "OUTPUT22",
    "TB3 pin 24" "OUTPUT23",
    "TB2 pin 1" "OUTPUT24",
    "TB2 pin 2" "OUTPUT25",
    "TB2 pin 3" "OUTPUT26",
    "TB2 pin 4" "OUTPUT27",
    "TB2 pin 5" "OUTPUT28",
    "TB2 pin 6" "OUTPUT29",
    "TB2 pin 7" "OUTPUT30",
    "TB2 pin 8" "OUTPUT31",
    "TB2 pin 9" "OUTPUT32",
    "TB2 pin 10" "OUTPUT33",
    "TB2 pin 11" "OUTPUT34",
    "TB2 pin 12" "OUTPUT35",
    "TB2 pin 13" "OUTPUT36",
    "TB2 pin 14" "OUTPUT37",
    "TB2 pin 15" "OUTPUT38",
    "TB2 pin 16" "OUTPUT39",
    "TB2 pin 17" "OUTPUT40",
    "TB2 pin 18" "OUTPUT41",
    "TB2 pin 19" "OUTPUT42",
    "TB2 pin 20" "OUTPUT43",
    "TB2 pin 21" "OUTPUT44",
    "TB2 pin 22" "OUTPUT45",
    "TB2 pin 23" "OUTPUT46",
    "TB2 pin 24" "OUTPUT47"
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
