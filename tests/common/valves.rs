//! A remote card that this crate does not know: a block of four valves.

use mesa_hal::boards::{AttachError, Finder, RemoteHandles};
use mesa_hal::discovery::{DataType, ElementTable, RemoteTable};
use mesa_hal::hal::{AnalogIn, DigitalIn, DigitalOut, Terminals};
use mesa_hal_sim::devices::Plain;
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::wire::RemoteEnd;

/// The table of a valve block, according to its maker's manual.
pub const VALVES: RemoteTable = RemoteTable::new(
    "valve block",
    *b"VLV4",
    &[
        ElementTable::output("Valve", 4, DataType::Bits).at(&[Terminals::new(
            "X2.",
            0,
            &["Y#"],
            &[3, 4, 5, 6],
        )]),
        ElementTable::output("pad", 4, DataType::Pad),
        ElementTable::input("Closed", 4, DataType::Bits),
        ElementTable::input("pad", 4, DataType::Pad),
        ElementTable::input("Supply", 8, DataType::Unsigned).range(0.0, 36.3, "V"),
    ],
);

/// The block itself, with the additional inputs of a later firmware.
pub fn valve_block(more: &str) -> Box<dyn RemoteEnd> {
    let text = format!(
        "remote VLV4\nunit 0x00000055\nhardware 0 standard\nmode 0 standard\n\
         data Valve 4 bits out\ndata PadOut 4 pad out\n\
         data Closed 4 bits in\ndata PadIn 4 pad in\n\
         data Supply 8 unsigned in 0 36.3 volts\n{more}\
         parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50\n\
         working WatchDogTime 16 NVWatchDogTimeout\nwatchdog WatchDogTime\n"
    );
    let device = Plain::from_description(&text).expect("a description");
    Box::new(Cable::new(Box::new(device), 7))
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Valves {
    pub outputs: [DigitalOut; 4],
    pub closed: [DigitalIn; 4],
    pub supply: AnalogIn,
}

impl RemoteHandles for Valves {
    const TABLE: &'static RemoteTable = &VALVES;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        Ok(Self {
            outputs: pins.numbered("valve-", DigitalOut::find)?,
            closed: pins.numbered("closed-", DigitalIn::find)?,
            supply: pins.one("supply", AnalogIn::find)?,
        })
    }
}
