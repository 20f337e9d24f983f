//! The IDROM: what board and firmware this is.

use core::fmt;

/// Eight characters as the firmware has them: not terminated, padded with anything.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Name8(pub [u8; 8]);

impl Name8 {
    /// The name that two words hold.
    pub(super) fn from_words(low: u32, high: u32) -> Self {
        let mut bytes = [0; 8];
        for (place, byte) in bytes
            .iter_mut()
            .zip(low.to_le_bytes().into_iter().chain(high.to_le_bytes()))
        {
            *place = byte;
        }
        Self(bytes)
    }

    /// The name in lower case, as pin names use it: the part before the first character that is
    /// not printable, without `MESA`: `7i97` for `MESA7I97`.
    pub fn board(&self) -> impl fmt::Display + '_ {
        BoardName(self)
    }

    /// Whether [`board`](Self::board) is `name`, in upper or lower case.
    pub fn is_board(&self, name: &str) -> bool {
        let skip = if self.0.starts_with(b"MESA") { 4 } else { 0 };
        let own = self.printable().skip(skip).map(|c| c.to_ascii_lowercase());
        !name.is_empty() && own.eq(name.chars().map(|c| c.to_ascii_lowercase()))
    }

    fn printable(&self) -> impl Iterator<Item = char> + '_ {
        self.0
            .iter()
            .take_while(|byte| byte.is_ascii_graphic())
            .map(|&byte| byte as char)
    }
}

impl fmt::Display for Name8 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.escape_ascii().fmt(f)
    }
}

impl fmt::Debug for Name8 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{self}\"")
    }
}

struct BoardName<'a>(&'a Name8);

impl fmt::Display for BoardName<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let skip = if self.0.0.starts_with(b"MESA") { 4 } else { 0 };
        for character in self.0.printable().skip(skip) {
            write!(f, "{}", character.to_ascii_lowercase())?;
        }
        Ok(())
    }
}

/// The header of the IDROM.
///
/// Source: FACTS 9.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Idrom {
    /// 3, or 2 in old firmware.
    pub idrom_type: u32,
    /// From the start of the IDROM to the module descriptors, in bytes.
    pub offset_to_modules: u32,
    /// From the start of the IDROM to the pin descriptors, in bytes.
    pub offset_to_pins: u32,
    /// Name of the board: `MESA7I97`.
    pub board_name: Name8,
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
    /// The distances of instances that modules choose from, in bytes.
    pub instance_strides: [u16; 2],
    /// The distances of registers that modules choose from, in bytes.
    pub register_strides: [u16; 2],
}

/// The words of the header.
pub(super) const IDROM_WORDS: usize = 16;

/// The most pins of a port: its registers have 32 bits.
const MAX_PORT_WIDTH: u32 = 32;

/// The most pins of a board that the pin descriptors are read of.
pub(super) const MAX_PINS: u32 = 256;

/// The slowest clock that a firmware can have.
const SLOWEST_CLOCK_HZ: u32 = 1_000_000;

/// Why the words are no IDROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum IdromFault {
    Type(u32),
    Widths {
        ports: u32,
        port_width: u32,
        io_width: u32,
    },
    Clock {
        low: bool,
        hz: u32,
    },
    Stride(u32),
}

impl Idrom {
    /// Parses the header.
    pub(super) fn parse(words: [u32; IDROM_WORDS]) -> Result<Self, IdromFault> {
        let [
            idrom_type,
            offset_to_modules,
            offset_to_pins,
            name_low,
            name_high,
            fpga_size,
            fpga_pins,
            io_ports,
            io_width,
            port_width,
            clock_low_hz,
            clock_high_hz,
            instance_0,
            instance_1,
            register_0,
            register_1,
        ] = words;
        if !matches!(idrom_type, 2 | 3) {
            return Err(IdromFault::Type(idrom_type));
        }
        let fits = (1..=MAX_PORT_WIDTH).contains(&port_width) && (1..=MAX_PINS).contains(&io_width);
        if !fits || io_ports.checked_mul(port_width) != Some(io_width) {
            return Err(IdromFault::Widths {
                ports: io_ports,
                port_width,
                io_width,
            });
        }
        for (low, hz) in [(true, clock_low_hz), (false, clock_high_hz)] {
            if hz < SLOWEST_CLOCK_HZ {
                return Err(IdromFault::Clock { low, hz });
            }
        }
        let stride = |word| u16::try_from(word).map_err(|_| IdromFault::Stride(word));
        Ok(Self {
            idrom_type,
            offset_to_modules,
            offset_to_pins,
            board_name: Name8::from_words(name_low, name_high),
            fpga_size,
            fpga_pins,
            io_ports,
            io_width,
            port_width,
            clock_low_hz,
            clock_high_hz,
            instance_strides: [stride(instance_0)?, stride(instance_1)?],
            register_strides: [stride(register_0)?, stride(register_1)?],
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    /// FACTS 9.1 and 9.2.
    pub(in super::super) const WORDS_7I97: [u32; IDROM_WORDS] = [
        3,
        0x40,
        0x200,
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

    fn with(index: usize, value: u32) -> Result<Idrom, IdromFault> {
        let mut words = WORDS_7I97;
        words[index] = value;
        Idrom::parse(words)
    }

    #[test]
    fn the_idrom_of_a_7i97_is_read_field_by_field() {
        let idrom = idrom_7i97();
        assert_eq!(idrom.board_name.to_string(), "MESA7I97");
        assert_eq!(idrom.board_name.board().to_string(), "7i97");
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
        assert_eq!(with(0, 4), Err(IdromFault::Type(4)));
    }

    #[test]
    fn widths_must_multiply_and_clocks_be_a_megahertz() {
        let fault = |ports, port_width, io_width| {
            Err(IdromFault::Widths {
                ports,
                port_width,
                io_width,
            })
        };
        assert_eq!(with(8, 52), fault(3, 17, 52));
        assert_eq!(with(7, u32::MAX), fault(u32::MAX, 17, 51));
        assert_eq!(with(9, 0), fault(3, 0, 51));
        assert_eq!(
            with(10, 999_999),
            Err(IdromFault::Clock {
                low: true,
                hz: 999_999
            })
        );
        assert_eq!(with(11, 0), Err(IdromFault::Clock { low: false, hz: 0 }));
        assert_eq!(with(12, 0x1_0000), Err(IdromFault::Stride(0x1_0000)));
    }

    #[test]
    fn names_that_are_not_text_are_shown_escaped() {
        assert_eq!(Name8(*b"7I92\0\0\xFF ").to_string(), r"7I92\x00\x00\xff ");
        assert_eq!(Name8(*b"7I92\0\0\xFF ").board().to_string(), "7i92");
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
