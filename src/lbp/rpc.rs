//! The programmable RPC table of a remote.

use super::{Access, LbpError, MAX_FRAME, RpcNumber};

/// Distance of two lists in the table, in bytes.
///
/// Manual: 7I77, "LBP RPC COMMAND".
pub const RPC_PITCH: u8 = 8;

/// Size of the table: 64 lists, one pitch each.
pub const RPC_TABLE_SIZE: u16 = 64 * RPC_PITCH as u16;

/// Memory that accesses, direct or stored in an RPC list, go to.
pub trait RpcMemory {
    /// One byte.
    fn read(&mut self, address: u16) -> Result<u8, LbpError>;

    /// Writes one byte.
    fn write(&mut self, address: u16, value: u8) -> Result<(), LbpError>;
}

/// The data that a list's reads gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RpcReply {
    bytes: [u8; MAX_FRAME],
    len: usize,
}

impl RpcReply {
    /// In the order of the reads.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }

    fn push(&mut self, byte: u8) -> Result<(), LbpError> {
        // one byte is kept for the CRC
        if self.len + 1 >= MAX_FRAME {
            return Err(LbpError::ReplyTooLong);
        }
        if let Some(slot) = self.bytes.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
        Ok(())
    }
}

/// The table of stored lists: RPC n begins at n * [`RPC_PITCH`], a list may run on over the next
/// ones, and ends with a 0 or with the table.
///
/// Manual: 7I77, "RPC COMMANDS".
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RpcTable {
    bytes: [u8; RPC_TABLE_SIZE as usize],
}

impl Default for RpcTable {
    fn default() -> Self {
        Self {
            bytes: [0; RPC_TABLE_SIZE as usize],
        }
    }
}

/// One entry of a list.
#[derive(Clone, Copy, Debug)]
struct Entry<'a> {
    access: Access,
    address: Option<u16>,
    included: &'a [u8],
}

impl RpcTable {
    /// One byte of the table, as accesses see it while the RPCMEM access flag is set.
    pub fn read(&self, address: u16) -> Result<u8, LbpError> {
        self.bytes
            .get(usize::from(address))
            .copied()
            .ok_or(LbpError::Memory { address })
    }

    /// Writes one byte of the table.
    pub fn write(&mut self, address: u16, value: u8) -> Result<(), LbpError> {
        let byte = self.bytes.get_mut(usize::from(address));
        *byte.ok_or(LbpError::Memory { address })? = value;
        Ok(())
    }

    /// Whether anything is stored as RPC `number`.
    pub fn is_programmed(&self, number: RpcNumber) -> bool {
        self.bytes.get(start(number)).is_some_and(|&byte| byte != 0)
    }

    /// Bytes that a request for RPC `number` carries: those of its writes without included data.
    pub fn request_len(&self, number: RpcNumber) -> Result<usize, LbpError> {
        let mut len = 0;
        let mut at = start(number);
        while let Some((entry, next)) = self.entry(at)? {
            if !entry.access.rpc_includes_data {
                len += entry.access.data_len();
            }
            at = next;
        }
        Ok(len)
    }

    /// Carries out RPC `number` with the data of its request. `current` is the current address,
    /// which accesses without an address use.
    ///
    /// # Real time
    /// Bounded by the table's size; allocates nothing.
    pub fn execute(
        &self,
        number: RpcNumber,
        data: &[u8],
        current: &mut u16,
        memory: &mut impl RpcMemory,
    ) -> Result<RpcReply, LbpError> {
        let expected = self.request_len(number)?;
        if data.len() != expected {
            return Err(LbpError::StreamLength {
                expected,
                actual: data.len(),
            });
        }
        let mut reply = RpcReply {
            bytes: [0; MAX_FRAME],
            len: 0,
        };
        let mut stream = data;
        let mut at = start(number);
        while let Some((entry, next)) = self.entry(at)? {
            let address = entry.address.unwrap_or(*current);
            let size = entry.access.size.bytes();
            if !entry.access.write {
                for offset in 0..size {
                    reply.push(memory.read(address.wrapping_add(offset as u16))?)?;
                }
            } else if entry.access.rpc_includes_data {
                write_all(memory, address, entry.included)?;
            } else {
                let (now, later) = stream.split_at_checked(size).unwrap_or((stream, &[]));
                write_all(memory, address, now)?;
                stream = later;
            }
            let step = if entry.access.auto_increment { size } else { 0 };
            *current = address.wrapping_add(step as u16);
            at = next;
        }
        Ok(reply)
    }

    /// The entry at `at` and where the next one begins.
    fn entry(&self, at: usize) -> Result<Option<(Entry<'_>, usize)>, LbpError> {
        let rest = self.bytes.get(at..).unwrap_or(&[]);
        let (byte, rest) = match rest.split_first() {
            None | Some((0, _)) => return Ok(None),
            Some((&byte, rest)) => (byte, rest),
        };
        let access = Access::from_byte(byte).ok_or(LbpError::NotAnAccess {
            address: at as u16,
            byte,
        })?;
        let end = LbpError::EndOfTable { address: at as u16 };
        let (address, rest) = match rest {
            _ if !access.with_address => (None, rest),
            [low, high, rest @ ..] => (Some(u16::from_le_bytes([*low, *high])), rest),
            _ => return Err(end),
        };
        let stored = if access.rpc_includes_data {
            access.data_len()
        } else {
            0
        };
        let included = rest.get(..stored).ok_or(end)?;
        let next = at + 1 + access.address_len() + stored;
        Ok(Some((
            Entry {
                access,
                address,
                included,
            },
            next,
        )))
    }
}

fn start(number: RpcNumber) -> usize {
    usize::from(number.get()) * usize::from(RPC_PITCH)
}

fn write_all(memory: &mut impl RpcMemory, address: u16, data: &[u8]) -> Result<(), LbpError> {
    for (offset, &byte) in data.iter().enumerate() {
        memory.write(address.wrapping_add(offset as u16), byte)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Ram(Vec<u8>);

    impl RpcMemory for Ram {
        fn read(&mut self, address: u16) -> Result<u8, LbpError> {
            Ok(self.0[usize::from(address)])
        }

        fn write(&mut self, address: u16, value: u8) -> Result<(), LbpError> {
            self.0[usize::from(address)] = value;
            Ok(())
        }
    }

    fn table(at: u16, bytes: &[u8]) -> RpcTable {
        let mut table = RpcTable::default();
        for (offset, &byte) in bytes.iter().enumerate() {
            table.write(at + offset as u16, byte).unwrap();
        }
        table
    }

    #[test]
    fn included_data_comes_from_the_list_and_the_rest_from_the_stream() {
        // 7E: write long at 0200 with included data; 68: write byte at the current address
        let table = table(8, &[0x7E, 0x00, 0x02, 1, 2, 3, 4, 0x68, 0x48, 0]);
        let number = RpcNumber::new(1).unwrap();
        let mut ram = Ram(vec![0; 0x1_0000]);
        ram.0[0x205] = 0x77;
        let mut current = 0;
        assert_eq!(table.request_len(number), Ok(1));
        let reply = table.execute(number, &[9], &mut current, &mut ram).unwrap();
        assert_eq!(ram.0[0x200..0x205], [1, 2, 3, 4, 9]);
        assert_eq!(reply.as_bytes(), [0x77]);
        assert_eq!(current, 0x206);
    }

    #[test]
    fn broken_lists_are_said_and_not_carried_out() {
        let number = RpcNumber::new(63).unwrap();
        let broken = table(504, &[0x40, 0x12]);
        assert_eq!(
            broken.request_len(number),
            Err(LbpError::NotAnAccess {
                address: 505,
                byte: 0x12
            })
        );
        let over = table(504, &[0x40, 0x40, 0x40, 0x40, 0x40, 0x40, 0x44, 0x12]);
        assert_eq!(
            over.request_len(number),
            Err(LbpError::EndOfTable { address: 510 })
        );
    }

    proptest! {
        #[test]
        fn arbitrary_tables_never_panic_and_always_end(
            bytes in prop::collection::vec(any::<u8>(), 512),
            number in 0..64u8,
            data in prop::collection::vec(any::<u8>(), 0..20),
        ) {
            let table = table(0, &bytes);
            let mut ram = Ram(vec![0; 0x1_0000]);
            let mut current = 0;
            let number = RpcNumber::new(number).unwrap();
            let result = table.execute(number, &data, &mut current, &mut ram);
            if let Ok(reply) = result {
                prop_assert_eq!(table.request_len(number), Ok(data.len()));
                prop_assert!(reply.as_bytes().len() < MAX_FRAME);
            }
        }
    }
}
