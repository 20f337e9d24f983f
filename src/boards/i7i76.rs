//! The terminals of the 7I76's step generators. Its field I/O is a remote, which names its own
//! pins; the terminals of those and of its encoder are not known.
//!
//! Source: a published wiring of a 7I76E, which has the same terminal blocks; that of generator 4
//! is not confirmed, and follows their pattern. The pins are those of Mesa's firmware.

use super::CardTable;
use crate::hal::Terminals;
use crate::hostmot2::Gtag;

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
