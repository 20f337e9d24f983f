//! Pin descriptors: what the firmware can do with each pin.

use super::Gtag;
use core::fmt;

/// What the firmware can do with one I/O pin besides plain I/O.
///
/// `Display` gives the function in words: `SSerial 0 TX1`, `MuxedEncoder 0 A`, `I/O`.
/// Numbers count from 0, as everywhere in HostMot2.
///
/// Source: FACTS 9.1, 13.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PinDescriptor {
    /// Which pin of the module it is; bit 7 is set where the module drives it.
    pub secondary_pin: u8,
    /// The module that can use it; [`Gtag::NONE`] if it is plain I/O only.
    pub secondary: Gtag,
    /// Which instance of the module; [`PinDescriptor::GLOBAL`] for all.
    pub unit: u8,
    /// What it is without the module: an I/O port.
    pub primary: Gtag,
}

impl PinDescriptor {
    /// The unit of pins that belong to all instances.
    pub const GLOBAL: u8 = 0x80;

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

    /// The word that [`parse`](Self::parse) reads.
    pub const fn to_word(self) -> u32 {
        u32::from_le_bytes([
            self.secondary_pin,
            self.secondary.0,
            self.unit,
            self.primary.0,
        ])
    }

    /// Whether a module can use the pin.
    pub const fn has_module(&self) -> bool {
        self.secondary.0 != Gtag::NONE.0
    }

    /// Whether the module drives the pin.
    pub const fn is_output(&self) -> bool {
        self.has_module() && self.secondary_pin & 0x80 != 0
    }

    /// Whether this is a pin of instance `unit` of module `gtag`.
    pub fn belongs_to(&self, gtag: Gtag, unit: u8) -> bool {
        self.secondary == gtag && self.unit == unit
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

    /// The name of the pin within its module, without number: `TX`, `A`, `/Enable`; and its
    /// number, if there are several. `None` where this crate knows no name.
    fn role(self) -> Option<(&'static str, Option<u8>)> {
        let pin = self.secondary_pin;
        let number = (pin & 0x7F).wrapping_sub(1);
        let one = |name| Some((name, None));
        let nth = |name| Some((name, Some(number)));
        match self.secondary {
            Gtag::SSERIAL | Gtag::SSERIAL_B => {
                let name = match pin & 0xF0 {
                    0x00 => "RX",
                    0x80 => "TX",
                    0x90 => "TXEN",
                    0xA0 => "/TXEN",
                    _ => return None,
                };
                self.sserial_channel().map(|channel| (name, Some(channel)))
            }
            Gtag::ENCODER | Gtag::MUXED_ENCODER | Gtag::MUXED_ENCODER_MIM => match pin & 0x7F {
                1 => one("A"),
                2 => one("B"),
                3 => one("Index"),
                4 => one("IndexMask"),
                5 => one("Probe"),
                _ => None,
            },
            Gtag::MUX_SELECT | Gtag::MUX_SELECT_MIM => nth("Select"),
            Gtag::PWM => match pin & 0x7F {
                1 => one("Out"),
                2 => one("Dir"),
                3 => one("/Enable"),
                _ => None,
            },
            Gtag::STEPGEN => match pin & 0x7F {
                1 => one("Step"),
                2 => one("Dir"),
                n => Some(("Table", Some(n.wrapping_sub(1)))),
            },
            Gtag::IN_MUX => match pin {
                0x81..=0x85 => nth("Addr"),
                0x01 => one("Data"),
                _ => None,
            },
            Gtag::IN_M => nth("In"),
            Gtag::OUT_M => nth("Out"),
            Gtag::SSR => match pin & 0x7F {
                0x20 => one("ACRef"),
                _ => nth("Out"),
            },
            Gtag::HM2DPLL => match pin & 0x7F {
                1 => one("Sync"),
                2 => one("Ref"),
                3..=6 => Some(("Timer", Some((pin & 0x7F) - 2))),
                _ => None,
            },
            Gtag::UART_TX | Gtag::PACKET_UART_TX => match pin & 0x7F {
                1 => one("TX"),
                2 => one("TXEN"),
                _ => None,
            },
            Gtag::UART_RX | Gtag::PACKET_UART_RX => match pin & 0x7F {
                1 => one("RX"),
                _ => None,
            },
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
        match self.role() {
            Some((name, Some(number))) => write!(f, " {name}{number}"),
            Some((name, None)) => write!(f, " {name}"),
            None => write!(f, " pin {:02X}", self.secondary_pin),
        }
    }
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
            (0x0300_C381, "SSR 0 Out0", true),
            (0x0300_C3A0, "SSR 0 ACRef", true),
            (0x0380_1A83, "HM2DPLL all Timer1", true),
            (0x0300_9907, "module 99 0 pin 07", false),
            (0x0300_0000, "I/O", false),
        ] {
            let pin = PinDescriptor::parse(word);
            assert_eq!(pin.to_string(), text);
            assert_eq!(pin.is_output(), output, "{text}");
            assert_eq!(pin.to_word(), word);
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
        fn any_word_prints_and_comes_back(word: u32) {
            let pin = PinDescriptor::parse(word);
            prop_assert!(!pin.to_string().is_empty());
            prop_assert_eq!(pin.to_word(), word);
        }
    }
}
