//! The command word.

use core::fmt;

/// Maximum number of elements of one command.
pub const MAX_COUNT: u8 = 127;

const WRITE: u16 = 1 << 15;
const ADDRESS: u16 = 1 << 14;
const INFO: u16 = 1 << 13;
const SPACE_SHIFT: u32 = 10;
const SIZE_SHIFT: u32 = 8;
const INCREMENT: u16 = 1 << 7;
const COUNT_MASK: u8 = 0x7F;

/// A memory space, one of eight.
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

impl fmt::Display for Space {
    /// Number and name of the space: `2 (EEPROM)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", *self as u8, self.name())
    }
}

impl Space {
    /// The usual name of the space.
    pub const fn name(self) -> &'static str {
        match self {
            Self::HostMot2 => "HostMot2",
            Self::EthernetChip => "Ethernet chip",
            Self::Eeprom => "EEPROM",
            Self::Flash => "flash",
            Self::Timer => "timer",
            Self::Unused => "unused",
            Self::Control => "control",
            Self::ReadOnly => "read only",
        }
    }

    /// The space in the lowest three bits of `bits`.
    pub const fn from_bits(bits: u16) -> Self {
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

    /// Size of its registers: 32 bits in spaces 0 and 3, 16 bits in the others.
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
    /// The size in the lowest two bits of `bits`.
    pub const fn from_bits(bits: u16) -> Self {
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

/// A decoded command word.
///
/// Manual: 7I97, "LBP16 COMMANDS".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "they are single bits on the wire"
)]
pub struct Command {
    /// Set for a write, clear for a read.
    pub write: bool,
    /// An address follows; otherwise the address pointer of the space is used.
    pub address: bool,
    /// Addresses the info area of the space instead of the space itself.
    pub info: bool,
    /// The addressed space.
    pub space: Space,
    /// Size of one element.
    pub size: ElementSize,
    /// The address pointer advances by the size after every element. Data ports need it to stay.
    pub increment: bool,
    /// Number of elements. [`RequestBuilder`](super::RequestBuilder) and
    /// [`Operations`](super::Operations) accept 1 to [`MAX_COUNT`].
    pub count: u8,
}

impl Command {
    /// A read of `count` elements of the space's own size, with address and increment.
    pub const fn read(space: Space, count: u8) -> Self {
        Self {
            write: false,
            address: true,
            info: false,
            space,
            size: space.element(),
            increment: true,
            count,
        }
    }

    /// A write of `count` elements of the space's own size, with address and increment.
    pub const fn write(space: Space, count: u8) -> Self {
        Self {
            write: true,
            ..Self::read(space, count)
        }
    }

    /// A read of `count` words of the info area of a space, with address and increment.
    pub const fn read_info(space: Space, count: u8) -> Self {
        Self {
            info: true,
            size: ElementSize::Word,
            ..Self::read(space, count)
        }
    }

    /// The same without increment, for data ports.
    #[must_use]
    pub const fn standing(self) -> Self {
        Self {
            increment: false,
            ..self
        }
    }

    /// Bytes of data: after the command in a request, or in the reply.
    pub const fn data_len(&self) -> usize {
        (self.count as usize).saturating_mul(self.size.bytes())
    }

    /// Bytes of data after the command in a request: 0 for a read.
    pub(super) const fn written_len(self) -> usize {
        if self.write { self.data_len() } else { 0 }
    }

    /// Decodes a command word.
    pub const fn decode(word: u16) -> Self {
        Self {
            write: word & WRITE != 0,
            address: word & ADDRESS != 0,
            info: word & INFO != 0,
            space: Space::from_bits(word >> SPACE_SHIFT),
            size: ElementSize::from_bits(word >> SIZE_SHIFT),
            increment: word & INCREMENT != 0,
            count: word as u8 & COUNT_MASK,
        }
    }

    /// Encodes the command word.
    pub const fn encode(&self) -> u16 {
        flag(self.write, WRITE)
            | flag(self.address, ADDRESS)
            | flag(self.info, INFO)
            | (self.space as u16) << SPACE_SHIFT
            | (self.size as u16) << SIZE_SHIFT
            | flag(self.increment, INCREMENT)
            | (self.count & COUNT_MASK) as u16
    }
}

const fn flag(is_set: bool, bit: u16) -> u16 {
    if is_set { bit } else { 0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wire(command: Command) -> [u8; 2] {
        command.encode().to_le_bytes()
    }

    fn at_pointer(command: Command) -> Command {
        Command {
            address: false,
            ..command
        }
    }

    #[test]
    fn commands_of_every_space_are_those_of_the_manual() {
        // Manual: 7I97, "SPACE 0: HOSTMOT2 REGISTERS" to "SPACE 7: LBP READ ONLY AREA": "read with
        // address NNxxLLHH", "write with address", "read", "write", for NN = 85: 5 elements with
        // increment.
        let manual = [
            (Space::HostMot2, [0x42, 0xC2, 0x02, 0x82]),
            (Space::EthernetChip, [0x45, 0xC5, 0x05, 0x85]),
            (Space::Eeprom, [0x49, 0xC9, 0x09, 0x89]),
            (Space::Flash, [0x4E, 0xCE, 0x0E, 0x8E]),
            (Space::Timer, [0x51, 0xD1, 0x11, 0x91]),
            (Space::Control, [0x59, 0xD9, 0x19, 0x99]),
        ];
        for (space, [read, write, read_on, write_on]) in manual {
            let (r, w) = (Command::read(space, 5), Command::write(space, 5));
            assert_eq!(wire(r), [0x85, read], "{space:?}");
            assert_eq!(wire(w), [0x85, write], "{space:?}");
            assert_eq!(wire(at_pointer(r)), [0x85, read_on], "{space:?}");
            assert_eq!(wire(at_pointer(w)), [0x85, write_on], "{space:?}");
        }
        let read = Command::read(Space::ReadOnly, 5);
        assert_eq!(wire(read), [0x85, 0x5D]);
        assert_eq!(wire(at_pointer(read)), [0x85, 0x1D]);
    }

    #[test]
    fn commands_of_the_info_areas_are_those_of_the_manual() {
        // Manual: 7I97, "INFO_AREA ACCESS". Its table gives the size bits of space 3 as 16 bits, as
        // for all info areas.
        let manual = [
            (Space::HostMot2, 0x61, 0x21),
            (Space::EthernetChip, 0x65, 0x25),
            (Space::Eeprom, 0x69, 0x29),
            (Space::Flash, 0x6D, 0x2D),
            (Space::Control, 0x79, 0x39),
            (Space::ReadOnly, 0x7D, 0x3D),
        ];
        for (space, with_address, without) in manual {
            let read = Command::read_info(space, 8);
            assert_eq!(wire(read), [0x88, with_address], "{space:?}");
            assert_eq!(wire(at_pointer(read)), [0x88, without], "{space:?}");
        }
    }

    #[test]
    fn element_sizes_are_1_2_4_and_8_bytes() {
        let sizes = [0, 1, 2, 3].map(ElementSize::from_bits);
        assert_eq!(sizes.map(ElementSize::bytes), [1, 2, 4, 8]);
    }

    proptest! {
        #[test]
        fn every_command_word_comes_back(word: u16) {
            prop_assert_eq!(Command::decode(word).encode(), word);
        }
    }
}
