//! Requests of a host, and the check of their replies.

use alloc::{vec, vec::Vec};

use super::{AccessSize, LocalLocation, MemoryAddress, RemoteAccess, advice, crc8};

/// An invalid reply to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LbpError {
    /// The reply is shorter or longer than the command's reply.
    #[error("reply to command {command:02X} has {actual} bytes, expected {expected}")]
    ReplyLength {
        /// The command byte.
        command: u8,
        /// Bytes expected, CRC included.
        expected: usize,
        /// Bytes received.
        actual: usize,
    },
    /// The reply's CRC is wrong.
    #[error("reply to command {command:02X} has CRC {actual:02X}, its data gives {expected:02X}")]
    ReplyCrc {
        /// The command byte.
        command: u8,
        /// CRC of the data received.
        expected: u8,
        /// CRC received.
        actual: u8,
    },
}

impl crate::MesaError for LbpError {
    fn advice(&self) -> Option<crate::Advice> {
        Some(match self {
            Self::ReplyLength { .. } => advice::CHECK_REPLY_SIZE,
            Self::ReplyCrc { .. } => advice::CHECK_TERMINATION,
        })
    }
}

/// Command byte of the discovery RPC; its reply is a [`DiscoveryReply`].
///
/// FACTS 1.2: one section of the manual swaps it with the unit number RPC.
pub const DISCOVERY: u8 = 0xBB;

/// Command byte of the unit number RPC; its reply has 4 bytes.
pub const UNIT_NUMBER: u8 = 0xBC;

/// Command byte of the RPC that exchanges process data; the reply begins with the fault byte.
pub const PROCESS_DATA: u8 = 0xBD;

/// A request of the host: its frame, and the expected length of the reply.
///
/// # Real time
/// For set-up: allocates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    frame: Vec<u8>,
    reply_len: usize,
}

impl Request {
    /// Reads or writes the remote's memory or one of its local locations, as an FPGA does.
    pub fn access(access: RemoteAccess) -> Self {
        match access {
            RemoteAccess::Read { address, size } => Self::read(MemoryAddress::at(address), size),
            RemoteAccess::Write {
                address,
                size,
                value,
            } => Self::write(MemoryAddress::at(address), size, value),
            RemoteAccess::ReadLocal(_) => Self::new(vec![access.command()], 1),
            RemoteAccess::WriteLocal(LocalLocation::RESET_PARSER, _) => {
                Self::new(vec![access.command()], 0)
            }
            RemoteAccess::WriteLocal(_, value) => Self::new(vec![access.command(), value], 0),
        }
    }

    /// Reads the remote's memory: commands 40 to 4F.
    ///
    /// ```
    /// use mesa_wire::lbp::{AccessSize, MemoryAddress, Request};
    ///
    /// // Manual: 7I77, "EXAMPLE LBP COMMANDS": read 8 bytes at 0x010. The last byte is the CRC.
    /// let read = Request::read(MemoryAddress::at(0x10), AccessSize::Double);
    /// assert_eq!(read.as_bytes(), [0x47, 0x10, 0x00, 0xA7]);
    /// assert_eq!(read.reply_len(), 9);
    /// ```
    pub fn read(address: MemoryAddress, size: AccessSize) -> Self {
        let command = 0x40 | address.bits() | size as u8;
        Self::new(data_body(command, address), size.bytes().into())
    }

    /// Writes the remote's memory: commands 60 to 6F. `value` is right-justified; its bits above
    /// `size` are ignored.
    pub fn write(address: MemoryAddress, size: AccessSize, value: u64) -> Self {
        let command = 0x60 | address.bits() | size as u8;
        let mut body = data_body(command, address);
        let data = value.to_le_bytes().into_iter();
        body.extend(data.take(size.bytes().into()));
        Self::new(body, 0)
    }

    /// Calls the RPC with the command byte `command`, 80 to BF, and the argument `data`; the reply
    /// has `reply_len` bytes of data.
    pub fn rpc(command: u8, data: &[u8], reply_len: usize) -> Self {
        debug_assert_eq!(
            command & 0xC0,
            0x80,
            "an RPC has a command byte of 80 to BF"
        );
        let mut body = vec![0x80 | command & 0x3F];
        body.extend(data);
        Self::new(body, reply_len)
    }

    /// A request of any bytes, to which the CRC is appended; the reply has `reply_len` bytes of
    /// data.
    pub fn new(mut body: Vec<u8>, reply_len: usize) -> Self {
        body.push(crc8(&body));
        Self {
            frame: body,
            reply_len,
        }
    }

    /// The bytes on the wire, CRC included.
    pub fn as_bytes(&self) -> &[u8] {
        &self.frame
    }

    /// Length of the reply in bytes, CRC included.
    pub const fn reply_len(&self) -> usize {
        self.reply_len.saturating_add(1)
    }

    /// Checks a reply and returns its data without the CRC.
    ///
    /// # Errors
    /// [`LbpError`] for a reply of another length or with a wrong CRC.
    pub fn check_reply<'a>(&self, reply: &'a [u8]) -> Result<&'a [u8], LbpError> {
        let command = self.frame.first().copied().unwrap_or(0);
        let (&actual, data) = reply
            .split_last()
            .filter(|(_, data)| data.len() == self.reply_len)
            .ok_or(LbpError::ReplyLength {
                command,
                expected: self.reply_len(),
                actual: reply.len(),
            })?;
        match crc8(data) {
            expected if expected == actual => Ok(data),
            expected => Err(LbpError::ReplyCrc {
                command,
                expected,
                actual,
            }),
        }
    }
}

/// Command and address of a data access.
fn data_body(command: u8, address: MemoryAddress) -> Vec<u8> {
    let mut body = vec![command];
    body.extend(address.address.into_iter().flat_map(u16::to_le_bytes));
    body
}

/// The reply to the [`DISCOVERY`] RPC.
///
/// Manual: 7I77, "DISCOVERY RPC"; FACTS 1.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DiscoveryReply {
    /// Bytes of a process-data reply: fault byte included, CRC not.
    pub rx_size: u8,
    /// Bytes of data of a process-data request: neither command nor CRC.
    pub tx_size: u8,
    /// Address of the process table of contents; 0 if the remote has none.
    pub ptoc: u16,
    /// Address of the global table of contents.
    pub gtoc: u16,
}

impl DiscoveryReply {
    /// The data of the reply.
    pub const fn to_bytes(self) -> [u8; 6] {
        let [ptoc_low, ptoc_high] = self.ptoc.to_le_bytes();
        let [gtoc_low, gtoc_high] = self.gtoc.to_le_bytes();
        [
            self.rx_size,
            self.tx_size,
            ptoc_low,
            ptoc_high,
            gtoc_low,
            gtoc_high,
        ]
    }

    /// Decodes the data of the reply.
    pub const fn from_bytes(bytes: [u8; 6]) -> Self {
        let [rx_size, tx_size, p0, p1, g0, g1] = bytes;
        Self {
            rx_size,
            tx_size,
            ptoc: u16::from_le_bytes([p0, p1]),
            gtoc: u16::from_le_bytes([g0, g1]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Manual: 7I77, "EXAMPLE LBP COMMANDS"; the last byte is the CRC.
    #[test]
    fn examples_of_the_manual_have_their_bytes() {
        let at = MemoryAddress::at(0x10);
        let write = Request::write(at.auto_increment(), AccessSize::Long, 0xDDCC_BBAA);
        let bytes = [0x6E, 0x10, 0x00, 0xAA, 0xBB, 0xCC, 0xDD, 0x90];
        assert_eq!((write.as_bytes(), write.reply_len()), (&bytes[..], 1));
        let more = Request::write(MemoryAddress::CURRENT, AccessSize::Word, 0xFFEE);
        let bytes = [0x61, 0xEE, 0xFF, 0x92];
        assert_eq!((more.as_bytes(), more.reply_len()), (&bytes[..], 1));
        let read = Request::read(at, AccessSize::Double);
        let bytes = [0x47, 0x10, 0x00, 0xA7];
        assert_eq!((read.as_bytes(), read.reply_len()), (&bytes[..], 9));
    }

    #[test]
    fn all_forms_of_access_have_the_commands_of_the_manual() {
        let sizes = [
            AccessSize::Byte,
            AccessSize::Word,
            AccessSize::Long,
            AccessSize::Double,
        ];
        let forms = [
            (0x40, MemoryAddress::CURRENT),
            (0x44, MemoryAddress::at(1)),
            (0x48, MemoryAddress::CURRENT.auto_increment()),
            (0x4C, MemoryAddress::at(1).auto_increment()),
        ];
        for (first, address) in forms {
            for (command, size) in (first..).zip(sizes) {
                let read = Request::read(address, size);
                assert_eq!(read.as_bytes()[0], command);
                let write = Request::write(address, size, 0);
                assert_eq!(write.as_bytes()[0], command | 0x20);
                let with_address = if address.address.is_some() { 2 } else { 0 };
                assert_eq!(read.as_bytes().len(), 2 + with_address);
                let data = usize::from(size.bytes());
                assert_eq!(write.as_bytes().len(), 2 + with_address + data);
            }
        }
    }
}
