//! The IDROM: identification of board and firmware.

use super::HostMot2Error;
use alloc::format;
use alloc::string::{String, ToString};

/// The words of one module descriptor.
pub(super) const MODULE_WORDS: usize = 3;

/// The eight characters in two words: not terminated, with arbitrary padding. Characters that are
/// not printable are escaped.
pub(super) fn name(low: u32, high: u32) -> String {
    let bytes = (u64::from(high) << 32 | u64::from(low)).to_le_bytes();
    bytes.escape_ascii().to_string()
}

/// The header of the IDROM.
///
/// Source: FACTS 9.1.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Idrom {
    /// 3, or 2 in old firmware.
    pub idrom_type: u32,
    /// From the start of the IDROM to the module descriptors, in bytes.
    pub offset_to_modules: u32,
    /// From the start of the IDROM to the pin descriptors, in bytes.
    pub offset_to_pins: u32,
    /// Name of the board: `MESA7I97`. Characters that are not printable are escaped.
    pub board_name: String,
    /// Size of the FPGA, in thousands of gates.
    pub fpga_size: u32,
    /// Pins of the FPGA's package.
    pub fpga_pins: u32,
    /// Number of I/O ports (connectors).
    pub io_ports: u32,
    /// Number of I/O pins of all ports.
    pub io_width: u32,
    /// Number of I/O pins of a port.
    pub port_width: u32,
    /// ClockLow in Hz.
    pub clock_low_hz: u32,
    /// ClockHigh in Hz.
    pub clock_high_hz: u32,
    /// The two distances of instances that modules choose from, in bytes.
    pub instance_strides: [u16; 2],
    /// The two distances of registers that modules choose from, in bytes.
    pub register_strides: [u16; 2],
}

/// The words of the header.
pub(super) const IDROM_WORDS: usize = 16;

/// The memory that an IDROM has in Mesa's public sources: 0400 to 07FF.
const IDROM_BYTES: u32 = 0x400;

/// Largest number of pins of a port: its registers have 32 bits.
const MAX_PORT_WIDTH: u32 = 32;

/// Largest number of pins of a board whose descriptors are read.
const MAX_PINS: u32 = 256;

/// Size of the FPGA of a 7I96S; that of a 7I96 is 9.
const FPGA_7I96S: u32 = 20;

/// Slowest clock that is plausible.
const SLOWEST_CLOCK_HZ: u32 = 1_000_000;

impl Idrom {
    /// Parses the header.
    pub(super) fn parse(words: [u32; IDROM_WORDS]) -> Result<Self, HostMot2Error> {
        let bad = HostMot2Error::description;
        let idrom_type = words[0];
        if !matches!(idrom_type, 2 | 3) {
            return Err(bad("IDROM type", idrom_type.to_string(), "3 or 2"));
        }
        let stride = |word: u32| {
            u16::try_from(word)
                .map_err(|_| bad("stride", format!("{word:#X}"), "at most 0xFFFF bytes"))
        };
        let idrom = Self {
            idrom_type,
            offset_to_modules: words[1],
            offset_to_pins: words[2],
            board_name: name(words[3], words[4]),
            fpga_size: words[5],
            fpga_pins: words[6],
            io_ports: words[7],
            io_width: words[8],
            port_width: words[9],
            clock_low_hz: words[10],
            clock_high_hz: words[11],
            instance_strides: [stride(words[12])?, stride(words[13])?],
            register_strides: [stride(words[14])?, stride(words[15])?],
        };
        let (ports, width, pins) = (idrom.io_ports, idrom.port_width, idrom.io_width);
        let fits = (1..=MAX_PORT_WIDTH).contains(&width) && (1..=MAX_PINS).contains(&pins);
        if !fits || ports.checked_mul(width) != Some(pins) {
            let found = format!("{ports} ports of {width} pins, {pins} pins in all");
            let expected = "their product, 1 to 32 pins a port and 1 to 256 in all";
            return Err(bad("I/O ports", found, expected));
        }
        for (clock, hz) in [
            ("ClockLow", idrom.clock_low_hz),
            ("ClockHigh", idrom.clock_high_hz),
        ] {
            if hz < SLOWEST_CLOCK_HZ {
                return Err(bad(clock, format!("{hz} Hz"), "at least 1 MHz"));
            }
        }
        Ok(idrom)
    }

    /// True if the board is a 7I97T, which has the board name of a 7I97 but another FPGA and
    /// address jumpers with another meaning. FACTS 9.6.
    pub fn is_7i97t(&self) -> bool {
        (self.board().as_str(), self.fpga_size, self.clock_high_hz) == ("7i97", 20, 160_000_000)
    }

    /// Slots of module descriptors: `most`, or fewer if the pin descriptors begin before their end.
    pub(super) fn module_slots(&self, most: usize) -> usize {
        const BYTES: u32 = 4 * MODULE_WORDS as u32;
        let between = self.offset_to_pins.checked_sub(self.offset_to_modules);
        between.map_or(most, |bytes| most.min((bytes / BYTES) as usize))
    }

    /// Slots of pin descriptors up to the end of the IDROM's memory, including those of local I/O
    /// pins.
    pub(super) fn pin_slots(&self) -> usize {
        (IDROM_BYTES.saturating_sub(self.offset_to_pins) / 4) as usize
    }

    /// The board's name in lower case, as used in pin names: the part before the first character
    /// that is not printable, without `MESA`, for example `7i97` for `MESA7I97`.
    ///
    /// Two boards carry the name of another: a 7I96S has `MESA7I96`, and is distinguished by its
    /// FPGA size (20); a 7I76E has `MESA7I76`, the name of a card without an FPGA. This function
    /// returns the names of the boards themselves, as LinuxCNC has them.
    ///
    /// Source: FACTS 9.1; Mesa's public VHDL sources, `IDROMConst.vhd` (names of boards).
    pub fn board(&self) -> String {
        let name = &self.board_name;
        let name = name.strip_prefix("MESA").unwrap_or(name);
        let end = name.find([' ', '\\']).unwrap_or(name.len());
        let name = name.get(..end).unwrap_or(name).to_ascii_lowercase();
        match &*name {
            "7i96" if self.fpga_size == FPGA_7I96S => name + "s",
            "7i76" => name + "e",
            _ => name,
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// FACTS 9.1 and 9.2.
    pub(in super::super) const WORDS_7I97: [u32; IDROM_WORDS] = [
        3,
        0x40,
        0x1C0,
        u32::from_le_bytes(*b"MESA"),
        u32::from_le_bytes(*b"7I97"),
        9,
        144,
        3,
        51,
        17,
        100_000_000,
        200_000_000,
        4,
        0x40,
        0x100,
        0x100,
    ];

    pub(in super::super) fn idrom_7i97() -> Idrom {
        Idrom::parse(WORDS_7I97).unwrap()
    }

    fn with(index: usize, value: u32) -> Result<Idrom, HostMot2Error> {
        let mut words = WORDS_7I97;
        words[index] = value;
        Idrom::parse(words)
    }

    #[test]
    fn idrom_of_a_7i97_is_read_field_by_field() {
        let idrom = idrom_7i97();
        assert_eq!(idrom.board_name, "MESA7I97");
        assert_eq!(idrom.board(), "7i97");
        assert_eq!((idrom.fpga_size, idrom.fpga_pins), (9, 144));
        assert_eq!(
            (idrom.io_ports, idrom.port_width, idrom.io_width),
            (3, 17, 51)
        );
        assert_eq!(idrom.instance_strides, [4, 0x40]);
        assert_eq!(idrom.register_strides, [0x100, 0x100]);
    }

    #[test]
    fn type_2_is_accepted_and_no_other() {
        assert!(with(0, 2).is_ok());
        let error = with(0, 4).unwrap_err().to_string();
        assert!(
            error.starts_with("IDROM type: 4, expected 3 or 2"),
            "{error}"
        );
    }

    #[test]
    fn widths_must_multiply_and_clocks_be_a_megahertz() {
        let faults = [
            (
                8,
                52,
                "I/O ports: 3 ports of 17 pins, 52 pins in all, expected ",
            ),
            (7, u32::MAX, "I/O ports: 4294967295 ports of 17 pins, 51 "),
            (9, 0, "I/O ports: 3 ports of 0 pins, 51 "),
            (10, 999_999, "ClockLow: 999999 Hz, expected at least 1 MHz"),
            (11, 0, "ClockHigh: 0 Hz, "),
            (12, 0x1_0000, "stride: 0x10000, expected at most 0xFFFF "),
        ];
        for (index, value, text) in faults {
            let error = with(index, value).unwrap_err().to_string();
            assert!(error.starts_with(text), "{error}");
        }
    }

    #[test]
    fn names_that_are_not_text_are_shown_escaped() {
        let mut idrom = idrom_7i97();
        let [low, high] = [*b"7I92", *b"\0\0\xFF "].map(u32::from_le_bytes);
        idrom.board_name = name(low, high);
        assert_eq!(idrom.board_name, r"7I92\x00\x00\xff ");
        assert_eq!(idrom.board(), "7i92");
    }

    proptest! {
        #[test]
        fn any_words_make_an_idrom_with_bounded_widths_or_a_fault(words in any::<[u32; IDROM_WORDS]>()) {
            if let Ok(idrom) = Idrom::parse(words) {
                prop_assert!(idrom.io_width <= MAX_PINS);
            }
        }

        #[test]
        fn any_value_in_one_word_is_parsed_or_refused(index in 0..IDROM_WORDS, value: u32) {
            if let Ok(idrom) = with(index, value) {
                prop_assert_eq!(idrom.io_ports * idrom.port_width, idrom.io_width);
            }
        }
    }
}
