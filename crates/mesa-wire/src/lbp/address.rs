//! Address of a read or write of memory.

/// Address of a read or write of a remote's memory: in the command, or the remote's current
/// address.
///
/// An address in the command becomes the current address. With
/// [`auto_increment`](Self::auto_increment) the current address is behind the data afterwards;
/// otherwise the access does not move it.
///
/// An FPGA passes only accesses with an address and without the increment
/// ([`RemoteAccess`](super::RemoteAccess)) to a remote.
///
/// Manual: 7I77, "LBP DATA READ/WRITE COMMAND".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MemoryAddress {
    /// Address in the command; `None` for the current one.
    pub(super) address: Option<u16>,
    pub(super) increments: bool,
}

impl MemoryAddress {
    /// The current address of the remote.
    pub const CURRENT: Self = Self {
        address: None,
        increments: false,
    };

    /// An address in the command.
    pub const fn at(address: u16) -> Self {
        Self {
            address: Some(address),
            ..Self::CURRENT
        }
    }

    /// The same, and the current address moves behind the data.
    #[must_use]
    pub const fn auto_increment(self) -> Self {
        Self {
            increments: true,
            ..self
        }
    }

    /// Bits AI and AS of the command.
    pub(super) const fn bits(self) -> u8 {
        (self.increments as u8) << 3 | (self.address.is_some() as u8) << 2
    }
}
