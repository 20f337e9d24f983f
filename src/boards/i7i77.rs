//! The 7I77 and the 7I77D: 32 inputs, 16 outputs, six analog outputs with enables, six encoders.
//!
//! SSLBP sees two remotes that share a name and are distinguished by their unit number: field I/O
//! ([`FIELD`], channel 0) and analog ([`ANALOG`], channel 1). Channel 2 is the RS-422 terminal
//! block TB6. The encoders belong to the FPGA: see [`CARD`].
//!
//! Source: manual 7I77, "CONNECTORS" and "OPERATION"; FACTS 8.

use alloc::format;

use super::attach::FieldExtras;
use super::{AttachError, CardFinder, CardHandles, CardTable, Finder, RemoteHandles};
use crate::discovery::{DataType, ElementTable, RemoteTable};
use crate::hal::{AnalogIn, AnalogOut, Counter, DigitalIn, DigitalOut, Terminals};
use crate::hostmot2::Gtag;

/// Field I/O in all its modes: 0 has inputs and outputs; 1 adds four analog inputs; 2 also the
/// field voltage; 3 also two MPGs.
pub const FIELD: RemoteTable = RemoteTable::new(
    "7I77 field I/O",
    *b"7I77",
    &[
        ElementTable::output("Output", 16, DataType::Bits).at(OUTPUTS),
        ElementTable::input("Input", 32, DataType::Bits).at(INPUTS),
        voltage("AnalogIn0", 0b1110).nth(INPUTS, 0),
        voltage("AnalogIn1", 0b1110).nth(INPUTS, 1),
        voltage("AnalogIn2", 0b1110).nth(INPUTS, 2),
        voltage("AnalogIn3", 0b1110).nth(INPUTS, 3),
        voltage("FieldVoltage", 0b1100),
        mpg("Enc0").at(&[Terminals::new("TB7 pin ", 16, &["INPUT#"], &[1, 2])]),
        mpg("Enc1").at(&[Terminals::new("TB7 pin ", 18, &["INPUT#"], &[3, 4])]),
    ],
)
.of_class(0x12);

/// Analog outputs and drive enables, with a single mode.
pub const ANALOG: RemoteTable = RemoteTable::new(
    "7I77 analog",
    *b"7I77",
    &[
        analog_out(0, "AnalogOut0", "AnalogEna"),
        analog_out(1, "AnalogOut1", "AnalogEna"),
        analog_out(2, "AnalogOut2", "AnalogEna"),
        analog_out(3, "AnalogOut3", "AnalogEna"),
        analog_out(4, "AnalogOut4", "AnalogEna"),
        analog_out(5, "AnalogOut5", "SpinEna"),
        ElementTable::output("AnalogEna", 1, DataType::Boolean).at(ENABLES),
        ElementTable::output("SpinEna", 1, DataType::Boolean).at(SPINDLE_ENABLE),
    ],
)
.of_class(0x11);

const fn voltage(name: &'static str, modes: u16) -> ElementTable {
    let number = ElementTable::input(name, 8, DataType::Unsigned);
    number.range(0.0, 36.3, "V").in_modes(modes)
}

const fn mpg(name: &'static str) -> ElementTable {
    ElementTable::input(name, 8, DataType::Encoder).in_modes(0b1000)
}

const fn analog_out(n: u16, name: &'static str, enable: &'static str) -> ElementTable {
    let volts = ElementTable::output(name, 13, DataType::Signed).range(-10.0, 10.0, "V");
    volts.nth(ANALOG_OUT, n).enabled_by(enable)
}

/// The card and its encoders on a connector: six of them, with three terminal pairs each.
///
/// Source: FACTS 8.1; manual 7I77, "CONNECTORS".
pub const CARD: CardTable = CardTable {
    name: "7I77",
    // TXEN2, TX2, RX2, TX1, RX1, TX0, RX0, EncMux, then A, B and index of each pair of encoders.
    pins: &[
        (Gtag::SSERIAL, 0x90),
        (Gtag::SSERIAL, 0x80),
        (Gtag::SSERIAL, 0x00),
        (Gtag::SSERIAL, 0x80),
        (Gtag::SSERIAL, 0x00),
        (Gtag::SSERIAL, 0x80),
        (Gtag::SSERIAL, 0x00),
        (Gtag::MUX_SELECT, 0x81),
        (Gtag::MUXED_ENCODER, 1),
        (Gtag::MUXED_ENCODER, 2),
        (Gtag::MUXED_ENCODER, 3),
        (Gtag::MUXED_ENCODER, 1),
        (Gtag::MUXED_ENCODER, 2),
        (Gtag::MUXED_ENCODER, 3),
        (Gtag::MUXED_ENCODER, 1),
        (Gtag::MUXED_ENCODER, 2),
        (Gtag::MUXED_ENCODER, 3),
    ],
    first_encoder_pin: 8,
    encoders: &[
        Terminals::encoders("TB3 pin ", 0),
        Terminals::encoders("TB4 pin ", 3),
    ],
    steps: &[],
};

/// The terminals of channel 2 of each card, for a separate remote.
///
/// Source: manual 7I77, "RS-422 INTERFACE".
pub const SERIAL_TERMINALS: &[Terminals] = &[Terminals::new(
    "TB6 pin ",
    0,
    &["RX+", "RX-", "TX+", "TX-"],
    &[3, 4, 5, 6],
)];

const INPUTS: &[Terminals] = &[
    Terminals::new("TB8 pin ", 0, &["INPUT#"], FIRST_16),
    Terminals::new("TB7 pin ", 16, &["INPUT#"], FIRST_16),
];

const OUTPUTS: &[Terminals] = &[
    Terminals::new("TB8 pin ", 0, &["OUTPUT#"], LAST_8),
    Terminals::new("TB7 pin ", 8, &["OUTPUT#"], LAST_8),
];

const FIRST_16: &[u8] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16];
const LAST_8: &[u8] = &[17, 18, 19, 20, 21, 22, 23, 24];

const ANALOG_OUT: &[Terminals] = &[Terminals::new(
    "TB5 pin ",
    0,
    &["AOUT#"],
    &[4, 8, 12, 16, 20, 24],
)];

/// AnalogEna switches the enables of channels 0 to 4 together.
const ENABLES: &[Terminals] = &[Terminals::new(
    "TB5 pin ",
    0,
    &["ENA#-", "ENA#+"],
    &[1, 2, 5, 6, 9, 10, 13, 14, 17, 18],
)];
const SPINDLE_ENABLE: &[Terminals] = &[Terminals::new(
    "TB5 pin ",
    5,
    &["ENA#-", "ENA#+"],
    &[21, 22],
)];

/// A whole 7I77: its two remotes, and the six encoders on TB3 and TB4, which are counters of the
/// board into which it is plugged.
///
/// `attach_card` takes the port and the first of the card's three channels. On a 7I92 that is
/// channel 0 for the card on P2, and channel 3 for one on P1; on a 7I97, whose own channel 0 is on
/// TB4, it is channel 1 for a card on P1.
///
/// ```
/// use mesa_hal::{Driver, I7i77, I7i97, Settings};
/// use mesa_hal_sim::{Motor, machines};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// // A 7I97 with a 7I77 on P1, and a motor on each of their twelve analog outputs.
/// let fpga = machines::twelve_axes_7i97(|_| Motor::default());
/// let mut driver = Driver::start(fpga, Settings::default())?;
/// let board: I7i97 = driver.attach_board()?;
/// let card: I7i77 = driver.attach_card((0, 1))?;
/// let encoder = driver.pins().info(card.encoders[0].count).ok_or("no such pin")?;
/// assert_eq!(encoder.name, "hm2_7i97.0.encoder.06.count");
/// assert!(encoder.place.terminal.starts_with("7I77 TB3 pin 1, "));
/// let enables = [board.analog_out[0].enable, card.analog.analog_out[0].enable];
/// for enable in enables {
///     driver.pins_mut().set(enable, true);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct I7i77 {
    /// Inputs and outputs, on the card's first channel.
    pub field: I7i77Field,
    /// Analog outputs and enables, on its second channel.
    pub analog: I7i77Analog,
    /// Encoders 0 to 2 on TB3, 3 to 5 on TB4.
    pub encoders: [Counter; 6],
}

impl CardHandles for I7i77 {
    const TABLE: &'static CardTable = &CARD;

    fn find(card: &CardFinder<'_>) -> Result<Self, AttachError> {
        Ok(Self {
            field: card.remote(0)?,
            analog: card.remote(1)?,
            encoders: card.encoders()?,
        })
    }
}

/// The pins of the field I/O. The outputs of a 7I77 connect the load to field power, those of a
/// 7I77D to ground; the descriptions of the two kinds of card are identical.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct I7i77Field {
    /// INPUT0 to INPUT31.
    pub inputs: [DigitalIn; 32],
    /// OUTPUT0 to OUTPUT15.
    pub outputs: [DigitalOut; 16],
    /// The voltages of INPUT0 to INPUT3, in modes 1 to 3.
    pub analog_in: Option<[AnalogIn; 4]>,
    /// The field voltage, in modes 2 and 3.
    pub field_voltage: Option<AnalogIn>,
    /// The MPGs on INPUT16/17 and INPUT18/19, in mode 3.
    pub mpgs: Option<[Counter; 2]>,
}

impl RemoteHandles for I7i77Field {
    const TABLE: &'static RemoteTable = &FIELD;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        let FieldExtras {
            analog_in,
            field_voltage,
            mpgs,
        } = pins.extras()?;
        Ok(Self {
            inputs: pins.numbered("input-", DigitalIn::find)?,
            outputs: pins.numbered("output-", DigitalOut::find)?,
            analog_in,
            field_voltage,
            mpgs,
        })
    }
}

/// The pins of the analog part.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct I7i77Analog {
    /// AOUT0 to AOUT5, in volts while `-scalemax` is 10. AOUT0 to AOUT4 share one enable;
    /// [`AnalogOut::enable`] nevertheless applies to each of them individually.
    pub analog_out: [AnalogOut; 6],
    /// ENA0 to ENA4, switched together.
    pub analogena: DigitalOut,
    /// ENA5.
    pub spinena: DigitalOut,
}

impl RemoteHandles for I7i77Analog {
    const TABLE: &'static RemoteTable = &ANALOG;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        let output = |n| {
            let enable = if n < 5 { "analogena" } else { "spinena" };
            pins.analog_out(&format!("analogout{n}"), enable)
        };
        Ok(Self {
            analog_out: pins.each(output)?,
            analogena: pins.one("analogena", DigitalOut::find)?,
            spinena: pins.one("spinena", DigitalOut::find)?,
        })
    }
}
