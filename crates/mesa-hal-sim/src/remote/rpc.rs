//! The programmable RPC table of a remote.

use super::{
    buffers::{MAX_FRAME, ReplyBuffer},
    parser::MemoryAccess,
};
use mesa_wire::lbp::LbpStatus;

/// Distance of two lists in the table, in bytes.
///
/// Manual: 7I77, "LBP RPC COMMAND".
pub(super) const RPC_PITCH: u8 = 8;

/// Size of the table: 64 lists, one pitch each.
pub(super) const RPC_TABLE_SIZE: u16 = 64 * RPC_PITCH as u16;

/// Memory for accesses, direct or stored in an RPC list. A refused access returns the error for the
/// LBP status.
pub(super) trait RpcMemory {
    /// Reads one byte.
    fn read(&mut self, address: u16) -> Result<u8, LbpStatus>;

    /// Writes one byte.
    fn write(&mut self, address: u16, value: u8) -> Result<(), LbpStatus>;
}

/// The table of stored lists: RPC n begins at n * [`RPC_PITCH`]; a list may extend over the next
/// ones, and ends with a 0 or with the table.
///
/// Manual: 7I77, "RPC COMMANDS".
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RpcTable {
    bytes: [u8; RPC_TABLE_SIZE as usize],
}

impl Default for RpcTable {
    fn default() -> Self {
        Self {
            bytes: [0; RPC_TABLE_SIZE as usize],
        }
    }
}

/// An entry of a list.
#[derive(Clone, Copy, Debug)]
struct Entry<'a> {
    access: MemoryAccess,
    address: Option<u16>,
    included: &'a [u8],
}

impl RpcTable {
    /// Reads one byte of the table, for accesses while the RPCMEM access flag is set.
    pub(super) fn read(&self, address: u16) -> Result<u8, LbpStatus> {
        self.bytes
            .get(usize::from(address))
            .copied()
            .ok_or(LbpStatus::INVALID_ADDRESS)
    }

    /// Writes one byte of the table.
    pub(super) fn write(&mut self, address: u16, value: u8) -> Result<(), LbpStatus> {
        let byte = self.bytes.get_mut(usize::from(address));
        *byte.ok_or(LbpStatus::INVALID_ADDRESS)? = value;
        Ok(())
    }

    /// Number of data bytes in a request of the RPC of `command`: those of its writes without
    /// included data.
    pub(super) fn request_len(&self, command: u8) -> Result<usize, LbpStatus> {
        let mut len = 0;
        let mut at = start(command);
        while let Some((entry, next)) = self.entry(at)? {
            if !entry.access.includes_data() {
                len += entry.access.data_len();
            }
            at = next;
        }
        Ok(len)
    }

    /// Executes the RPC of `command` with the data of its request. `current` is the current
    /// address, for accesses without an address.
    ///
    /// # Real time
    /// Bounded by the table's size; does not allocate.
    pub(super) fn execute(
        &self,
        command: u8,
        data: &[u8],
        current: &mut u16,
        memory: &mut impl RpcMemory,
    ) -> Result<ReplyBuffer, LbpStatus> {
        if data.len() != self.request_len(command)? {
            return Err(LbpStatus::INVALID_ADDRESS);
        }
        let mut reply = ReplyBuffer::EMPTY;
        let mut stream = data;
        let mut at = start(command);
        while let Some((entry, next)) = self.entry(at)? {
            let address = entry.address.unwrap_or(*current);
            let size = entry.access.bytes();
            if !entry.access.is_write() {
                for offset in 0..size {
                    // The last byte is reserved for the CRC.
                    if reply.as_bytes().len() + 1 >= MAX_FRAME {
                        return Err(LbpStatus::BUFFER_OVERFLOW);
                    }
                    reply.extend(&[memory.read(address.wrapping_add(offset as u16))?]);
                }
            } else if entry.access.includes_data() {
                write_all(memory, address, entry.included)?;
            } else {
                let (now, later) = stream.split_at_checked(size).unwrap_or((stream, &[]));
                write_all(memory, address, now)?;
                stream = later;
            }
            *current = address.wrapping_add(entry.access.step());
            at = next;
        }
        Ok(reply)
    }

    /// The entry at `at` and the position of the next one. A byte that is not an access, and an
    /// entry that exceeds the table, are invalid addresses.
    fn entry(&self, at: usize) -> Result<Option<(Entry<'_>, usize)>, LbpStatus> {
        let error = LbpStatus::INVALID_ADDRESS;
        let (byte, mut rest) = match self.bytes.get(at..).and_then(<[u8]>::split_first) {
            None | Some((0, _)) => return Ok(None),
            Some((&byte, rest)) => (byte, rest),
        };
        let access = MemoryAccess::from_byte(byte).ok_or(error)?;
        let mut address = None;
        if access.has_address() {
            let (&bytes, behind) = rest.split_first_chunk().ok_or(error)?;
            (address, rest) = (Some(u16::from_le_bytes(bytes)), behind);
        }
        let stored = if access.includes_data() {
            access.data_len()
        } else {
            0
        };
        let (included, rest) = rest.split_at_checked(stored).ok_or(error)?;
        let entry = Entry {
            access,
            address,
            included,
        };
        Ok(Some((entry, self.bytes.len() - rest.len())))
    }
}

fn start(command: u8) -> usize {
    usize::from(command & 0x3F) * usize::from(RPC_PITCH)
}

fn write_all(memory: &mut impl RpcMemory, address: u16, data: &[u8]) -> Result<(), LbpStatus> {
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
        fn read(&mut self, address: u16) -> Result<u8, LbpStatus> {
            Ok(self.0[usize::from(address)])
        }

        fn write(&mut self, address: u16, value: u8) -> Result<(), LbpStatus> {
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
    fn included_data_comes_from_the_list_the_rest_from_the_stream() {
        // 7E: write long at 0200 with included data; 68: write byte at the current address.
        let table = table(8, &[0x7E, 0x00, 0x02, 1, 2, 3, 4, 0x68, 0x48, 0]);
        let number = 0x81;
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
    fn broken_lists_are_refused_with_a_status_and_not_executed() {
        let number = 0xBF;
        let broken = table(504, &[0x40, 0x12]);
        assert_eq!(broken.request_len(number), Err(LbpStatus::INVALID_ADDRESS));
        let over = table(504, &[0x40, 0x40, 0x40, 0x40, 0x40, 0x40, 0x44, 0x12]);
        assert_eq!(over.request_len(number), Err(LbpStatus::INVALID_ADDRESS));
    }

    proptest! {
        #[test]
        fn arbitrary_tables_never_panic_and_always_end(
            bytes in prop::collection::vec(any::<u8>(), 512),
            number in 0x80..0xC0u8,
            data in prop::collection::vec(any::<u8>(), 0..20),
        ) {
            let table = table(0, &bytes);
            let mut ram = Ram(vec![0; 0x1_0000]);
            let mut current = 0;
            let result = table.execute(number, &data, &mut current, &mut ram);
            if let Ok(reply) = result {
                prop_assert_eq!(table.request_len(number), Ok(data.len()));
                prop_assert!(reply.as_bytes().len() < MAX_FRAME);
            }
        }
    }
}
