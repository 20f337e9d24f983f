//! Local LBP commands: the remote's own registers, one byte each.

/// A local read, C0..DF: the reply is one byte of data.
///
/// Manual: 7I77, "LOCAL LBP READ COMMANDS"; FACTS 1.3 for those that the manual calls reserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LocalRead {
    /// C0: unit address.
    UnitAddress,
    /// C1: [`LbpStatus`](super::LbpStatus).
    Status,
    /// C2: whether CRCs are checked; always on a 7I77.
    CrcEnable,
    /// C3: CRC errors so far.
    CrcErrorCount,
    /// C6: software mode.
    SoftwareMode,
    /// C7: not zero until the faults have been cleared.
    ClearFaults,
    /// CA: whether the RPC table is accessed instead of the memory.
    RpcMemoryAccess,
    /// CB: frame timeout in bit times.
    FrameTimeout,
    /// CC: [`Nonvolatile`](super::Nonvolatile) access.
    Nonvolatile,
    /// D0..D3: a character of the card's name, 0 to 3.
    Name(u8),
    /// D4: [`Capabilities`](super::Capabilities).
    Capabilities,
    /// D5: software revision.
    SoftwareRevision,
    /// D6: hardware mode.
    HardwareMode,
    /// D7: [`RemoteFaults`](super::RemoteFaults).
    Faults,
    /// D8: low byte of the current address.
    AddressLow,
    /// D9: high byte of the current address.
    AddressHigh,
    /// DA: version of LBP.
    LbpVersion,
    /// DB: unit identification, serial remotes only.
    UnitId,
    /// DC: distance of two lists in the RPC table.
    RpcPitch,
    /// DD: low byte of the size of the RPC table.
    RpcSizeLow,
    /// DE: high byte of the size of the RPC table.
    RpcSizeHigh,
    /// DF: the cookie, [`COOKIE`](super::COOKIE).
    Cookie,
    /// Reserved; the whole command byte.
    Reserved(u8),
}

impl LocalRead {
    /// From a command byte; `None` outside C0..DF.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        Some(match byte {
            0xC0 => Self::UnitAddress,
            0xC1 => Self::Status,
            0xC2 => Self::CrcEnable,
            0xC3 => Self::CrcErrorCount,
            0xC6 => Self::SoftwareMode,
            0xC7 => Self::ClearFaults,
            0xCA => Self::RpcMemoryAccess,
            0xCB => Self::FrameTimeout,
            0xCC => Self::Nonvolatile,
            0xD0..=0xD3 => Self::Name(byte - 0xD0),
            0xD4 => Self::Capabilities,
            0xD5 => Self::SoftwareRevision,
            0xD6 => Self::HardwareMode,
            0xD7 => Self::Faults,
            0xD8 => Self::AddressLow,
            0xD9 => Self::AddressHigh,
            0xDA => Self::LbpVersion,
            0xDB => Self::UnitId,
            0xDC => Self::RpcPitch,
            0xDD => Self::RpcSizeLow,
            0xDE => Self::RpcSizeHigh,
            0xDF => Self::Cookie,
            0xC4 | 0xC5 | 0xC8 | 0xC9 | 0xCD..=0xCF => Self::Reserved(byte),
            _ => return None,
        })
    }

    /// The command byte. `Name` counts modulo 4; a `Reserved` outside C0..DF is put into it.
    pub const fn to_byte(self) -> u8 {
        match self {
            Self::UnitAddress => 0xC0,
            Self::Status => 0xC1,
            Self::CrcEnable => 0xC2,
            Self::CrcErrorCount => 0xC3,
            Self::SoftwareMode => 0xC6,
            Self::ClearFaults => 0xC7,
            Self::RpcMemoryAccess => 0xCA,
            Self::FrameTimeout => 0xCB,
            Self::Nonvolatile => 0xCC,
            Self::Name(index) => 0xD0 | index & 3,
            Self::Capabilities => 0xD4,
            Self::SoftwareRevision => 0xD5,
            Self::HardwareMode => 0xD6,
            Self::Faults => 0xD7,
            Self::AddressLow => 0xD8,
            Self::AddressHigh => 0xD9,
            Self::LbpVersion => 0xDA,
            Self::UnitId => 0xDB,
            Self::RpcPitch => 0xDC,
            Self::RpcSizeLow => 0xDD,
            Self::RpcSizeHigh => 0xDE,
            Self::Cookie => 0xDF,
            Self::Reserved(byte) => 0xC0 | byte & 0x1F,
        }
    }
}

/// A local write, E0..FF: one byte of data follows, but for [`ResetParser`](Self::ResetParser).
///
/// Manual: 7I77, "LOCAL LBP WRITE COMMANDS"; FACTS 1.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LocalWrite {
    /// E1: LBP status; 0 clears errors.
    Status,
    /// E2: not zero checks CRCs.
    CrcEnable,
    /// E3: CRC error count.
    CrcErrorCount,
    /// E6: software mode.
    SoftwareMode,
    /// E7: not zero (SSLBP: FF) clears the faults.
    ClearFaults,
    /// EA: not zero makes the RPC table accessible instead of the memory.
    RpcMemoryAccess,
    /// EB: frame timeout in bit times (SSLBP: 28, four characters).
    FrameTimeout,
    /// EC: [`Nonvolatile`](super::Nonvolatile) access.
    Nonvolatile,
    /// F7: LEDs.
    Leds,
    /// F8: low byte of the current address.
    AddressLow,
    /// F9: high byte of the current address.
    AddressHigh,
    /// FA: adds the data to the current address.
    AddressAdd,
    /// FD: unit identification, serial remotes only.
    UnitId,
    /// FE: resets the remote's processor if the data is 5A.
    ResetProcessor,
    /// FF: resets the remote's parser; no data follows.
    ResetParser,
    /// Reserved; the whole command byte.
    Reserved(u8),
}

impl LocalWrite {
    /// From a command byte; `None` outside E0..FF.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        Some(match byte {
            0xE1 => Self::Status,
            0xE2 => Self::CrcEnable,
            0xE3 => Self::CrcErrorCount,
            0xE6 => Self::SoftwareMode,
            0xE7 => Self::ClearFaults,
            0xEA => Self::RpcMemoryAccess,
            0xEB => Self::FrameTimeout,
            0xEC => Self::Nonvolatile,
            0xF7 => Self::Leds,
            0xF8 => Self::AddressLow,
            0xF9 => Self::AddressHigh,
            0xFA => Self::AddressAdd,
            0xFD => Self::UnitId,
            0xFE => Self::ResetProcessor,
            0xFF => Self::ResetParser,
            0xE0 | 0xE4 | 0xE5 | 0xE8 | 0xE9 | 0xED..=0xF6 | 0xFB | 0xFC => Self::Reserved(byte),
            _ => return None,
        })
    }

    /// The command byte. A `Reserved` outside E0..FF is put into it.
    pub const fn to_byte(self) -> u8 {
        match self {
            Self::Status => 0xE1,
            Self::CrcEnable => 0xE2,
            Self::CrcErrorCount => 0xE3,
            Self::SoftwareMode => 0xE6,
            Self::ClearFaults => 0xE7,
            Self::RpcMemoryAccess => 0xEA,
            Self::FrameTimeout => 0xEB,
            Self::Nonvolatile => 0xEC,
            Self::Leds => 0xF7,
            Self::AddressLow => 0xF8,
            Self::AddressHigh => 0xF9,
            Self::AddressAdd => 0xFA,
            Self::UnitId => 0xFD,
            Self::ResetProcessor => 0xFE,
            Self::ResetParser => 0xFF,
            Self::Reserved(byte) => 0xE0 | byte & 0x1F,
        }
    }

    /// Bytes of data that follow the command.
    pub const fn data_len(self) -> usize {
        match self {
            Self::ResetParser => 0,
            _ => 1,
        }
    }
}
