//! A request as a board sees it.

use super::{Command, Lbp16Error};

/// One command of a request, with what follows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Operation<'a> {
    /// The command.
    pub command: Command,
    /// The address that follows it, if it has one.
    pub address: Option<u16>,
    /// The bytes to be written; empty for a read.
    pub data: &'a [u8],
    /// Where in the request the command begins.
    pub offset: usize,
}

impl Operation<'_> {
    /// The elements to be written, as little-endian numbers; none for a read.
    pub fn elements(&self) -> impl Iterator<Item = u64> + '_ {
        self.data.chunks(self.command.size.bytes()).map(number)
    }
}

/// The operations of a request, in order.
///
/// Ends after the first error, because nobody can say where the next command would begin.
///
/// # Real time
/// Every item takes at least two bytes of the request, so there are at most half as many items as
/// bytes. Does not allocate.
#[derive(Clone, Debug)]
pub struct Operations<'a> {
    request: &'a [u8],
    offset: usize,
    failed: bool,
}

impl<'a> Operations<'a> {
    /// The operations of `request`.
    pub fn new(request: &'a [u8]) -> Self {
        Self {
            request,
            offset: 0,
            failed: false,
        }
    }

    fn parse(&mut self) -> Result<Operation<'a>, Lbp16Error> {
        let offset = self.offset;
        let word = self.take(2, |actual| Lbp16Error::ShortCommand { offset, actual })?;
        let word = number(word) as u16;
        let command = Command::decode(word).map_err(|_| Lbp16Error::BadCommand { offset, word })?;
        let space = command.space;
        let address = if command.address {
            let short = |actual| Lbp16Error::ShortAddress {
                offset,
                space,
                actual,
            };
            Some(number(self.take(2, short)?) as u16)
        } else {
            None
        };
        let expected = if command.write { command.data_len() } else { 0 };
        let data = self.take(expected, |actual| Lbp16Error::ShortData {
            offset,
            space,
            expected,
            actual,
        })?;
        Ok(Operation {
            command,
            address,
            data,
            offset,
        })
    }

    fn take(
        &mut self,
        len: usize,
        short: impl FnOnce(usize) -> Lbp16Error,
    ) -> Result<&'a [u8], Lbp16Error> {
        let rest = self.request.get(self.offset..).unwrap_or(&[]);
        let (taken, _) = rest
            .split_at_checked(len)
            .ok_or_else(|| short(rest.len()))?;
        self.offset += len;
        Ok(taken)
    }
}

impl<'a> Iterator for Operations<'a> {
    type Item = Result<Operation<'a>, Lbp16Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed || self.offset >= self.request.len() {
            return None;
        }
        let operation = self.parse();
        self.failed = operation.is_err();
        Some(operation)
    }
}

impl core::iter::FusedIterator for Operations<'_> {}

fn number(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .rev()
        .fold(0, |value, &byte| value << 8 | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Space;
    use super::*;
    use crate::lbp16::ElementSize;

    fn parse(request: &[u8]) -> Vec<Result<Operation<'_>, Lbp16Error>> {
        Operations::new(request).collect()
    }

    #[test]
    fn read_of_the_idrom_is_understood() {
        // Manual: 7I97, "SPACE 0: HOSTMOT2 REGISTERS": 85420004.
        let [Ok(operation)] = parse(&[0x85, 0x42, 0x00, 0x04])[..] else {
            panic!("one operation")
        };
        assert_eq!(
            operation.command,
            Command::read(Space::HostMot2, 5).unwrap()
        );
        assert_eq!(operation.address, Some(0x0400));
        assert_eq!(operation.data, []);
    }

    #[test]
    fn write_of_four_ports_is_understood() {
        // Manual: 7I97, "SPACE 0: HOSTMOT2 REGISTERS": 84C20010 and four 32-bit words.
        let mut request = vec![0x84, 0xC2, 0x00, 0x10];
        for word in [0xAAAA_AAAA_u32, 0xBBBB_BBBB, 0xCCCC_CCCC, 0xDDDD_DDDD] {
            request.extend(word.to_le_bytes());
        }
        let [Ok(operation)] = parse(&request)[..] else {
            panic!("one operation")
        };
        assert_eq!(
            operation.command,
            Command::write(Space::HostMot2, 4).unwrap()
        );
        assert_eq!(operation.address, Some(0x1000));
        let words: Vec<_> = operation.elements().collect();
        assert_eq!(words, [0xAAAA_AAAA, 0xBBBB_BBBB, 0xCCCC_CCCC, 0xDDDD_DDDD]);
    }

    #[test]
    fn several_commands_of_a_packet_come_in_order() {
        // Manual: 7I97, "SPACE2: ETHERNET EEPROM CHIP ACCESS": IP address 192.168.0.32.
        let request = [
            0x01, 0xD9, 0x1A, 0x00, 0x02, 0x5A, 0x82, 0xC9, 0x20, 0x00, 0x20, 0x00, 0xA8, 0xC0,
        ];
        let [Ok(enable), Ok(write)] = parse(&request)[..] else {
            panic!("two operations")
        };
        assert_eq!(
            (enable.command.space, enable.address),
            (Space::Control, Some(0x1A))
        );
        assert_eq!(enable.elements().collect::<Vec<_>>(), [0x5A02]);
        assert!(!enable.command.increment);
        assert_eq!(
            (write.command.space, write.address),
            (Space::Eeprom, Some(0x20))
        );
        assert_eq!(write.elements().collect::<Vec<_>>(), [0x0020, 0xC0A8]);
        assert_eq!(write.offset, 6);
    }

    #[test]
    fn what_is_cut_off_is_said_and_nothing_follows() {
        fn at(request: &[u8]) -> Result<Operation<'_>, Lbp16Error> {
            *parse(request).last().unwrap()
        }
        assert_eq!(
            at(&[0x01, 0x02, 0x85]),
            Err(Lbp16Error::ShortCommand {
                offset: 2,
                actual: 1
            })
        );
        assert_eq!(
            at(&[0x85, 0x42, 0x00]),
            Err(Lbp16Error::ShortAddress {
                offset: 0,
                space: Space::HostMot2,
                actual: 1
            })
        );
        assert_eq!(
            at(&[0x01, 0xD9, 0x1A, 0x00, 0x02]),
            Err(Lbp16Error::ShortData {
                offset: 0,
                space: Space::Control,
                expected: 2,
                actual: 1
            })
        );
        assert_eq!(
            parse(&[0x00, 0x42, 0x01, 0x02]),
            [Err(Lbp16Error::BadCommand {
                offset: 0,
                word: 0x4200,
            })]
        );
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic_and_are_all_accounted_for(
            request in prop::collection::vec(any::<u8>(), 0..1500),
        ) {
            let mut end = 0;
            let mut failed = false;
            for item in Operations::new(&request) {
                prop_assert!(!failed, "nothing follows an error");
                match item {
                    Ok(operation) => {
                        prop_assert_eq!(operation.offset, end);
                        end += 2 + operation.command.request_len();
                    }
                    Err(_) => failed = true,
                }
            }
            prop_assert!(failed || end == request.len());
        }

        #[test]
        fn elements_are_little_endian_numbers_of_the_commands_size(
            values in prop::collection::vec(any::<u64>(), 1..=127),
            size in prop::sample::select(&ElementSize::ALL[..]),
        ) {
            let command = Command::write(Space::HostMot2, values.len() as u8).unwrap();
            let command = command.with_size(size);
            let mut request = command.encode().to_le_bytes().to_vec();
            request.extend([0, 0]);
            for value in &values {
                request.extend(&value.to_le_bytes()[..size.bytes()]);
            }
            let operation = Operations::new(&request).next().unwrap().unwrap();
            let mask = u64::MAX >> (64 - 8 * size.bytes());
            let expected: Vec<_> = values.iter().map(|value| value & mask).collect();
            prop_assert_eq!(operation.elements().collect::<Vec<_>>(), expected);
        }
    }
}
