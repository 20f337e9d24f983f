//! What a host sends, and the check of what it gets back.

use super::{Access, Command, LbpError, LocalRead, LocalWrite, RpcNumber, crc8};

/// The most bytes a frame of this crate holds, CRC included.
pub const MAX_FRAME: usize = 64;

/// A complete frame in a buffer of its own: what goes over the wire.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    bytes: [u8; MAX_FRAME],
    len: u8,
}

impl Frame {
    const fn empty() -> Self {
        Self {
            bytes: [0; MAX_FRAME],
            len: 0,
        }
    }

    /// The bytes, CRC last.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }

    fn push(&mut self, byte: u8) {
        if let Some(slot) = self.bytes.get_mut(usize::from(self.len)) {
            *slot = byte;
            self.len += 1;
        }
    }

    fn sealed(mut self) -> Self {
        let crc = crc8(self.as_bytes());
        self.push(crc);
        self
    }
}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Frame({:02X?})", self.as_bytes())
    }
}

/// A request of the host: its frame, and how long the answer must be.
///
/// # Real time
/// Made and checked without allocation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    frame: Frame,
    reply_len: usize,
}

impl Request {
    /// Reads or writes the remote's memory. `address` is given exactly if `access` is with address.
    pub fn access(access: Access, address: Option<u16>, data: &[u8]) -> Result<Self, LbpError> {
        let command = access.to_byte();
        if access.with_address != address.is_some() {
            return Err(LbpError::Address { command });
        }
        let address = address.map(u16::to_le_bytes);
        let address = address.as_ref().map_or(&[][..], |bytes| &bytes[..]);
        Self::new(
            command,
            address,
            data,
            access.data_len(),
            access.reply_len(),
        )
    }

    /// Reads one of the remote's own registers.
    pub fn local_read(read: LocalRead) -> Self {
        Self {
            frame: frame(read.to_byte(), &[], &[]),
            reply_len: 1,
        }
    }

    /// Writes one of the remote's own registers; the data of a parser reset is not sent.
    pub fn local_write(write: LocalWrite, data: u8) -> Self {
        let data = [data];
        Self {
            frame: frame(
                write.to_byte(),
                &[],
                data.get(..write.data_len()).unwrap_or(&[]),
            ),
            reply_len: 0,
        }
    }

    /// Calls an RPC with `data`, which answers with `reply_len` bytes of data.
    pub fn rpc(number: RpcNumber, data: &[u8], reply_len: usize) -> Result<Self, LbpError> {
        let command = number.to_byte();
        if data.len() + 2 > MAX_FRAME {
            return Err(LbpError::TooLong {
                command,
                actual: data.len(),
            });
        }
        Self::new(command, &[], data, data.len(), reply_len)
    }

    fn new(
        command: u8,
        address: &[u8],
        data: &[u8],
        expected: usize,
        reply_len: usize,
    ) -> Result<Self, LbpError> {
        if data.len() != expected {
            return Err(LbpError::RequestLength {
                command,
                expected,
                actual: data.len(),
            });
        }
        Ok(Self {
            frame: frame(command, address, data),
            reply_len,
        })
    }

    /// What goes over the wire, CRC included.
    pub fn as_bytes(&self) -> &[u8] {
        self.frame.as_bytes()
    }

    /// The command byte.
    pub fn command_byte(&self) -> u8 {
        self.as_bytes().first().copied().unwrap_or(0)
    }

    /// The command.
    pub fn command(&self) -> Option<Command> {
        Command::from_byte(self.command_byte())
    }

    /// Bytes of the answer, CRC included.
    pub const fn reply_len(&self) -> usize {
        self.reply_len + 1
    }

    /// Checks an answer and returns its data without the CRC.
    pub fn check_reply<'a>(&self, reply: &'a [u8]) -> Result<&'a [u8], LbpError> {
        let command = self.command_byte();
        let wrong_length = LbpError::ReplyLength {
            command,
            expected: self.reply_len(),
            actual: reply.len(),
        };
        if reply.len() != self.reply_len() {
            return Err(wrong_length);
        }
        let (&actual, data) = reply.split_last().ok_or(wrong_length)?;
        let expected = crc8(data);
        if actual == expected {
            Ok(data)
        } else {
            Err(LbpError::ReplyCrc {
                command,
                expected,
                actual,
            })
        }
    }
}

fn frame(command: u8, address: &[u8], data: &[u8]) -> Frame {
    let mut frame = Frame::empty();
    frame.push(command);
    for &byte in address.iter().chain(data) {
        frame.push(byte);
    }
    frame.sealed()
}

/// The answer to the discovery RPC.
///
/// Manual: 7I77, "DISCOVERY RPC"; FACTS 1.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DiscoveryReply {
    /// Bytes the remote sends in a process-data reply: fault byte included, CRC not.
    pub rx_size: u8,
    /// Bytes of data in a process-data request: neither command nor CRC.
    pub tx_size: u8,
    /// Address of the process table of contents; 0: the remote has none.
    pub ptoc: u16,
    /// Address of the global table of contents.
    pub gtoc: u16,
}

impl DiscoveryReply {
    /// The reply's data.
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

    /// From the reply's data.
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
