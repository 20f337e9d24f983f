//! The command word.

use super::Lbp16Error;

/// The most elements of one command.
pub const MAX_COUNT: u8 = 127;

const WRITE: u16 = 1 << 15;
const ADDRESS: u16 = 1 << 14;
const INFO: u16 = 1 << 13;
const SPACE_SHIFT: u32 = 10;
const SIZE_SHIFT: u32 = 8;
const INCREMENT: u16 = 1 << 7;
const COUNT_MASK: u16 = 0x7F;

/// One of the eight memory spaces.
///
/// Manual: 7I97, "7I97 SUPPORTED MEMORY SPACES".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Space {
    /// 0: HostMot2 registers, 32 bits.
    HostMot2 = 0,
    /// 1: registers of the Ethernet chip (KSZ8851-16), 16 bits.
    EthernetChip = 1,
    /// 2: EEPROM with MAC address, card name and IP address, 16 bits.
    Eeprom = 2,
    /// 3: the FPGA's configuration flash behind an address and a data register, 32 bits.
    Flash = 3,
    /// 4: timers, waiting, scratch registers, 16 bits.
    Timer = 4,
    /// 5: not used by any firmware known.
    Unused = 5,
    /// 6: status, control and error registers of the protocol itself, 16 bits.
    Control = 6,
    /// 7: card information, read only, 16 bits.
    ReadOnly = 7,
}

impl Space {
    /// All spaces, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::HostMot2,
        Self::EthernetChip,
        Self::Eeprom,
        Self::Flash,
        Self::Timer,
        Self::Unused,
        Self::Control,
        Self::ReadOnly,
    ];

    /// The space of the lowest three bits of `bits`.
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 7 {
            0 => Self::HostMot2,
            1 => Self::EthernetChip,
            2 => Self::Eeprom,
            3 => Self::Flash,
            4 => Self::Timer,
            5 => Self::Unused,
            6 => Self::Control,
            _ => Self::ReadOnly,
        }
    }

    /// Its number, 0 to 7.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// The size in which its registers are read and written: 32 bits in spaces 0 and 3, 16 in the
    /// others.
    pub const fn element(self) -> ElementSize {
        match self {
            Self::HostMot2 | Self::Flash => ElementSize::Double,
            _ => ElementSize::Word,
        }
    }
}

/// Size of the elements that a command transfers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum ElementSize {
    /// 8 bits.
    Byte = 0,
    /// 16 bits.
    Word = 1,
    /// 32 bits.
    Double = 2,
    /// 64 bits.
    Quad = 3,
}

impl ElementSize {
    /// All sizes, smallest first.
    pub const ALL: [Self; 4] = [Self::Byte, Self::Word, Self::Double, Self::Quad];

    /// The size of the lowest two bits of `bits`.
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 3 {
            0 => Self::Byte,
            1 => Self::Word,
            2 => Self::Double,
            _ => Self::Quad,
        }
    }

    /// Bytes of one element: 1, 2, 4 or 8.
    pub const fn bytes(self) -> usize {
        1 << self as u8
    }
}

/// A command word, taken apart.
///
/// Manual: 7I97, "LBP16 COMMANDS".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "they are single bits on the wire"
)]
pub struct Command {
    /// The host writes; otherwise it reads.
    pub write: bool,
    /// An address follows; otherwise the space's address pointer is used.
    pub address: bool,
    /// The info area of the space is meant, not the space itself.
    pub info: bool,
    /// Which space.
    pub space: Space,
    /// Size of one element.
    pub size: ElementSize,
    /// The address pointer moves on by the size after every element.
    pub increment: bool,
    count: u8,
}

impl Command {
    /// A read of `count` elements of the space's own size, with address and increment.
    pub const fn read(space: Space, count: u8) -> Result<Self, Lbp16Error> {
        Self {
            write: false,
            address: true,
            info: false,
            space,
            size: space.element(),
            increment: true,
            count: 1,
        }
        .with_count(count)
    }

    /// A write of `count` elements of the space's own size, with address and increment.
    pub const fn write(space: Space, count: u8) -> Result<Self, Lbp16Error> {
        match Self::read(space, count) {
            Ok(command) => Ok(Self {
                write: true,
                ..command
            }),
            error => error,
        }
    }

    /// A read of `count` words of the info area of a space, with address and increment.
    pub const fn read_info(space: Space, count: u8) -> Result<Self, Lbp16Error> {
        match Self::read(space, count) {
            Ok(command) => Ok(Self {
                info: true,
                size: ElementSize::Word,
                ..command
            }),
            error => error,
        }
    }

    /// The same command for another number of elements, 1 to [`MAX_COUNT`].
    pub const fn with_count(self, count: u8) -> Result<Self, Lbp16Error> {
        match count {
            0 => Err(Lbp16Error::CountZero),
            1..=MAX_COUNT => Ok(Self { count, ..self }),
            _ => Err(Lbp16Error::CountTooLarge { count }),
        }
    }

    /// The same command without an address: it goes on where the address pointer stands.
    #[must_use]
    pub const fn at_pointer(self) -> Self {
        Self {
            address: false,
            ..self
        }
    }

    /// The same command with a standing address pointer, as data ports want it.
    #[must_use]
    pub const fn without_increment(self) -> Self {
        Self {
            increment: false,
            ..self
        }
    }

    /// The same command for elements of another size.
    #[must_use]
    pub const fn with_size(self, size: ElementSize) -> Self {
        Self { size, ..self }
    }

    /// Number of elements, 1 to 127.
    pub const fn count(&self) -> u8 {
        self.count
    }

    /// Bytes that are transferred: behind the command in a request, or in the reply.
    pub const fn data_len(&self) -> usize {
        self.count as usize * self.size.bytes()
    }

    /// Bytes that follow the command word in a request: address and data to be written.
    pub const fn request_len(&self) -> usize {
        let address = if self.address { 2 } else { 0 };
        let data = if self.write { self.data_len() } else { 0 };
        address + data
    }

    /// Takes a command word apart.
    pub const fn decode(word: u16) -> Result<Self, Lbp16Error> {
        Self {
            write: word & WRITE != 0,
            address: word & ADDRESS != 0,
            info: word & INFO != 0,
            space: Space::from_bits((word >> SPACE_SHIFT) as u8),
            size: ElementSize::from_bits((word >> SIZE_SHIFT) as u8),
            increment: word & INCREMENT != 0,
            count: 1,
        }
        .with_count((word & COUNT_MASK) as u8)
    }

    /// The command word.
    pub const fn encode(&self) -> u16 {
        const fn flag(set: bool, bit: u16) -> u16 {
            if set { bit } else { 0 }
        }
        flag(self.write, WRITE)
            | flag(self.address, ADDRESS)
            | flag(self.info, INFO)
            | (self.space as u16) << SPACE_SHIFT
            | (self.size as u16) << SIZE_SHIFT
            | flag(self.increment, INCREMENT)
            | self.count as u16
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wire(command: Command) -> [u8; 2] {
        command.encode().to_le_bytes()
    }

    #[test]
    fn commands_of_every_space_are_those_of_the_manual() {
        // Manual: 7I97, "SPACE 0: HOSTMOT2 REGISTERS" to "SPACE 7: LBP READ ONLY AREA": "read with address NNxxLLHH", "write with address",
        // "read", "write", for NN = 85: 5 elements with increment.
        let manual = [
            (Space::HostMot2, [0x42, 0xC2, 0x02, 0x82]),
            (Space::EthernetChip, [0x45, 0xC5, 0x05, 0x85]),
            (Space::Eeprom, [0x49, 0xC9, 0x09, 0x89]),
            (Space::Flash, [0x4E, 0xCE, 0x0E, 0x8E]),
            (Space::Timer, [0x51, 0xD1, 0x11, 0x91]),
            (Space::Control, [0x59, 0xD9, 0x19, 0x99]),
        ];
        for (space, [read, write, read_on, write_on]) in manual {
            let (r, w) = (
                Command::read(space, 5).unwrap(),
                Command::write(space, 5).unwrap(),
            );
            assert_eq!(wire(r), [0x85, read], "{space:?}");
            assert_eq!(wire(w), [0x85, write], "{space:?}");
            assert_eq!(wire(r.at_pointer()), [0x85, read_on], "{space:?}");
            assert_eq!(wire(w.at_pointer()), [0x85, write_on], "{space:?}");
        }
        let read = Command::read(Space::ReadOnly, 5).unwrap();
        assert_eq!(wire(read), [0x85, 0x5D]);
        assert_eq!(wire(read.at_pointer()), [0x85, 0x1D]);
    }

    #[test]
    fn commands_of_the_info_areas_are_those_of_the_manual() {
        // Manual: 7I97, "INFO_AREA ACCESS". Its table gives the size bits of space 3 as 16 bits,
        // as for all info areas.
        let manual = [
            (Space::HostMot2, 0x61, 0x21),
            (Space::EthernetChip, 0x65, 0x25),
            (Space::Eeprom, 0x69, 0x29),
            (Space::Flash, 0x6D, 0x2D),
            (Space::Control, 0x79, 0x39),
            (Space::ReadOnly, 0x7D, 0x3D),
        ];
        for (space, with_address, without) in manual {
            let read = Command::read_info(space, 8).unwrap();
            assert_eq!(wire(read), [0x88, with_address], "{space:?}");
            assert_eq!(wire(read.at_pointer()), [0x88, without], "{space:?}");
        }
    }

    #[test]
    fn zero_elements_are_an_error() {
        assert_eq!(Command::decode(0x4200), Err(Lbp16Error::CountZero));
        assert_eq!(Command::decode(0x4280), Err(Lbp16Error::CountZero));
        assert_eq!(
            Command::read(Space::HostMot2, 0),
            Err(Lbp16Error::CountZero)
        );
        assert_eq!(
            Command::write(Space::HostMot2, 128),
            Err(Lbp16Error::CountTooLarge { count: 128 })
        );
    }

    proptest! {
        #[test]
        fn every_command_word_is_refused_or_comes_back(word: u16) {
            match Command::decode(word) {
                Ok(command) => prop_assert_eq!(command.encode(), word),
                Err(error) => {
                    prop_assert_eq!(error, Lbp16Error::CountZero);
                    prop_assert_eq!(word & 0x7F, 0);
                }
            }
        }
    }
}
