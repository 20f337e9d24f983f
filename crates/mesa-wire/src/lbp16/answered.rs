//! A request and its reply side by side.

use super::{Lbp16Error, Operation, Operations, elements};

/// One command of a request, with the board's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answered<'a> {
    /// The command, and the data that it writes.
    pub operation: Operation<'a>,
    /// The bytes read: empty for a write. Shorter than [`Command::data_len`] if the reply ends
    /// before.
    ///
    /// [`Command::data_len`]: super::Command::data_len
    pub read: &'a [u8],
}

impl Answered<'_> {
    /// The elements that were written or read, as little-endian numbers. A truncated element is
    /// left out.
    pub fn elements(&self) -> impl Iterator<Item = u64> + '_ {
        let command = self.operation.command;
        let bytes = if command.write {
            self.operation.data
        } else {
            self.read
        };
        elements(bytes, command.size)
    }

    /// True if the reply contains everything that the command reads.
    pub fn is_whole(&self) -> bool {
        let command = self.operation.command;
        command.write || self.read.len() == command.data_len()
    }
}

impl<'a> Operations<'a> {
    /// Bytes of the reply to the remaining operations; 0 if the board does not answer them.
    ///
    /// # Errors
    /// That of the first invalid command.
    pub fn reply_len(&self) -> Result<usize, Lbp16Error> {
        let mut len = 0;
        for operation in self.clone() {
            let command = operation?.command;
            if !command.write {
                len = command.data_len().saturating_add(len);
            }
        }
        Ok(len)
    }

    /// Splits a reply: each command with the bytes that it has read.
    pub fn with_reply(
        self,
        reply: &'a [u8],
    ) -> impl Iterator<Item = Result<Answered<'a>, Lbp16Error>> {
        let mut rest = reply;
        self.map(move |operation| {
            let operation = operation?;
            let command = operation.command;
            let len = if command.write { 0 } else { command.data_len() };
            let (read, behind) = rest.split_at(len.min(rest.len()));
            rest = behind;
            Ok(Answered { operation, read })
        })
    }
}

#[cfg(test)]
mod tests {
    use alloc::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::lbp16::{Command, Space};

    /// Manual: 7I97, "ELBPCOM": the cookie of HostMot2 and the IP address in the EEPROM, with a
    /// write between them.
    const REQUEST: [u8; 14] = [
        0x01, 0x42, 0x00, 0x01, 0x01, 0xD9, 0x18, 0x00, 0x34, 0x12, 0x82, 0x49, 0x20, 0x00,
    ];
    const REPLY: [u8; 8] = [0xFE, 0xCA, 0xAA, 0x55, 0x45, 0x0A, 0x58, 0x63];

    fn answered(reply: &[u8]) -> Vec<Answered<'_>> {
        let all = Operations::new(&REQUEST).with_reply(reply);
        all.collect::<Result<_, _>>().unwrap()
    }

    #[test]
    fn each_command_gets_what_it_has_read() {
        assert_eq!(Operations::new(&REQUEST).reply_len(), Ok(REPLY.len()));
        let all = answered(&REPLY);
        let elements: Vec<Vec<u64>> = all.iter().map(|one| one.elements().collect()).collect();
        assert_eq!(
            elements,
            [vec![0x55AA_CAFE], vec![0x1234], vec![0x0A45, 0x6358]]
        );
        let [_, write, read] = all[..] else {
            panic!("three commands")
        };
        assert!(write.operation.command.write && write.read.is_empty());
        assert_eq!(read.operation.command, Command::read(Space::Eeprom, 2));
        assert!(all.iter().all(Answered::is_whole));
    }

    #[test]
    fn reply_that_is_cut_off_shows_in_the_command_that_it_ends_in() {
        let all = answered(&REPLY[..7]);
        let whole: Vec<bool> = all.iter().map(Answered::is_whole).collect();
        assert_eq!(whole, [true, true, false]);
        assert_eq!(all[2].elements().collect::<Vec<_>>(), [0x0A45]);
        let all = answered(&[]);
        assert!(!all[0].is_whole() && all[1].is_whole() && !all[2].is_whole());
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic_and_no_byte_is_read_twice(
            request in prop::collection::vec(any::<u8>(), 0..100),
            reply in prop::collection::vec(any::<u8>(), 0..100),
        ) {
            let all = Operations::new(&request).with_reply(&reply);
            let read: usize = all.flatten().map(|one| one.read.len()).sum();
            prop_assert!(read <= reply.len());
            let _ = Operations::new(&request).reply_len();
        }
    }
}
