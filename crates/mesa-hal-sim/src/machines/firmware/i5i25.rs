//! Firmwares of a 5I25: ClockLow 33.33 MHz, and no DPLL.

use super::{card_7i76, encoder_pins, muxed_encoders, step_generators, two_connectors};
use crate::fpga::{SimFirmware, gtag};

const BOARD: [u8; 8] = *b"MESA5I25";
const CLOCK_LOW: u32 = 33_333_333;

/// The firmware of a 5I25 with a 7I77 on its first connector.
pub fn firmware_5i25_7i77() -> SimFirmware {
    two_connectors(BOARD, CLOCK_LOW, 1)
}

/// The firmware of a 5I25 with a 7I77 on each of its connectors: six serial channels, and twelve
/// encoders. Modules and pins are those of Mesa's public pin file PIN_7I77x2_34.
pub fn firmware_5i25_7i77x2() -> SimFirmware {
    two_connectors(BOARD, CLOCK_LOW, 2)
}

/// The firmware of a 5I25 with a 7I77 on its first and a 7I76 on its second connector: eight
/// encoders, five step generators, and five serial channels, of which 3 and 4 are the 7I76's.
/// Modules and pins are those of Mesa's public pin file PIN_7I77_7I76_34.
pub fn firmware_5i25_7i77_7i76() -> SimFirmware {
    let mut firmware = firmware_5i25_7i77();
    if let Some(encoders) = firmware.module_mut(gtag::MUXED_ENCODER) {
        *encoders = muxed_encoders(8);
    }
    let before_led = firmware.modules.len() - 1;
    firmware.modules.insert(before_led, step_generators(5, 2));
    let mut card = card_7i76(3);
    // Index before B and A, as the 7I76 has them.
    card.extend(encoder_pins(3).into_iter().rev());
    for (pin, card) in firmware.pins.iter_mut().skip(17).zip(card) {
        *pin = card;
    }
    firmware
}
