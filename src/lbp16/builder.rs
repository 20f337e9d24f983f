//! A request as a host makes it.

use core::ops::Range;

use super::{Command, ElementSize, Lbp16Error, MAX_COUNT, Space};

/// Encodes commands one after the other into a buffer, and knows the reply.
///
/// Manual: 7I97, "LBP16 COMMANDS".
///
/// # Real time
/// Does not allocate; every method is bounded by the bytes it writes.
///
/// ```
/// use mesa_hal::lbp16::{RequestBuilder, Space};
///
/// let mut buffer = [0; 64];
/// let mut request = RequestBuilder::new(&mut buffer);
/// let idrom = request.read(Space::HostMot2, 0x0400, 5)?;
/// assert_eq!(request.bytes(), [0x85, 0x42, 0x00, 0x04]);
/// assert_eq!((idrom, request.reply_len()), (0..20, 20));
/// # Ok::<(), mesa_hal::lbp16::Lbp16Error>(())
/// ```
#[derive(Debug)]
pub struct RequestBuilder<'a> {
    buffer: &'a mut [u8],
    len: usize,
    reply_len: usize,
}

impl<'a> RequestBuilder<'a> {
    /// An empty request that grows in `buffer`.
    pub fn new(buffer: &'a mut [u8]) -> Self {
        Self {
            buffer,
            len: 0,
            reply_len: 0,
        }
    }

    /// Reads `count` registers of the space's own size; returns where they are in the reply.
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

    /// Writes registers of 16 bits; returns where their bytes are in the request.
    ///
    /// # Errors
    /// As [`command`](Self::command).
    pub fn write_words(
        &mut self,
        space: Space,
        address: u16,
        words: &[u16],
    ) -> Result<Range<usize>, Lbp16Error> {
        let bytes = words.iter().flat_map(|word| word.to_le_bytes());
        self.write(space, ElementSize::Word, address, words.len(), bytes)
    }

    /// Writes registers of 32 bits; returns where their bytes are in the request.
    ///
    /// # Errors
    /// As [`command`](Self::command).
    pub fn write_doubles(
        &mut self,
        space: Space,
        address: u16,
        doubles: &[u32],
    ) -> Result<Range<usize>, Lbp16Error> {
        let bytes = doubles.iter().flat_map(|double| double.to_le_bytes());
        self.write(space, ElementSize::Double, address, doubles.len(), bytes)
    }

    fn write(
        &mut self,
        space: Space,
        size: ElementSize,
        address: u16,
        count: usize,
        bytes: impl Iterator<Item = u8>,
    ) -> Result<Range<usize>, Lbp16Error> {
        let command = Command {
            size,
            ..Command::write(space, u8::try_from(count).unwrap_or(u8::MAX))
        };
        self.push_command(command, address, bytes)
    }

    /// Any command.
    ///
    /// `address` is left out if the command has none, `data` if it reads. Returns where the data
    /// is: in the reply for a read, in the request for a write.
    ///
    /// # Errors
    /// [`Lbp16Error::Count`], [`Lbp16Error::DataLength`] and [`Lbp16Error::NoRoom`]. The request stays
    /// as it was.
    pub fn command(
        &mut self,
        command: Command,
        address: u16,
        data: &[u8],
    ) -> Result<Range<usize>, Lbp16Error> {
        let (expected, found) = (command.written_len(), data.len());
        if found != expected {
            return Err(Lbp16Error::DataLength { expected, found });
        }
        self.push_command(command, address, data.iter().copied())
    }

    /// The request so far.
    pub fn bytes(&self) -> &[u8] {
        self.buffer.get(..self.len).unwrap_or(&[])
    }

    /// Bytes of the reply; 0 if the request is not answered.
    pub fn reply_len(&self) -> usize {
        self.reply_len
    }

    fn push_command(
        &mut self,
        command: Command,
        address: u16,
        data: impl Iterator<Item = u8>,
    ) -> Result<Range<usize>, Lbp16Error> {
        let count = command.count;
        if !(1..=MAX_COUNT).contains(&count) {
            return Err(Lbp16Error::Count { count });
        }
        let free = self.buffer.len() - self.len;
        let needed = 2 + 2 * usize::from(command.address) + command.written_len();
        if needed > free {
            return Err(Lbp16Error::NoRoom { needed, free });
        }
        self.push(command.encode().to_le_bytes().into_iter());
        if command.address {
            self.push(address.to_le_bytes().into_iter());
        }
        if command.write {
            let start = self.len;
            self.push(data);
            return Ok(start..self.len);
        }
        let start = self.reply_len;
        self.reply_len += command.data_len();
        Ok(start..self.reply_len)
    }

    fn push(&mut self, bytes: impl Iterator<Item = u8>) {
        let free = self.buffer.iter_mut().skip(self.len);
        self.len += free.zip(bytes).map(|(slot, byte)| *slot = byte).count();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lbp16::Operations;

    fn built(build: impl FnOnce(&mut RequestBuilder<'_>)) -> (Vec<u8>, usize) {
        let mut buffer = [0; 1472];
        let mut request = RequestBuilder::new(&mut buffer);
        build(&mut request);
        (request.bytes().to_vec(), request.reply_len())
    }

    fn standing(command: Command) -> Command {
        Command {
            increment: false,
            ..command
        }
    }

    #[test]
    fn setting_the_ip_address_is_the_packet_of_the_manual() {
        // Manual: 7I97, "SPACE2: ETHERNET EEPROM CHIP ACCESS": 01D91A00025A, 82C920002000A8C0.
        let (bytes, reply) = built(|request| {
            let enable = standing(Command::write(Space::Control, 1));
            request.command(enable, 0x1A, &[0x02, 0x5A]).unwrap();
            let at = request
                .write_words(Space::Eeprom, 0x20, &[0x0020, 0xC0A8])
                .unwrap();
            assert_eq!(at, 10..14);
        });
        let manual = [
            0x01, 0xD9, 0x1A, 0x00, 0x02, 0x5A, 0x82, 0xC9, 0x20, 0x00, 0x20, 0x00, 0xA8, 0xC0,
        ];
        assert_eq!((&bytes[..], reply), (&manual[..], 0));
    }

    #[test]
    fn reading_1024_bytes_of_flash_is_the_packet_of_the_manual() {
        // Manual: 7I97, "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS": 01CE000056341200, 404E0400, 400E, 400E, 400E.
        let (bytes, reply) = built(|request| {
            let address = standing(Command::write(Space::Flash, 1));
            let data = 0x0012_3456_u32.to_le_bytes();
            request.command(address, 0, &data).unwrap();
            let mut read = standing(Command::read(Space::Flash, 64));
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
    fn what_does_not_fit_leaves_the_request_as_it_was() {
        let mut buffer = [0; 11];
        let mut request = RequestBuilder::new(&mut buffer);
        request.read(Space::HostMot2, 0x0100, 1).unwrap();
        assert_eq!(
            request.write_doubles(Space::HostMot2, 0x1000, &[1]),
            Err(Lbp16Error::NoRoom { needed: 8, free: 7 })
        );
        assert_eq!(
            request.write_doubles(Space::HostMot2, 0x1000, &[0; 128]),
            Err(Lbp16Error::Count { count: 128 })
        );
        assert_eq!(
            request.read(Space::HostMot2, 0x1000, 0),
            Err(Lbp16Error::Count { count: 0 })
        );
        let write = Command::write(Space::HostMot2, 1);
        assert_eq!(
            request.command(write, 0x1000, &[1, 2, 3]),
            Err(Lbp16Error::DataLength {
                expected: 4,
                found: 3
            })
        );
        assert_eq!(request.bytes(), [0x81, 0x42, 0x00, 0x01]);
        assert_eq!(request.reply_len(), 4);
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
        fn a_board_understands_what_a_host_builds(
            commands in prop::collection::vec(any_command(), 0..12),
        ) {
            let mut buffer = vec![0; 16_000];
            let mut request = RequestBuilder::new(&mut buffer);
            let mut reply = 0;
            for (word, address, data) in &commands {
                let command = Command::decode(*word);
                let at = request.command(command, *address, &data[..]).unwrap();
                prop_assert_eq!(at.len(), command.data_len());
                if !command.write {
                    reply += usize::from(command.count) * command.size.bytes();
                }
            }
            prop_assert_eq!(request.reply_len(), reply);
            let parsed: Result<Vec<_>, _> = Operations::new(request.bytes()).collect();
            let parsed = parsed.unwrap();
            prop_assert_eq!(parsed.len(), commands.len());
            for (operation, (word, address, data)) in parsed.iter().zip(&commands) {
                prop_assert_eq!(operation.command.encode(), *word);
                let sent = operation.command.address.then_some(*address);
                prop_assert_eq!(operation.address, sent);
                prop_assert_eq!(operation.data, &data[..]);
            }
        }

        #[test]
        fn a_small_buffer_is_never_overrun(
            commands in prop::collection::vec(any_command(), 0..12),
            room in 0..300_usize,
        ) {
            let mut buffer = vec![0; room];
            let mut request = RequestBuilder::new(&mut buffer);
            for (word, address, data) in &commands {
                let before = (request.bytes().len(), request.reply_len());
                let command = Command::decode(*word);
                if request.command(command, *address, &data[..]).is_err() {
                    prop_assert_eq!((request.bytes().len(), request.reply_len()), before);
                }
            }
            prop_assert!(Operations::new(request.bytes()).all(|operation| operation.is_ok()));
        }
    }
}
