//! Requests, as a host builds them.

use alloc::vec::Vec;
use core::ops::Range;

use super::{Command, Lbp16Error, MAX_COUNT, Space};

/// Encodes commands one after the other, and keeps track of the reply's layout.
///
/// Manual: 7I97, "LBP16 COMMANDS". A request and its reply may have up to
/// [`MAX_PACKET`](super::MAX_PACKET) bytes: the bus that sends it checks that.
///
/// # Real time
/// Allocates as the request grows; every method is bounded by the bytes it writes.
///
/// ```
/// use mesa_wire::lbp16::{RequestBuilder, Space};
///
/// let mut request = RequestBuilder::default();
/// let idrom = request.read(Space::HostMot2, 0x0400, 5)?;
/// assert_eq!(request.bytes, [0x85, 0x42, 0x00, 0x04]);
/// assert_eq!((idrom, request.reply_len), (0..20, 20));
/// # Ok::<(), mesa_wire::lbp16::Lbp16Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct RequestBuilder {
    /// The request so far.
    pub bytes: Vec<u8>,
    /// Length of the reply in bytes; 0 if the board does not answer the request.
    pub reply_len: usize,
}

impl RequestBuilder {
    /// Reads `count` registers of the space's own size; returns their range in the reply.
    ///
    /// # Errors
    /// As [`command`](Self::command).
    pub fn read(
        &mut self,
        space: Space,
        address: u16,
        count: u8,
    ) -> Result<Range<usize>, Lbp16Error> {
        self.command(Command::read(space, count), address, &[])
    }

    /// Writes registers of the space's own size, little endian; returns the range of their bytes in
    /// the request.
    ///
    /// # Errors
    /// As [`command`](Self::command).
    pub fn write(
        &mut self,
        space: Space,
        address: u16,
        data: &[u8],
    ) -> Result<Range<usize>, Lbp16Error> {
        let count = data.len().checked_div(space.element().bytes()).unwrap_or(0);
        let count = u8::try_from(count).unwrap_or(u8::MAX);
        self.command(Command::write(space, count), address, data)
    }

    /// Adds any command.
    ///
    /// `address` is left out if the command has none; `data` is empty for a read. Returns the range
    /// of the data: in the reply for a read, in the request for a write.
    ///
    /// # Errors
    /// [`Lbp16Error::Count`] and [`Lbp16Error::DataLength`]. The request stays unchanged.
    pub fn command(
        &mut self,
        command: Command,
        address: u16,
        data: &[u8],
    ) -> Result<Range<usize>, Lbp16Error> {
        let count = command.count;
        if !(1..=MAX_COUNT).contains(&count) {
            return Err(Lbp16Error::Count { count });
        }
        let (expected, found) = (command.written_len(), data.len());
        if found != expected {
            return Err(Lbp16Error::DataLength { expected, found });
        }
        Ok(self.push(command, address, data))
    }

    /// As [`command`](Self::command), for a command that is known to be valid: its count and its
    /// data are not checked. A count of 0 can be set later, in [`bytes`](Self::bytes).
    pub fn push(&mut self, command: Command, address: u16, data: &[u8]) -> Range<usize> {
        debug_assert_eq!(data.len(), command.written_len(), "{command:?}");
        self.bytes.extend(command.encode().to_le_bytes());
        if command.address {
            self.bytes.extend(address.to_le_bytes());
        }
        if command.write {
            let start = self.bytes.len();
            self.bytes.extend_from_slice(data);
            return start..self.bytes.len();
        }
        let start = self.reply_len;
        self.reply_len = start.saturating_add(command.data_len());
        start..self.reply_len
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lbp16::Operations;

    fn built(build: impl FnOnce(&mut RequestBuilder)) -> (Vec<u8>, usize) {
        let mut request = RequestBuilder::default();
        build(&mut request);
        (request.bytes, request.reply_len)
    }

    #[test]
    fn setting_the_ip_address_is_the_packet_of_the_manual() {
        // Manual: 7I97, "SPACE2: ETHERNET EEPROM CHIP ACCESS": 01D91A00025A, 82C920002000A8C0.
        let (bytes, reply) = built(|request| {
            let enable = Command::write(Space::Control, 1).standing();
            request.command(enable, 0x1A, &[0x02, 0x5A]).unwrap();
            let address = [0x20, 0x00, 0xA8, 0xC0];
            let at = request.write(Space::Eeprom, 0x20, &address).unwrap();
            assert_eq!(at, 10..14);
        });
        let manual = [
            0x01, 0xD9, 0x1A, 0x00, 0x02, 0x5A, 0x82, 0xC9, 0x20, 0x00, 0x20, 0x00, 0xA8, 0xC0,
        ];
        assert_eq!((&bytes[..], reply), (&manual[..], 0));
    }

    #[test]
    fn reading_1024_bytes_of_flash_is_the_packet_of_the_manual() {
        // Manual: 7I97, "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS": 01CE000056341200, 404E0400,
        // 400E, 400E, 400E.
        let (bytes, reply) = built(|request| {
            let address = Command::write(Space::Flash, 1).standing();
            let data = 0x0012_3456_u32.to_le_bytes();
            request.command(address, 0, &data).unwrap();
            let mut read = Command::read(Space::Flash, 64).standing();
            request.command(read, 4, &[]).unwrap();
            read.address = false;
            for block in 1..4 {
                let at = request.command(read, 0, &[]).unwrap();
                assert_eq!(at, block * 256..(block + 1) * 256);
            }
        });
        let manual = [
            0x01, 0xCE, 0x00, 0x00, 0x56, 0x34, 0x12, 0x00, 0x40, 0x4E, 0x04, 0x00, 0x40, 0x0E,
            0x40, 0x0E, 0x40, 0x0E,
        ];
        assert_eq!((&bytes[..], reply), (&manual[..], 1024));
    }

    #[test]
    fn invalid_command_leaves_the_request_unchanged() {
        let mut request = RequestBuilder::default();
        request.read(Space::HostMot2, 0x0100, 1).unwrap();
        assert_eq!(
            request.write(Space::HostMot2, 0x1000, &[0; 512]),
            Err(Lbp16Error::Count { count: 128 })
        );
        assert_eq!(
            request.write(Space::HostMot2, 0x1000, &[0; 5000]),
            Err(Lbp16Error::Count { count: 255 })
        );
        assert_eq!(
            request.read(Space::HostMot2, 0x1000, 0),
            Err(Lbp16Error::Count { count: 0 })
        );
        let cut_off = Err(Lbp16Error::DataLength {
            expected: 4,
            found: 7,
        });
        assert_eq!(
            request.write(Space::HostMot2, 0x1000, &[0; 7]),
            cut_off,
            "one register, and a part of another"
        );
        assert_eq!(request.bytes, [0x81, 0x42, 0x00, 0x01]);
        assert_eq!(request.reply_len, 4);
    }

    fn any_command() -> impl Strategy<Value = (u16, u16, Vec<u8>)> {
        (any::<u16>(), any::<u16>())
            .prop_filter("count 0", |(word, _)| word & 0x7F != 0)
            .prop_flat_map(|(word, address)| {
                let len = Command::decode(word).written_len();
                let data = prop::collection::vec(any::<u8>(), len);
                (Just(word), Just(address), data)
            })
    }

    proptest! {
        #[test]
        fn board_understands_what_a_host_builds(
            commands in prop::collection::vec(any_command(), 0..12),
        ) {
            let mut request = RequestBuilder::default();
            let mut reply = 0;
            for (word, address, data) in &commands {
                let command = Command::decode(*word);
                let at = request.command(command, *address, &data[..]).unwrap();
                prop_assert_eq!(at.len(), command.data_len());
                if !command.write {
                    reply += usize::from(command.count) * command.size.bytes();
                }
            }
            prop_assert_eq!(request.reply_len, reply);
            let parsed: Result<Vec<_>, _> = Operations::new(&request.bytes).collect();
            let parsed = parsed.unwrap();
            prop_assert_eq!(parsed.len(), commands.len());
            for (operation, (word, address, data)) in parsed.iter().zip(&commands) {
                prop_assert_eq!(operation.command.encode(), *word);
                let sent = operation.command.address.then_some(*address);
                prop_assert_eq!(operation.address, sent);
                prop_assert_eq!(operation.data, &data[..]);
            }
        }
    }
}
