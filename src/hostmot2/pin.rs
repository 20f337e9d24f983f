//! Pin descriptors: the functions that the firmware offers on each pin.

use super::Gtag;
use super::pin_roles::role;
use alloc::string::String;
use core::fmt::{self, Write};

/// Function of one I/O pin besides plain I/O.
///
/// `Display` prints the function in words: `SSerial 0 TX1`, `MuxedEncoder 0 A`, `I/O`. Numbers
/// count from 0, as everywhere in HostMot2.
///
/// Source: FACTS 9.1, 13.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct PinDescriptor {
    /// Number of the pin within the module; bit 7 is set if the module drives it.
    pub secondary_pin: u8,
    /// The module that can use it; [`Gtag::NONE`] for plain I/O only.
    pub secondary: Gtag,
    /// Instance of the module; 0x80 for all.
    pub unit: u8,
    /// Function without the module: an I/O port.
    pub primary: Gtag,
}

impl PinDescriptor {
    /// Unit of pins that belong to all instances.
    pub(super) const GLOBAL: u8 = 0x80;

    /// Parses a descriptor.
    pub const fn parse(word: u32) -> Self {
        let [secondary_pin, secondary, unit, primary] = word.to_le_bytes();
        Self {
            secondary_pin,
            secondary: Gtag(secondary),
            unit,
            primary: Gtag(primary),
        }
    }

    /// True for a local I/O pin: a pin of the FPGA that ends on the board, listed behind the
    /// ordinary ones in the descriptors (FACTS 9.1).
    pub const fn is_local(&self) -> bool {
        self.primary.0 == Gtag::LOCAL_IO_PORT.0
    }

    /// True if a module can use the pin.
    pub const fn has_module(&self) -> bool {
        self.secondary.0 != Gtag::NONE.0
    }

    /// True if the module drives the pin.
    pub const fn is_output(&self) -> bool {
        self.has_module() && self.secondary_pin & 0x80 != 0
    }

    /// The channel of a smart serial pin, from 0 on; `None` for other pins.
    ///
    /// Source: FACTS 13.1.
    pub fn sserial_channel(&self) -> Option<u8> {
        if !matches!(self.secondary, Gtag::SSERIAL | Gtag::SSERIAL_B) {
            return None;
        }
        match (self.secondary_pin & 0xF0, self.secondary_pin & 0x0F) {
            (0x00 | 0x80 | 0x90 | 0xA0, number @ 1..=15) => Some(number - 1),
            _ => None,
        }
    }
}

impl fmt::Display for PinDescriptor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.has_module() {
            return f.write_str("I/O");
        }
        match self.secondary.name() {
            Some(name) => f.write_str(name)?,
            None => write!(f, "module {:02X}", self.secondary.0)?,
        }
        if self.unit == Self::GLOBAL {
            f.write_str(" all")?;
        } else {
            write!(f, " {}", self.unit)?;
        }
        match role(self.secondary, self.secondary_pin) {
            Some(name) => write!(f, " {name}"),
            None => write!(f, " pin {:02X}", self.secondary_pin),
        }
    }
}

/// Numbers as text, with ranges joined: `3, 5-9`. The numbers must be in ascending order.
pub(crate) fn list_of(numbers: impl IntoIterator<Item = u16>) -> String {
    let mut text = String::new();
    let mut numbers = numbers.into_iter().peekable();
    while let Some(first) = numbers.next() {
        let mut last = first;
        while let Some(next) = numbers.next_if(|&next| next == last.saturating_add(1)) {
            last = next;
        }
        let separator = if text.is_empty() { "" } else { ", " };
        // Writing to a String cannot fail.
        let _ = match last - first {
            0 => write!(text, "{separator}{first}"),
            _ => write!(text, "{separator}{first}-{last}"),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    #[test]
    fn pins_print_what_they_are_for() {
        for (word, text, output) in [
            (0x0300_C182, "SSerial 0 TX1", true),
            (0x0300_C101, "SSerial 0 RX0", false),
            (0x0300_C193, "SSerial 0 TXEN2", true),
            (0x0301_C6A8, "SSerialB 1 /TXEN7", true),
            (0x0300_0C01, "MuxedEncoder 0 A", false),
            (0x0302_0C03, "MuxedEncoder 2 Index", false),
            (0x0300_0D81, "MuxSelect 0 Select0", true),
            (0x0304_0683, "PWM 4 /Enable", true),
            (0x0300_1E85, "InMux 0 Addr4", true),
            (0x0300_1E01, "InMux 0 Data", false),
            (0x0300_2301, "InM 0 In0", false),
            (0x0300_2320, "InM 0 In31", false),
            (0x0304_0581, "StepGen 4 Step", true),
            (0x0304_0582, "StepGen 4 Dir", true),
            (0x0304_0588, "StepGen 4 Table7", true),
            (0x0304_0509, "StepGen 4 Index", false),
            (0x0380_050A, "StepGen all Probe", false),
            (0x0300_0C06, "MuxedEncoder 0 SharedIndex", false),
            (0x0300_C118, "SSerial 0 pin 18", false),
            (0x4000_C482, "CPDrive 0 Low", true),
            (0x0300_C2D8, "Twiddler 0 IO23", true),
            (0x0300_C512, "DSAD 0 Compare-1", false),
            (0x0300_C381, "SSR 0 Out0", true),
            (0x0300_C3A0, "SSR 0 ACRef", true),
            (0x0380_1A83, "HM2DPLL all Timer1", true),
            (0x0300_9907, "module 99 0 pin 07", false),
            (0x0300_0000, "I/O", false),
        ] {
            let pin = PinDescriptor::parse(word);
            assert_eq!(pin.to_string(), text);
            assert_eq!(pin.is_output(), output, "{text}");
        }
    }

    #[test]
    fn neighbours_in_a_list_are_joined() {
        for (numbers, text) in [
            (&[][..], ""),
            (&[7], "7"),
            (&[0, 1], "0-1"),
            (&[0, 2, 3, 4, 9], "0, 2-4, 9"),
            (&[u16::MAX - 1, u16::MAX], "65534-65535"),
        ] {
            assert_eq!(list_of(numbers.iter().copied()), text);
        }
    }

    #[test]
    fn only_data_and_enable_pins_count_as_serial_channels() {
        let channel = |pin: u32| PinDescriptor::parse(0x0300_C100 | pin).sserial_channel();
        assert_eq!(channel(0x08), Some(7));
        assert_eq!(channel(0xA1), Some(0));
        assert_eq!(channel(0xB1), None);
        assert_eq!(channel(0x00), None);
        assert_eq!(PinDescriptor::parse(0x0300_0C01).sserial_channel(), None);
    }

    proptest! {
        #[test]
        fn any_word_prints(word: u32) {
            prop_assert!(!PinDescriptor::parse(word).to_string().is_empty());
        }
    }
}
