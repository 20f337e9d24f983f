//! The LEDs of the board: `hm2_7i97.0.led.CR01` and so on.
//!
//! As they come, Ethernet boards count packets on these LEDs, and the pins show nothing: give the
//! LEDs to the FPGA first, with [`EthernetBoard::set_led_mode`](crate::ethernet::EthernetBoard::set_led_mode) until
//! the board restarts, or with
//! [`EthernetBoard::set_eeprom_led_mode`](crate::ethernet::EthernetBoard::set_eeprom_led_mode) for good.
//! Manual: 7I97, "BOARD STATUS LEDS".

use alloc::format;
use alloc::vec::Vec;

use super::{Module, RegisterError, Registrar, WriteCycle};
use crate::bus::{Setting, Stage};
use crate::hal::Output;
use crate::hostmot2::Gtag;

/// The user LEDs: CR01 to CR04 of the boards with Ethernet.
const LEDS: usize = 4;

/// The LEDs of a board.
#[derive(Debug)]
pub struct Leds {
    leds: Vec<Output<bool>>,
    word: Setting,
}

impl Leds {
    /// The LEDs of a firmware, if it has any.
    ///
    /// # Errors
    /// [`RegisterError::Firmware`] and [`RegisterError::Pin`].
    pub fn register(r: &mut Registrar<'_>) -> Result<Option<Self>, RegisterError> {
        let Some(module) = r.module(Gtag::LED) else {
            return Ok(None);
        };
        module.expect(1, 0)?;
        let data = module.register(0, 0)?;
        let mut make = r.maker("led.");
        let leds = (1..=LEDS).map(|n| make.output(&format!("CR{n:02}")));
        Ok(Some(Self {
            leds: leds.collect::<Result<_, _>>()?,
            word: r.setting(Stage::Configure, data, 0),
        }))
    }

    /// The pins, CR01 first.
    pub fn leds(&self) -> &[Output<bool>] {
        &self.leds
    }
}

impl Module for Leds {
    /// Written when it changes: an LED is not worth eight bytes in every packet.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        let mut word = LedWord::default();
        for (n, led) in (0..).zip(&self.leds) {
            word = word.with(n, cycle.pins.fetch(*led));
        }
        cycle.set(self.word, word.0);
    }
}

/// The LED register: LED 0 is bit 31, LED 7 bit 24.
///
/// Source: FACTS 13.9.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct LedWord(u32);

impl LedWord {
    /// The word with one LED on or off; beyond LED 7 it stays as it is.
    const fn with(self, led: u8, on: bool) -> Self {
        if led > 7 {
            return self;
        }
        let mask = 1 << (31 - led);
        Self(if on { self.0 | mask } else { self.0 & !mask })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn led_0_is_the_top_bit() {
        let word = LedWord::default().with(0, true).with(3, true);
        assert_eq!(word, LedWord(0x9000_0000));
        assert_eq!(word.with(0, false).with(9, true), LedWord(0x1000_0000));
    }
}
