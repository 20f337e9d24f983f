//! Pin descriptors: what the firmware can do with each pin.

use super::Gtag;
use alloc::format;
use alloc::string::{String, ToString};
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
    /// Which instance of the module; 0x80 for all.
    pub unit: u8,
    /// What it is without the module: an I/O port.
    pub primary: Gtag,
}

impl PinDescriptor {
    /// The unit of pins that belong to all instances.
    const GLOBAL: u8 = 0x80;

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

    /// Whether a module can use the pin.
    pub const fn has_module(&self) -> bool {
        self.secondary.0 != Gtag::NONE.0
    }

    /// Whether the module drives the pin.
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

    /// The name of the pin within its module: `TX0`, `A`, `/Enable`. `None` where this crate knows no
    /// name.
    fn role(self) -> Option<String> {
        // Pins of a module are numbered from 1 on.
        let pin = self.secondary_pin & 0x7F;
        let nth = |stem, number: u8| Some(format!("{stem}{number}"));
        let names: &[&str] = match self.secondary {
            Gtag::SSERIAL | Gtag::SSERIAL_B => {
                let channel = self.sserial_channel()?;
                return nth(
                    match self.secondary_pin & 0xF0 {
                        0x00 => "RX",
                        0x80 => "TX",
                        0x90 => "TXEN",
                        _ => "/TXEN",
                    },
                    channel,
                );
            }
            Gtag::MUX_SELECT | Gtag::MUX_SELECT_MIM => return nth("Select", pin.wrapping_sub(1)),
            Gtag::IN_M => return nth("In", pin.wrapping_sub(1)),
            Gtag::SSR if pin == 0x20 => return Some("ACRef".to_string()),
            Gtag::SSR | Gtag::OUT_M => return nth("Out", pin.wrapping_sub(1)),
            Gtag::STEPGEN if pin > 2 => return nth("Table", pin - 1),
            Gtag::STEPGEN => &["Step", "Dir"],
            Gtag::IN_MUX if self.is_output() => &["Addr0", "Addr1", "Addr2", "Addr3", "Addr4"],
            Gtag::IN_MUX => &["Data"],
            Gtag::ENCODER | Gtag::MUXED_ENCODER | Gtag::MUXED_ENCODER_MIM => {
                &["A", "B", "Index", "IndexMask", "Probe"]
            }
            Gtag::PWM => &["Out", "Dir", "/Enable"],
            Gtag::HM2DPLL => &["Sync", "Ref", "Timer1", "Timer2", "Timer3", "Timer4"],
            Gtag::UART_TX | Gtag::PACKET_UART_TX => &["TX", "TXEN"],
            Gtag::UART_RX | Gtag::PACKET_UART_RX => &["RX"],
            _ => return None,
        };
        let name = names.get(usize::from(pin).checked_sub(1)?)?;
        Some((*name).to_string())
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
            Some(name) => write!(f, " {name}"),
            None => write!(f, " pin {:02X}", self.secondary_pin),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
