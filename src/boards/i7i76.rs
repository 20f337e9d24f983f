//! The 7I76: field I/O with a spindle output, which is a remote, five step generators and an
//! encoder. The terminals of the remote's pins and of the encoder are not known.
//!
//! Source: a published wiring of a 7I76E, which has the same terminal blocks; that of generator 4
//! is not confirmed, and follows their pattern. The pins are those of Mesa's firmware; those of the
//! remote are those of real cards on a 5I25, a 7I76E, a 7I92T and a 7I96S.

use super::attach::FieldExtras;
use super::{AttachError, CardTable, Finder, RemoteHandles};
use crate::discovery::RemoteTable;
use crate::hal::{AnalogIn, AnalogOut, Counter, DigitalIn, DigitalOut, Terminals};
use crate::hostmot2::Gtag;

/// The remote. It describes itself: widths and order of its process data are not confirmed, so that
/// the table cannot stand for a card that is absent at the start.
pub const REMOTE: RemoteTable = RemoteTable::new("7I76 field I/O", *b"7I76", &[]);

/// The pins of the field I/O and the spindle output of a 7I76, or of the part of a 7I76E that is
/// one.
///
/// ```
/// use mesa_hal::boards::I7i76;
/// use mesa_hal::{Driver, Settings};
/// use mesa_hal_sim::{Stepper, machines};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = machines::five_axes_7i92(|_| Stepper::default());
/// let mut driver = Driver::start(board, Settings::default())?;
/// let card: I7i76 = driver.attach((0, 0))?;
/// let pins = driver.pins_mut();
/// pins.set(card.outputs[3].pin, true);
/// card.spindle.enable(pins, true);
/// card.spindle.set(pins, 40.0); // per cent, while `spinout-scalemax` is 100
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct I7i76 {
    /// Inputs 0 to 31.
    pub inputs: [DigitalIn; 32],
    /// Outputs 0 to 15.
    pub outputs: [DigitalOut; 16],
    /// The spindle's analog output, a share of the voltage at its supply terminals: full scale is
    /// `spinout-scalemax`. Its enable is the pin `spinena`.
    pub spindle: AnalogOut,
    /// The spindle's direction, an isolated output.
    pub spindir: DigitalOut,
    /// The voltages of four inputs, in the software modes that transfer them.
    pub analog_in: Option<[AnalogIn; 4]>,
    /// The field voltage, in the software modes that transfer it.
    pub field_voltage: Option<AnalogIn>,
    /// Two MPGs, in the software mode that has them.
    pub mpgs: Option<[Counter; 2]>,
}

impl RemoteHandles for I7i76 {
    const TABLE: &'static RemoteTable = &REMOTE;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        let FieldExtras {
            analog_in,
            field_voltage,
            mpgs,
        } = pins.extras()?;
        Ok(Self {
            inputs: pins.numbered("input-", DigitalIn::find)?,
            outputs: pins.numbered("output-", DigitalOut::find)?,
            spindle: pins.analog_out("spinout", "spinena")?,
            spindir: pins.one("spindir", DigitalOut::find)?,
            analog_in,
            field_voltage,
            mpgs,
        })
    }
}

/// The card on a connector with a plain encoder, as on a 7I92.
pub const CARD: CardTable = CardTable {
    pins: &with_encoder([(Gtag::ENCODER, 3), (Gtag::ENCODER, 2), (Gtag::ENCODER, 1)]),
    ..CARD_MUXED
};

/// The card on a connector with multiplexed encoders, as on a 7I97.
pub const CARD_MUXED: CardTable = CardTable {
    name: "7I76",
    pins: &with_encoder([
        (Gtag::MUXED_ENCODER, 1),
        (Gtag::MUXED_ENCODER, 2),
        (Gtag::MUXED_ENCODER, 3),
    ]),
    first_encoder_pin: 14,
    encoders: &[],
    steps: &[
        Terminals::new(
            "TB2 pin ",
            0,
            SIGNALS,
            &[2, 3, 4, 5, 8, 9, 10, 11, 14, 15, 16, 17, 20, 21, 22, 23],
        ),
        Terminals::new("TB3 pin ", 4, SIGNALS, &[2, 3, 4, 5]),
    ],
};

/// The card beside a 7I77, as on a 5I25: its multiplexed encoder begins with the index.
///
/// Source: Mesa's public pin file PIN_7I77_7I76_34.
pub const CARD_BESIDE_7I77: CardTable = CardTable {
    pins: &with_encoder([
        (Gtag::MUXED_ENCODER, 3),
        (Gtag::MUXED_ENCODER, 2),
        (Gtag::MUXED_ENCODER, 1),
    ]),
    ..CARD_MUXED
};

const SIGNALS: &[&str] = &["STEP#-", "STEP#+", "DIR#-", "DIR#+"];

/// Direction and step of each generator, TX0, RX0, TX1, RX1, and the pins of the encoder.
const fn with_encoder(encoder: [(Gtag, u8); 3]) -> [(Gtag, u8); 17] {
    const DIR: (Gtag, u8) = (Gtag::STEPGEN, 0x82);
    const STEP: (Gtag, u8) = (Gtag::STEPGEN, 0x81);
    const TX: (Gtag, u8) = (Gtag::SSERIAL, 0x80);
    const RX: (Gtag, u8) = (Gtag::SSERIAL, 0x00);
    let [a, b, c] = encoder;
    [
        DIR, STEP, DIR, STEP, DIR, STEP, DIR, STEP, DIR, STEP, TX, RX, TX, RX, a, b, c,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_generators_are_on_two_blocks() {
        let at = |n| Terminals::of(CARD.steps, n);
        assert_eq!(
            at(1).terminal,
            "TB2 pin 8, TB2 pin 9, TB2 pin 10, TB2 pin 11"
        );
        assert_eq!(at(4).terminal, "TB3 pin 2, TB3 pin 3, TB3 pin 4, TB3 pin 5");
        assert_eq!(at(4).signal, "STEP4-, STEP4+, DIR4-, DIR4+");
        assert_eq!(at(5).terminal, "");
    }
}
