//! The LEDs of the board.

use super::{Gtag, HostMot2, LocateError};

/// The register of the LEDs.
///
/// Source: FACTS 13.9.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leds {
    /// Address of the register, see [`LedWord`].
    pub data: u16,
}

impl Leds {
    /// The LEDs of a firmware.
    pub fn locate(firmware: &HostMot2) -> Result<Self, LocateError> {
        let module = firmware.require(Gtag::LED)?;
        module.expect(&[Gtag::LED], 1, 0)?;
        Ok(Self {
            data: module.block(0)?.first(),
        })
    }
}

/// The LED register: LED 0 is bit 31, LED 7 bit 24.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct LedWord(pub u32);

impl LedWord {
    /// The word with one LED on or off; beyond LED 7 it stays as it is.
    #[must_use]
    pub const fn with(self, led: u8, on: bool) -> Self {
        if led > 7 {
            return self;
        }
        let mask = 1 << (31 - led);
        Self(if on { self.0 | mask } else { self.0 & !mask })
    }

    /// Whether an LED is on.
    pub const fn is_on(self, led: u8) -> bool {
        led <= 7 && self.0 & (1 << (31 - led)) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn led_0_is_the_top_bit() {
        let word = LedWord::default().with(0, true).with(3, true);
        assert_eq!(word, LedWord(0x9000_0000));
        assert!(word.is_on(3) && !word.is_on(1) && !word.is_on(8));
        assert_eq!(word.with(0, false).with(9, true), LedWord(0x1000_0000));
    }
}
