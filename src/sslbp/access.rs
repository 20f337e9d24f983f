//! Pass-through accesses to a remote: what they are as registers.

use core::fmt;

/// How much of a remote's memory one access moves.
///
/// Manual: 7I77, "LBP DATA READ/WRITE COMMAND".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum AccessSize {
    /// 1 byte.
    Byte,
    /// 2 bytes.
    Word,
    /// 4 bytes.
    Long,
    /// 8 bytes.
    Double,
}

impl AccessSize {
    /// Number of bytes.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::Byte => 1,
            Self::Word => 2,
            Self::Long => 4,
            Self::Double => 8,
        }
    }

    /// The smallest size that holds `bits` bits; `None` above 64 and for 0.
    pub const fn for_bits(bits: u8) -> Option<Self> {
        match bits {
            1..=8 => Some(Self::Byte),
            9..=16 => Some(Self::Word),
            17..=32 => Some(Self::Long),
            33..=64 => Some(Self::Double),
            _ => None,
        }
    }

    /// The bits of a value of this size.
    pub const fn mask(self) -> u64 {
        u64::MAX >> (64 - 8 * self.bytes() as u32)
    }

    const fn code(self) -> u8 {
        match self {
            Self::Byte => 0,
            Self::Word => 1,
            Self::Long => 2,
            Self::Double => 3,
        }
    }
}

/// A local location of a remote: read by C0 to DF, written by E0 to FF.
///
/// Manual: 7I77, "LOCAL LBP COMMANDS"; FACTS 1.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LocalLocation(u8);

impl LocalLocation {
    /// LBP status bits; writing 00 clears them.
    pub const STATUS: Self = Self(0x01);
    /// Software mode.
    pub const SOFTWARE_MODE: Self = Self(0x06);
    /// Writing FF clears faults; reads back non-zero until that is done.
    pub const CLEAR_FAULTS: Self = Self(0x07);
    /// Frame timeout in bit times.
    pub const FRAME_TIMEOUT: Self = Self(0x0B);
    /// Which memory the read and write commands address: see [`NonvolatileMemory`].
    pub const NONVOLATILE: Self = Self(0x0C);
    /// First character of the name; the other three follow.
    pub const NAME: Self = Self(0x10);
    /// Fault byte.
    pub const FAULTS: Self = Self(0x17);
    /// Always 5A.
    pub const COOKIE: Self = Self(0x1F);

    /// Location `index`; `None` above 1F.
    pub const fn new(index: u8) -> Option<Self> {
        if index < 0x20 {
            Some(Self(index))
        } else {
            None
        }
    }

    /// Its number, 0 to 1F.
    pub const fn index(self) -> u8 {
        self.0
    }
}

/// The memory that survives a power cycle of the remote.
///
/// FACTS 1.3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NonvolatileMemory {
    /// Parameters are here.
    #[default]
    Eeprom,
    /// Its firmware is here.
    Flash,
}

impl NonvolatileMemory {
    /// What selects it at [`LocalLocation::NONVOLATILE`]; 0 deselects it.
    pub const fn code(self) -> u8 {
        match self {
            Self::Eeprom => 1,
            Self::Flash => 2,
        }
    }
}

/// One access to a remote in setup mode.
///
/// Manual: 7I77, "REMOTE READ EXAMPLE", "REMOTE WRITE EXAMPLE"; FACTS 6.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RemoteAccess {
    /// Read of memory.
    Read {
        /// Where.
        address: u16,
        /// How much.
        size: AccessSize,
    },
    /// Write of memory.
    Write {
        /// Where.
        address: u16,
        /// How much.
        size: AccessSize,
        /// What, right-justified.
        value: u64,
    },
    /// Read of a local location.
    ReadLocal(LocalLocation),
    /// Write of a local location.
    WriteLocal(LocalLocation, u8),
}

impl RemoteAccess {
    /// The word for CS: the LBP command in the top byte, the address in the low word.
    pub const fn cs_word(self) -> u32 {
        match self {
            Self::Read { address, size } => command_word(0x44 | size.code(), address),
            Self::Write { address, size, .. } => command_word(0x64 | size.code(), address),
            Self::ReadLocal(location) => command_word(0xC0 | location.index(), 0),
            Self::WriteLocal(location, _) => command_word(0xE0 | location.index(), 0),
        }
    }

    /// The words for interface registers 0 and 1, if it writes.
    pub const fn data_words(self) -> Option<[u32; 2]> {
        match self {
            Self::Write { size, value, .. } => {
                let value = value & size.mask();
                Some([value as u32, (value >> 32) as u32])
            }
            Self::WriteLocal(_, value) => Some([value as u32, 0]),
            Self::Read { .. } | Self::ReadLocal(_) => None,
        }
    }

    /// The value that interface registers 0 and 1 hold after a read.
    pub const fn value(self, words: [u32; 2]) -> u64 {
        let [low, high] = words;
        let value = (high as u64) << 32 | low as u64;
        match self {
            Self::Read { size, .. } | Self::Write { size, .. } => value & size.mask(),
            Self::ReadLocal(_) | Self::WriteLocal(..) => value & 0xFF,
        }
    }

    /// Characters on the line, both ways, without the remote's own time.
    pub const fn characters(self) -> u32 {
        match self {
            // command, address and CRC; then the data, and the other CRC
            Self::Read { size, .. } | Self::Write { size, .. } => 4 + size.bytes() as u32 + 1,
            // command and CRC; then a byte, and the other CRC
            Self::ReadLocal(_) | Self::WriteLocal(..) => 2 + 1 + 1,
        }
    }
}

const fn command_word(command: u8, address: u16) -> u32 {
    (command as u32) << 24 | address as u32
}

impl fmt::Display for RemoteAccess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { address, size } => {
                write!(f, "read of {} bytes at {address:#06X}", size.bytes())
            }
            Self::Write { address, size, .. } => {
                write!(f, "write of {} bytes at {address:#06X}", size.bytes())
            }
            Self::ReadLocal(location) => write!(f, "local read {:02X}", 0xC0 | location.index()),
            Self::WriteLocal(location, value) => {
                write!(f, "local write {:02X} {value:02X}", 0xE0 | location.index())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    const SIZES: [AccessSize; 4] = [
        AccessSize::Byte,
        AccessSize::Word,
        AccessSize::Long,
        AccessSize::Double,
    ];

    fn read(address: u16, size: AccessSize) -> RemoteAccess {
        RemoteAccess::Read { address, size }
    }

    /// Manual: 7I77, "REMOTE READ EXAMPLE" (45, and 44, 46, 47 for the other sizes), "REMOTE WRITE
    /// EXAMPLE" (65, and 64, 66, 67).
    #[test]
    fn commands_are_those_of_the_manual() {
        let reads = SIZES.map(|size| read(0x1234, size).cs_word());
        assert_eq!(reads, [0x4400_1234, 0x4500_1234, 0x4600_1234, 0x4700_1234]);
        let writes = SIZES.map(|size| {
            let (address, value) = (0x1234, 0);
            RemoteAccess::Write {
                address,
                size,
                value,
            }
            .cs_word()
        });
        assert_eq!(writes, [0x6400_1234, 0x6500_1234, 0x6600_1234, 0x6700_1234]);
    }

    /// Gateware transcript t05.
    #[test]
    fn recorded_accesses_have_these_words() {
        let write = RemoteAccess::Write {
            address: 0x308,
            size: AccessSize::Double,
            value: 0xFEDC_BA98_89AB_CDEF,
        };
        assert_eq!(write.cs_word(), 0x6700_0308);
        assert_eq!(write.data_words(), Some([0x89AB_CDEF, 0xFEDC_BA98]));
        assert_eq!(
            read(0x308, AccessSize::Double).value([0x89AB_CDEF, 0xFEDC_BA98]),
            0xFEDC_BA98_89AB_CDEF
        );
        assert_eq!(
            RemoteAccess::ReadLocal(LocalLocation::COOKIE).cs_word(),
            0xDF00_0000
        );
        assert_eq!(
            RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 1).cs_word(),
            0xEC00_0000
        );
    }

    /// Gateware transcript t05: a read of eight bytes has 4 + 9 characters.
    #[test]
    fn characters_on_the_line_are_counted_with_their_crc() {
        assert_eq!(read(0x200, AccessSize::Double).characters(), 13);
        assert_eq!(
            RemoteAccess::ReadLocal(LocalLocation::COOKIE).characters(),
            4
        );
    }

    #[test]
    fn an_access_says_what_it_is() {
        assert_eq!(
            read(0x49A, AccessSize::Word).to_string(),
            "read of 2 bytes at 0x049A"
        );
        assert_eq!(
            RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 1).to_string(),
            "local write EC 01"
        );
    }

    proptest! {
        #[test]
        fn no_access_is_one_that_the_gateware_rejects(address: u16, value: u64, index in 0u8..64) {
            let mut accesses = std::vec::Vec::new();
            for size in SIZES {
                accesses.push(read(address, size));
                accesses.push(RemoteAccess::Write { address, size, value });
            }
            if let Some(location) = LocalLocation::new(index) {
                accesses.push(RemoteAccess::ReadLocal(location));
                accesses.push(RemoteAccess::WriteLocal(location, value as u8));
            }
            for access in accesses {
                prop_assert_ne!(access.cs_word() & 0x4000_0000, 0);
            }
        }

        #[test]
        fn a_value_comes_back_as_it_was_written(address: u16, value: u64, n in 0usize..4) {
            let size = SIZES[n];
            let write = RemoteAccess::Write { address, size, value };
            let words = write.data_words().unwrap();
            prop_assert_eq!(read(address, size).value(words), value & size.mask());
        }
    }
}
