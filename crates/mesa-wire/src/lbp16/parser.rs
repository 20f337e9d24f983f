//! Requests, as a board decodes them.

use super::{Command, ElementSize, Lbp16Error};

/// One command of a request, with its address and data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Operation<'a> {
    /// The command.
    pub command: Command,
    /// The address after the command, if it has one.
    pub address: Option<u16>,
    /// The bytes to write; empty for a read.
    pub data: &'a [u8],
}

impl Operation<'_> {
    /// The elements to write, as little-endian numbers; none for a read.
    pub fn elements(&self) -> impl Iterator<Item = u64> + '_ {
        elements(self.data, self.command.size)
    }
}

/// Iterator over the operations of a request, in order.
///
/// Ends after the first error, because the start of the next command is then unknown.
///
/// # Real time
/// Every item takes at least two bytes of the request, so there are at most half as many items as
/// bytes. Does not allocate.
#[derive(Clone, Debug)]
pub struct Operations<'a> {
    request: &'a [u8],
    offset: usize,
}

impl<'a> Operations<'a> {
    /// The operations of `request`.
    pub fn new(request: &'a [u8]) -> Self {
        Self { request, offset: 0 }
    }

    fn parse(&mut self) -> Result<Operation<'a>, Lbp16Error> {
        let offset = self.offset;
        let word = number(self.take(offset, 2, "a command word")?) as u16;
        let command = Command::decode(word);
        if command.count == 0 {
            return Err(Lbp16Error::BadCommand { offset, word });
        }
        let address = if command.address {
            Some(number(self.take(offset, 2, "an address")?) as u16)
        } else {
            None
        };
        Ok(Operation {
            command,
            address,
            data: self.take(offset, command.written_len(), "data")?,
        })
    }

    fn take(
        &mut self,
        offset: usize,
        expected: usize,
        what: &'static str,
    ) -> Result<&'a [u8], Lbp16Error> {
        let rest = self.request.get(self.offset..).unwrap_or(&[]);
        let (taken, _) = rest.split_at_checked(expected).ok_or(Lbp16Error::CutOff {
            offset,
            what,
            expected,
            found: rest.len(),
        })?;
        self.offset = self.offset.saturating_add(expected);
        Ok(taken)
    }
}

impl<'a> Iterator for Operations<'a> {
    type Item = Result<Operation<'a>, Lbp16Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.offset >= self.request.len() {
            return None;
        }
        let operation = self.parse();
        if operation.is_err() {
            self.request = &[];
        }
        Some(operation)
    }
}

/// Adjacent little-endian numbers of one size; a truncated one is left out.
pub fn elements(bytes: &[u8], size: ElementSize) -> impl Iterator<Item = u64> {
    bytes.chunks_exact(size.bytes()).map(number)
}

fn number(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .rev()
        .fold(0, |value, &byte| value << 8 | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lbp16::Space;

    fn parse(request: &[u8]) -> Vec<Result<Operation<'_>, Lbp16Error>> {
        Operations::new(request).collect()
    }

    #[test]
    fn read_of_the_idrom_is_understood() {
        // Manual: 7I97, "SPACE 0: HOSTMOT2 REGISTERS": 85420004.
        let [Ok(operation)] = parse(&[0x85, 0x42, 0x00, 0x04])[..] else {
            panic!("one operation")
        };
        assert_eq!(operation.command, Command::read(Space::HostMot2, 5));
        assert_eq!(operation.address, Some(0x0400));
        assert_eq!(operation.data, [0_u8; 0]);
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
        assert_eq!(operation.command, Command::write(Space::HostMot2, 4));
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
    }

    #[test]
    fn truncated_command_is_an_error_and_ends_the_parse() {
        fn at(request: &[u8]) -> Result<Operation<'_>, Lbp16Error> {
            *parse(request).last().unwrap()
        }
        let cut_off = |offset, what, expected| {
            Err(Lbp16Error::CutOff {
                offset,
                what,
                expected,
                found: 1,
            })
        };
        assert_eq!(at(&[0x01, 0x02, 0x85]), cut_off(2, "a command word", 2));
        assert_eq!(at(&[0x85, 0x42, 0x00]), cut_off(0, "an address", 2));
        assert_eq!(at(&[0x01, 0xD9, 0x1A, 0x00, 0x02]), cut_off(0, "data", 2));
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
                        end += 2 + operation.data.len();
                        end += 2 * usize::from(operation.address.is_some());
                    }
                    Err(_) => failed = true,
                }
            }
            prop_assert!(failed || end == request.len());
        }

        #[test]
        fn elements_are_little_endian_numbers_of_the_commands_size(
            values in prop::collection::vec(any::<u64>(), 1..=127),
            size in (0_u16..4).prop_map(ElementSize::from_bits),
        ) {
            let write = Command::write(Space::HostMot2, values.len() as u8);
            let command = Command { size, ..write };
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
