//! An FPGA from the identity memory of a firmware.

use std::collections::BTreeMap;

use super::firmware::{
    COOKIE, COOKIE_ADDRESS, IDROM_ADDRESS, IDROM_WORDS, SimFirmware, SimModuleDescriptor,
    SimPinDescriptor,
};
use super::{Fabric, SimFpga, UNDRIVEN};
use crate::modules::{Configuration, SimModule};
use crate::sslbp::MINOR_REVISION;

/// The identity memory of a firmware: cookie and name at 0100, and the IDROM at 0400, as a host
/// reads them.
///
/// The text form has a line `ADDR VALUE` for each word, both hexadecimal, byte address and 32-bit
/// word; missing words are 0. Lines that begin with `#` are comments.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FirmwareImage {
    words: BTreeMap<u16, u32>,
}

/// A text that is not the identity memory of a firmware.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FirmwareImageError {
    /// A line is not a word.
    #[error("line {line}: `{text}`, expected ADDR VALUE, both hexadecimal, ADDR a multiple of 4")]
    Line {
        /// The line, counted from 1.
        line: usize,
        /// Its text.
        text: String,
    },
    /// A word is not valid in an identity memory.
    #[error("the word at {address:#06X} is {found:#010X}, expected {expected}")]
    Word {
        /// Its address.
        address: u16,
        /// The word found.
        found: u32,
        /// The expected word.
        expected: &'static str,
    },
}

/// Descriptors after the end of the list, each with its slot.
type BehindEnd = Vec<(u8, SimModuleDescriptor)>;

/// The test of a word.
type Test = fn(u32) -> bool;

/// The rate of the encoders' multiplexer after configuration. FACTS 12.6.
const MUX_RATE: u32 = 11;

impl FirmwareImage {
    /// Parses the text form.
    ///
    /// # Errors
    /// [`FirmwareImageError::Line`].
    pub fn parse(text: &str) -> Result<Self, FirmwareImageError> {
        let mut words = BTreeMap::new();
        for (number, text) in (1..).zip(text.lines()) {
            let text = text.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let parse = || {
                let (address, value) = text.split_once(char::is_whitespace)?;
                let address = u16::from_str_radix(address, 16).ok()?;
                let value = u32::from_str_radix(value.trim(), 16).ok()?;
                address.is_multiple_of(4).then_some((address, value))
            };
            let word = parse().ok_or_else(|| FirmwareImageError::Line {
                line: number,
                text: text.into(),
            })?;
            words.extend([word]);
        }
        Ok(Self { words })
    }

    /// The word at an address.
    pub fn word(&self, address: u16) -> u32 {
        self.words.get(&address).copied().unwrap_or_default()
    }

    /// Decodes the described firmware.
    ///
    /// # Errors
    /// [`FirmwareImageError::Word`]: its cookie, the place of its IDROM, or its I/O ports.
    pub fn firmware(&self) -> Result<SimFirmware, FirmwareImageError> {
        self.check_header()?;
        let header = |n: u16| self.word(IDROM_ADDRESS + 4 * n);
        let (modules, pins) = (header(1), header(2));
        let (ports, port_width) = (header(7), header(9));
        let [b0, b1, b2, b3] = header(3).to_le_bytes();
        let [b4, b5, b6, b7] = header(4).to_le_bytes();
        let (modules, behind_end) = self.modules(modules as u16, pins as u16);
        Ok(SimFirmware {
            idrom_type: header(0),
            board: [b0, b1, b2, b3, b4, b5, b6, b7],
            fpga_size: header(5),
            fpga_pins: header(6),
            ports,
            port_width,
            clock_low: header(10),
            clock_high: header(11),
            mux_rate: MUX_RATE,
            starts_bitten: false,
            sslbp_minor: MINOR_REVISION,
            modules,
            behind_end,
            pins: self.pins(pins as u16, ports * port_width),
            // The image has their words; they are not simulated.
            local_pins: Vec::new(),
        })
    }

    /// Checks the words that the decoding depends on.
    fn check_header(&self) -> Result<(), FirmwareImageError> {
        let is_cookie: Test = |word| word == COOKIE;
        let is_usual: Test = |word| word == u32::from(IDROM_ADDRESS);
        let is_offset: Test = |word| word % 4 == 0 && word < 4 * IDROM_WORDS as u32;
        let rows = [
            (COOKIE_ADDRESS, is_cookie, "the cookie 0x55AACAFE"),
            (COOKIE_ADDRESS + 12, is_usual, "an IDROM at 0x0400"),
            (IDROM_ADDRESS + 4, is_offset, "an offset in the IDROM"),
            (IDROM_ADDRESS + 8, is_offset, "an offset in the IDROM"),
            (
                IDROM_ADDRESS + 28,
                |word| (1..=16).contains(&word),
                "1 to 16 I/O ports",
            ),
            (
                IDROM_ADDRESS + 36,
                |word| (1..=32).contains(&word),
                "1 to 32 pins a port",
            ),
        ];
        for (address, is_right, expected) in rows {
            let found = self.word(address);
            if !is_right(found) {
                return Err(FirmwareImageError::Word {
                    address,
                    found,
                    expected,
                });
            }
        }
        Ok(())
    }

    /// The module descriptors up to the first empty slot, and those after it with their slots.
    fn modules(&self, first: u16, pins: u16) -> (Vec<SimModuleDescriptor>, BehindEnd) {
        let slots = if pins > first {
            (pins - first) / 12
        } else {
            32
        };
        let (mut modules, mut behind) = (Vec::new(), Vec::new());
        let mut has_ended = false;
        for slot in 0..slots.min(32) {
            let word = |n: u16| self.word(IDROM_ADDRESS + first + 12 * slot + 4 * n);
            let [tag, version, clock, instances] = word(0).to_le_bytes();
            let [b0, b1, registers, strides] = word(1).to_le_bytes();
            has_ended |= tag == 0;
            let module = SimModuleDescriptor {
                gtag: tag,
                version,
                clock,
                instances,
                base: u16::from_le_bytes([b0, b1]),
                registers,
                strides,
                multiple: word(2),
            };
            match (has_ended, tag) {
                (false, _) => modules.push(module),
                (true, 0) => {}
                (true, _) => behind.push((slot as u8, module)),
            }
        }
        (modules, behind)
    }

    fn pins(&self, first: u16, count: u32) -> Vec<SimPinDescriptor> {
        let address = |n: u32| IDROM_ADDRESS + first + 4 * n as u16;
        let pins = (0..count).map(|n| self.word(address(n)).to_le_bytes());
        let pins = pins.map(|[pin, secondary, unit, primary]| SimPinDescriptor {
            primary,
            secondary,
            unit,
            pin,
        });
        pins.collect()
    }
}

impl SimFpga {
    /// An FPGA at power-up with the identity of an image, word for word. Modules that the simulator
    /// does not implement keep the words written to their registers, and return them to reads.
    ///
    /// # Errors
    /// [`FirmwareImageError`]: the image does not describe a firmware.
    pub fn from_image(image: &FirmwareImage) -> Result<Self, FirmwareImageError> {
        let mut fpga = Self::new(image.firmware()?);
        for n in 0..IDROM_WORDS as u16 {
            let address = IDROM_ADDRESS + 4 * n;
            fpga.override_rom(address, image.word(address));
        }
        for n in 0..4 {
            let address = COOKIE_ADDRESS + 4 * n;
            fpga.override_rom(address, image.word(address));
        }
        for gtag in fpga.fabric.modules.unsimulated() {
            fpga.add_module(gtag, Box::<PlainRegisters>::default());
        }
        Ok(fpga)
    }
}

/// A module of which only the addresses of the registers are known.
#[derive(Debug, Default)]
struct PlainRegisters {
    words: BTreeMap<(u8, u8), u32>,
}

impl SimModule for PlainRegisters {
    fn read(&mut self, _: &Fabric, register: u8, instance: u8) -> u32 {
        let word = self.words.get(&(register, instance));
        word.copied().unwrap_or(UNDRIVEN)
    }

    fn write(&mut self, _: &mut Fabric, register: u8, instance: u8, value: u32) {
        self.words.insert((register, instance), value);
    }

    fn reload(&mut self, _: &Configuration<'_>) {
        self.words.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# a board of 17 pins\n0100 55AACAFE\n010C 400\n0400 3\n0404 40\n0408 1C0\n\
        040C 4153454D\n0410 32394937\n041C 1\n0420 11\n0424 11\n0428 5F5E100\n042C BEBC200\n\
        0440 01010002\n0444 00030C00\n044C 0101001B\n0450 000A2000\n0454 1FF\n05C0 03001B81\n";

    #[test]
    fn image_is_read_back_word_for_word_with_its_modules() {
        let image = FirmwareImage::parse(TEXT).unwrap();
        let mut fpga = SimFpga::from_image(&image).unwrap();
        for address in (0x100..0x110).chain(0x400..0x800).step_by(4) {
            assert_eq!(
                fpga.read_register(address),
                image.word(address),
                "{address:04X}"
            );
        }
        // A UART is a set of registers that keep their words until a reload.
        assert_eq!(fpga.read_register(0x2000), UNDRIVEN);
        fpga.write_register(0x2000, 1234);
        assert_eq!(fpga.read_register(0x2000), 1234);
        fpga.reload();
        assert_eq!(fpga.read_register(0x2000), UNDRIVEN);
        assert_eq!(fpga.read_register(0x400), 3);
        fpga.write_register(0x0C00, 100);
        assert_eq!(fpga.read_register(0x0C00), 100, "the watchdog runs");
    }

    #[test]
    fn invalid_image_is_refused_with_the_line_or_address() {
        let at = |text: &str| FirmwareImage::parse(text).unwrap_err().to_string();
        assert!(at("0100 55AACAFE\nnothing").starts_with("line 2: `nothing`, "));
        assert!(at("0101 0").starts_with("line 1: "));
        for (address, word) in [
            (0x100, 1),
            (0x10C, 8),
            (0x404, 0x1000),
            (0x41C, 0),
            (0x424, 33),
        ] {
            let mut image = FirmwareImage::parse(TEXT).unwrap();
            image.words.insert(address, word);
            let error = image.firmware().unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("the word at {address:#06X} is ")),
                "{error}"
            );
        }
    }
}
