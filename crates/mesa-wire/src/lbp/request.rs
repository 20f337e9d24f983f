//! Requests of a host, and the check of their replies.

use alloc::{vec, vec::Vec};

use super::{LocalLocation, RemoteAccess, crc8};

/// An invalid reply to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LbpError {
    /// The reply is shorter or longer than the command's reply.
    #[error(
        "reply to command {command:02X} has {actual} bytes, expected {expected}; check wiring, and that the size in the discovery answer is that of the current mode"
    )]
    ReplyLength {
        /// The command byte.
        command: u8,
        /// Bytes expected, CRC included.
        expected: usize,
        /// Bytes received.
        actual: usize,
    },
    /// The reply's CRC is wrong.
    #[error(
        "reply to command {command:02X} has CRC {actual:02X}, its data gives {expected:02X}; check cable, termination and shield"
    )]
    ReplyCrc {
        /// The command byte.
        command: u8,
        /// CRC of the data received.
        expected: u8,
        /// CRC received.
        actual: u8,
    },
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
    /// Reads or writes the remote's memory or one of its local locations.
    pub fn access(access: RemoteAccess) -> Self {
        let mut body = vec![access.command()];
        let reply_len = match access {
            RemoteAccess::Read { address, size } => {
                body.extend(address.to_le_bytes());
                size.bytes()
            }
            RemoteAccess::Write {
                address,
                size,
                value,
            } => {
                let data = value.to_le_bytes().into_iter();
                body.extend(address.to_le_bytes());
                body.extend(data.take(size.bytes().into()));
                0
            }
            RemoteAccess::ReadLocal(_) => 1,
            RemoteAccess::WriteLocal(LocalLocation::RESET_PARSER, _) => 0,
            RemoteAccess::WriteLocal(_, value) => {
                body.push(value);
                0
            }
        };
        Self::new(body, reply_len.into())
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

    fn new(mut body: Vec<u8>, reply_len: usize) -> Self {
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
