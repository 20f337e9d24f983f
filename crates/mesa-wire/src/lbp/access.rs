//! Accesses of a host to a remote's memory and to its local locations.

use core::fmt;

/// Number of bytes that one access to a remote's memory moves.
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
    /// Number of bytes: 1, 2, 4 or 8.
    pub const fn bytes(self) -> u8 {
        1 << self as u8
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

    /// Mask of the bits of a value of this size.
    pub const fn mask(self) -> u64 {
        match self {
            Self::Byte => u8::MAX as u64,
            Self::Word => u16::MAX as u64,
            Self::Long => u32::MAX as u64,
            Self::Double => u64::MAX,
        }
    }
}

impl fmt::Display for AccessSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.bytes() {
            1 => f.write_str("1 byte"),
            bytes => write!(f, "{bytes} bytes"),
        }
    }
}

/// A local location of a remote, one byte: read by C0 to DF, written by E0 to FF. A location that
/// the manual calls reserved reads as 0, and a write does not change it.
///
/// Manual: 7I77, "LOCAL LBP READ COMMANDS", "LOCAL LBP WRITE COMMANDS"; FACTS 1.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LocalLocation(u8);

impl LocalLocation {
    /// Unit address (read).
    pub const UNIT_ADDRESS: Self = Self(0x00);
    /// [`LbpStatus`](super::LbpStatus); writing 00 clears it.
    pub const STATUS: Self = Self(0x01);
    /// Non-zero if CRCs are checked; always on a 7I77.
    pub const CRC_ENABLE: Self = Self(0x02);
    /// Number of CRC errors.
    pub const CRC_ERROR_COUNT: Self = Self(0x03);
    /// Software mode.
    pub const SOFTWARE_MODE: Self = Self(0x06);
    /// Writing FF clears faults; reads as non-zero until the remote has done so.
    pub const CLEAR_FAULTS: Self = Self(0x07);
    /// Non-zero: accesses reach the RPC table instead of the memory.
    pub const RPC_MEMORY_ACCESS: Self = Self(0x0A);
    /// Frame timeout in bit times.
    pub const FRAME_TIMEOUT: Self = Self(0x0B);
    /// Selects the memory that the read and write commands address: see [`NonvolatileMemory`].
    pub const NONVOLATILE: Self = Self(0x0C);
    /// First character of the name; the other three follow (read).
    pub const NAME: Self = Self(0x10);
    /// [`Capabilities`](super::Capabilities) (read).
    pub const CAPABILITIES: Self = Self(0x14);
    /// Software revision (read).
    pub const SOFTWARE_REVISION: Self = Self(0x15);
    /// Hardware mode (read).
    pub const HARDWARE_MODE: Self = Self(0x16);
    /// The fault byte, [`RemoteFaults`](super::RemoteFaults) (read).
    pub const FAULTS: Self = Self(0x17);
    /// LEDs (write).
    pub const LEDS: Self = Self(0x17);
    /// Low byte of the current address.
    pub const ADDRESS_LOW: Self = Self(0x18);
    /// High byte of the current address.
    pub const ADDRESS_HIGH: Self = Self(0x19);
    /// Version of LBP (read).
    pub const LBP_VERSION: Self = Self(0x1A);
    /// Adds the byte to the current address (write).
    pub const ADDRESS_ADD: Self = Self(0x1A);
    /// Unit ID of a serial remote (read).
    pub const UNIT_ID: Self = Self(0x1B);
    /// Distance in bytes from one list of the RPC table to the next (read).
    pub const RPC_PITCH: Self = Self(0x1C);
    /// Low byte of the size of the RPC table (read).
    pub const RPC_SIZE_LOW: Self = Self(0x1D);
    /// Sets the unit ID of a serial remote (write).
    pub const SET_UNIT_ID: Self = Self(0x1D);
    /// High byte of the size of the RPC table (read).
    pub const RPC_SIZE_HIGH: Self = Self(0x1E);
    /// Writing 5A resets the remote's processor (write).
    pub const RESET_PROCESSOR: Self = Self(0x1E);
    /// [`COOKIE`](super::COOKIE) (read).
    pub const COOKIE: Self = Self(0x1F);
    /// Resets the remote's parser; the only write without data.
    pub const RESET_PARSER: Self = Self(0x1F);

    /// The location `index`; `None` above 1F.
    pub const fn new(index: u8) -> Option<Self> {
        if index < 0x20 {
            Some(Self(index))
        } else {
            None
        }
    }

    /// Index of the location, 0 to 1F.
    pub const fn index(self) -> u8 {
        self.0
    }
}

/// Non-volatile memory of the remote, with the code that selects it at
/// [`LocalLocation::NONVOLATILE`], where 0 deselects it.
///
/// FACTS 1.3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NonvolatileMemory {
    /// EEPROM, with the parameters.
    #[default]
    Eeprom = 1,
    /// Flash, with the firmware: see [`flash`](super::flash).
    Flash = 2,
}

/// One access to a remote in setup mode.
///
/// Manual: 7I77, "LBP DATA READ/WRITE COMMAND", "LOCAL LBP COMMANDS"; FACTS 1.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RemoteAccess {
    /// Read of memory.
    Read {
        /// Address in the memory.
        address: u16,
        /// Size of the value.
        size: AccessSize,
    },
    /// Write of memory.
    Write {
        /// Address in the memory.
        address: u16,
        /// Size of the value.
        size: AccessSize,
        /// The value, right-justified.
        value: u64,
    },
    /// Read of a local location.
    ReadLocal(LocalLocation),
    /// Write of a local location.
    WriteLocal(LocalLocation, u8),
}

impl RemoteAccess {
    /// The command byte: 44 to 47, 64 to 67, C0 to FF.
    pub const fn command(self) -> u8 {
        match self {
            Self::Read { size, .. } => 0x44 | size as u8,
            Self::Write { size, .. } => 0x64 | size as u8,
            Self::ReadLocal(location) => 0xC0 | location.index(),
            Self::WriteLocal(location, _) => 0xE0 | location.index(),
        }
    }

    /// The value that it writes, right-justified; `None` for a read.
    pub const fn written(self) -> Option<u64> {
        match self {
            Self::Write { size, value, .. } => Some(value & size.mask()),
            Self::WriteLocal(_, value) => Some(value as u64),
            Self::Read { .. } | Self::ReadLocal(_) => None,
        }
    }

    /// A read of the same location.
    #[must_use]
    pub const fn read_back(self) -> Self {
        match self {
            Self::Write { address, size, .. } => Self::Read { address, size },
            Self::WriteLocal(location, _) => Self::ReadLocal(location),
            read => read,
        }
    }

    /// Characters on the line in both directions, the remote's processing time not included.
    pub const fn characters(self) -> u32 {
        match self {
            // Command, address and CRC; then the data and the other CRC.
            Self::Read { size, .. } | Self::Write { size, .. } => {
                (size.bytes() as u32).saturating_add(4 + 1)
            }
            // Command and CRC; then a byte and the other CRC.
            Self::ReadLocal(_) | Self::WriteLocal(..) => 2 + 1 + 1,
        }
    }
}

impl fmt::Display for RemoteAccess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { address, size } => {
                write!(f, "read of {size} at {address:#06X}")
            }
            Self::Write { address, size, .. } => {
                write!(f, "write of {size} at {address:#06X}")
            }
            Self::ReadLocal(_) => write!(f, "local read {:02X}", self.command()),
            Self::WriteLocal(_, value) => {
                write!(f, "local write {:02X} {value:02X}", self.command())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    fn read(address: u16, size: AccessSize) -> RemoteAccess {
        RemoteAccess::Read { address, size }
    }

    /// Gateware transcript t05: a read of eight bytes takes 4 + 9 characters.
    #[test]
    fn characters_on_the_line_are_counted_with_their_crc() {
        assert_eq!(read(0x200, AccessSize::Double).characters(), 13);
        assert_eq!(
            RemoteAccess::ReadLocal(LocalLocation::COOKIE).characters(),
            4
        );
    }

    #[test]
    fn access_displays_its_kind_size_and_address() {
        assert_eq!(
            read(0x49A, AccessSize::Word).to_string(),
            "read of 2 bytes at 0x049A"
        );
        assert_eq!(
            read(0x49A, AccessSize::Byte).to_string(),
            "read of 1 byte at 0x049A"
        );
        assert_eq!(
            RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 1).to_string(),
            "local write EC 01"
        );
    }
}
