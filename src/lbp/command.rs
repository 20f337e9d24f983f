//! The command byte.

use super::{LocalRead, LocalWrite};

/// Number of data bytes of an access.
///
/// Manual: 7I77, "LBP DATA READ/WRITE COMMAND", bits 1..0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DataSize {
    /// 1 byte.
    Byte,
    /// 2 bytes.
    Word,
    /// 4 bytes.
    Long,
    /// 8 bytes.
    Double,
}

impl DataSize {
    /// All of them, smallest first.
    pub const ALL: [Self; 4] = [Self::Byte, Self::Word, Self::Long, Self::Double];

    /// Bytes: 1, 2, 4 or 8.
    pub const fn bytes(self) -> usize {
        1 << self.bits()
    }

    /// For 1, 2, 4 or 8 bytes.
    pub const fn from_bytes(bytes: usize) -> Option<Self> {
        Some(match bytes {
            1 => Self::Byte,
            2 => Self::Word,
            4 => Self::Long,
            8 => Self::Double,
            _ => return None,
        })
    }

    const fn bits(self) -> u8 {
        match self {
            Self::Byte => 0,
            Self::Word => 1,
            Self::Long => 2,
            Self::Double => 3,
        }
    }

    const fn from_bits(byte: u8) -> Self {
        match byte & 3 {
            0 => Self::Byte,
            1 => Self::Word,
            2 => Self::Long,
            _ => Self::Double,
        }
    }
}

/// A read or write of the remote's memory: command bytes 40..7F.
///
/// Manual: 7I77, "LBP DATA READ/WRITE COMMAND".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(
    clippy::struct_excessive_bools,
    reason = "they are the bits of the command byte"
)]
pub struct Access {
    /// Write instead of read (bit 5).
    pub write: bool,
    /// In an RPC list: the data is in the list, not in the stream (bit 4, RID).
    pub rpc_includes_data: bool,
    /// The address is incremented by the data size afterwards (bit 3).
    pub auto_increment: bool,
    /// Two address bytes follow; else the current address is used (bit 2).
    pub with_address: bool,
    /// How much (bits 1..0).
    pub size: DataSize,
}

impl Access {
    /// A read with an address: 44..47.
    pub const fn read(size: DataSize) -> Self {
        Self {
            write: false,
            rpc_includes_data: false,
            auto_increment: false,
            with_address: true,
            size,
        }
    }

    /// A write with an address: 64..67.
    pub const fn write(size: DataSize) -> Self {
        Self {
            write: true,
            ..Self::read(size)
        }
    }

    /// The same, leaving the address behind the data.
    #[must_use]
    pub const fn incrementing(self) -> Self {
        Self {
            auto_increment: true,
            ..self
        }
    }

    /// The same at the current address.
    #[must_use]
    pub const fn at_current_address(self) -> Self {
        Self {
            with_address: false,
            ..self
        }
    }

    /// The same with its data in the RPC list.
    #[must_use]
    pub const fn with_included_data(self) -> Self {
        Self {
            rpc_includes_data: true,
            ..self
        }
    }

    /// From a command byte; `None` outside 40..7F.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        if byte & 0xC0 != 0x40 {
            return None;
        }
        Some(Self {
            write: byte & 0x20 != 0,
            rpc_includes_data: byte & 0x10 != 0,
            auto_increment: byte & 0x08 != 0,
            with_address: byte & 0x04 != 0,
            size: DataSize::from_bits(byte),
        })
    }

    /// The command byte.
    pub const fn to_byte(self) -> u8 {
        0x40 | (self.write as u8) << 5
            | (self.rpc_includes_data as u8) << 4
            | (self.auto_increment as u8) << 3
            | (self.with_address as u8) << 2
            | self.size.bits()
    }

    /// Address bytes that follow the command.
    pub const fn address_len(self) -> usize {
        if self.with_address { 2 } else { 0 }
    }

    /// Data bytes that follow the address.
    pub const fn data_len(self) -> usize {
        if self.write { self.size.bytes() } else { 0 }
    }

    /// Data bytes of the reply.
    pub const fn reply_len(self) -> usize {
        if self.write { 0 } else { self.size.bytes() }
    }
}

/// Number of an RPC, 0 to 63.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RpcNumber(u8);

impl RpcNumber {
    /// Command BB: RXSize, TXSize, PTOC, GTOC.
    ///
    /// FACTS 1.2: one section of the manual swaps it with the unit number RPC.
    pub const DISCOVERY: Self = Self(0x3B);
    /// Command BC: the unit number, 4 bytes.
    pub const UNIT_NUMBER: Self = Self(0x3C);
    /// Command BD: process data both ways, the fault byte first.
    pub const PROCESS_DATA: Self = Self(0x3D);

    /// `None` above 63.
    pub const fn new(number: u8) -> Option<Self> {
        if number < 64 {
            Some(Self(number))
        } else {
            None
        }
    }

    /// 0 to 63.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The command byte, 80..BF.
    pub const fn to_byte(self) -> u8 {
        0x80 | self.0
    }
}

/// A command byte, taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Command {
    /// 40..7F: reads or writes memory.
    Access(Access),
    /// 80..BF: a remote procedure call.
    Rpc(RpcNumber),
    /// C0..DF: reads one of the remote's own registers.
    LocalRead(LocalRead),
    /// E0..FF: writes one of the remote's own registers.
    LocalWrite(LocalWrite),
}

impl Command {
    /// From the byte on the wire; `None` for 00..3F, which is no command.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0x00..=0x3F => None,
            0x40..=0x7F => match Access::from_byte(byte) {
                Some(access) => Some(Self::Access(access)),
                None => None,
            },
            0x80..=0xBF => Some(Self::Rpc(RpcNumber(byte & 0x3F))),
            0xC0..=0xDF => match LocalRead::from_byte(byte) {
                Some(read) => Some(Self::LocalRead(read)),
                None => None,
            },
            0xE0..=0xFF => match LocalWrite::from_byte(byte) {
                Some(write) => Some(Self::LocalWrite(write)),
                None => None,
            },
        }
    }

    /// The byte on the wire.
    pub const fn to_byte(self) -> u8 {
        match self {
            Self::Access(access) => access.to_byte(),
            Self::Rpc(number) => number.to_byte(),
            Self::LocalRead(read) => read.to_byte(),
            Self::LocalWrite(write) => write.to_byte(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_byte_is_parsed_and_made_again() {
        for byte in 0..=0xFF_u8 {
            match Command::from_byte(byte) {
                Some(command) => assert_eq!(command.to_byte(), byte),
                None => assert!(byte < 0x40),
            }
        }
    }

    #[test]
    fn access_forms_have_the_bytes_that_real_clients_use() {
        // FACTS 1.4
        let bytes = |access: Access| DataSize::ALL.map(|size| Access { size, ..access }.to_byte());
        let read = Access::read(DataSize::Byte);
        let write = Access::write(DataSize::Byte);
        assert_eq!(bytes(read), [0x44, 0x45, 0x46, 0x47]);
        assert_eq!(bytes(read.incrementing()), [0x4C, 0x4D, 0x4E, 0x4F]);
        assert_eq!(bytes(read.at_current_address()), [0x40, 0x41, 0x42, 0x43]);
        let next = read.incrementing().at_current_address();
        assert_eq!(bytes(next), [0x48, 0x49, 0x4A, 0x4B]);
        assert_eq!(bytes(write), [0x64, 0x65, 0x66, 0x67]);
        assert_eq!(bytes(write.incrementing()), [0x6C, 0x6D, 0x6E, 0x6F]);
    }

    #[test]
    fn special_rpcs_have_their_command_bytes() {
        // FACTS 1.2
        assert_eq!(RpcNumber::DISCOVERY.to_byte(), 0xBB);
        assert_eq!(RpcNumber::UNIT_NUMBER.to_byte(), 0xBC);
        assert_eq!(RpcNumber::PROCESS_DATA.to_byte(), 0xBD);
        assert_eq!(RpcNumber::new(64), None);
    }
}
