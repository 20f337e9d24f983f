//! The remote's side of the wire: decodes requests from characters and times.

use super::buffers::MAX_FRAME;
use crate::wire::Nanos;
use mesa_wire::lbp::crc8;

/// Frame timeout until the host sets one, in bit times: four characters.
pub(super) const DEFAULT_TIMEOUT: u8 = 40;

/// A command byte of 40 to 7F: an access to memory.
///
/// Manual: 7I77, "LBP DATA READ/WRITE COMMAND".
#[derive(Clone, Copy, Debug)]
pub(super) struct MemoryAccess(u8);

impl MemoryAccess {
    /// `None` for any other command.
    pub(super) const fn from_byte(byte: u8) -> Option<Self> {
        if byte & 0xC0 == 0x40 {
            Some(Self(byte))
        } else {
            None
        }
    }

    /// Write instead of read (bit 5).
    pub(super) const fn is_write(self) -> bool {
        self.0 & 0x20 != 0
    }

    /// In an RPC list: the data is in the list instead of the stream (bit 4, RID).
    pub(super) const fn includes_data(self) -> bool {
        self.0 & 0x10 != 0
    }

    /// Increment of the address afterwards: the length of the data, or 0 (bit 3).
    pub(super) const fn step(self) -> u16 {
        if self.0 & 0x08 == 0 {
            0
        } else {
            self.bytes() as u16
        }
    }

    /// Two address bytes follow; otherwise the current address is used (bit 2).
    pub(super) const fn has_address(self) -> bool {
        self.0 & 0x04 != 0
    }

    /// Bytes read or written (bits 1..0).
    pub(super) const fn bytes(self) -> usize {
        1 << (self.0 & 3)
    }

    /// Number of data bytes after the address.
    pub(super) const fn data_len(self) -> usize {
        if self.is_write() { self.bytes() } else { 0 }
    }
}

/// A request that a remote received, with a valid CRC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ReceivedRequest {
    /// The command byte, 40 to FF.
    pub(super) command: u8,
    /// The address in the request.
    pub(super) address: Option<u16>,
    data: [u8; MAX_FRAME],
    len: usize,
}

impl ReceivedRequest {
    fn new(body: &[u8]) -> Option<Self> {
        let (&command, rest) = body.split_first()?;
        let (address, rest) = match (MemoryAccess::from_byte(command), rest) {
            (Some(access), [low, high, rest @ ..]) if access.has_address() => {
                (Some(u16::from_le_bytes([*low, *high])), rest)
            }
            _ => (None, rest),
        };
        let mut data = [0; MAX_FRAME];
        data.get_mut(..rest.len())?.copy_from_slice(rest);
        Some(Self {
            command,
            address,
            data,
            len: rest.len(),
        })
    }

    /// The data in the request.
    pub(super) fn data(&self) -> &[u8] {
        self.data.get(..self.len).unwrap_or(&[])
    }

    /// The first data byte, 0 without data.
    pub(super) fn byte(&self) -> u8 {
        self.data().first().copied().unwrap_or(0)
    }
}

/// Result of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parsed {
    /// The request is not complete yet, or the character was skipped.
    Pending,
    /// The character completed a request.
    Request(ReceivedRequest),
    /// The character completed a frame with a wrong CRC; the frame is dropped.
    CrcError,
    /// The character is not a command. All characters are skipped until the line has been idle.
    NotACommand,
    /// The character began a frame that exceeds the buffer. All characters are skipped until the
    /// line has been idle.
    Overflow,
}

/// Incremental parser of a remote: takes characters with times, returns complete requests.
///
/// A partial frame is dropped when the line has been idle for longer than the frame timeout.
/// Manual: 7I77, "FRAMING"; FACTS 1.5.
///
/// # Real time
/// Bounded by a constant for each character; does not allocate.
#[derive(Clone, Debug)]
pub(super) struct Parser {
    /// Length of a bit; a character has ten.
    pub(super) bit: Nanos,
    /// Frame timeout in bit times (command EB). 0 counts as 1: without any timeout, one lost
    /// character would silence the remote permanently.
    pub(super) timeout_bits: u8,
    buffer: [u8; MAX_FRAME],
    len: usize,
    expected: usize,
    skipping: bool,
    last: Nanos,
}

impl Parser {
    /// A parser with the default frame timeout.
    pub(super) const fn new(bit: Nanos) -> Self {
        Self {
            bit,
            timeout_bits: DEFAULT_TIMEOUT,
            buffer: [0; MAX_FRAME],
            len: 0,
            expected: 0,
            skipping: false,
            last: 0,
        }
    }

    /// Drops a partial frame if the character that ends at `at` exceeds the frame timeout; returns
    /// the number of dropped characters.
    pub(super) fn expire(&mut self, at: Nanos) -> Option<usize> {
        let idle = at.saturating_sub(self.last + 10 * self.bit);
        if idle <= Nanos::from(self.timeout_bits.max(1)) * self.bit {
            return None;
        }
        self.skipping = false;
        let dropped = core::mem::take(&mut self.len);
        (dropped > 0).then_some(dropped)
    }

    /// Takes the character that ended at `at`. `rpc_len` returns the number of data bytes in a
    /// request of an RPC, which determines its end.
    pub(super) fn push(
        &mut self,
        at: Nanos,
        byte: u8,
        rpc_len: impl FnOnce(u8) -> usize,
    ) -> Parsed {
        self.expire(at);
        self.last = at;
        if self.skipping {
            return Parsed::Pending;
        }
        if self.len == 0 {
            self.expected = match byte {
                0x00..=0x3F => {
                    self.skipping = true;
                    return Parsed::NotACommand;
                }
                0x40..=0x7F => {
                    let access = MemoryAccess(byte);
                    2 + 2 * usize::from(access.has_address()) + access.data_len()
                }
                0x80..=0xBF => 2 + rpc_len(byte),
                // Local reads and the reset of the parser consist of the command only.
                0xC0..=0xDF | 0xFF => 2,
                0xE0..=0xFE => 3,
            };
            if self.expected > MAX_FRAME {
                self.skipping = true;
                return Parsed::Overflow;
            }
        }
        if let Some(slot) = self.buffer.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
        if self.len < self.expected {
            return Parsed::Pending;
        }
        let frame = self.buffer.get(..core::mem::take(&mut self.len));
        match frame.and_then(<[u8]>::split_last) {
            Some((&crc, body)) if crc8(body) == crc => {
                ReceivedRequest::new(body).map_or(Parsed::Pending, Parsed::Request)
            }
            _ => Parsed::CrcError,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_wire::lbp::{PROCESS_DATA, Request};
    use proptest::prelude::*;

    const BIT: u64 = 400;
    const CHARACTER: u64 = 10 * BIT;

    fn feed(parser: &mut Parser, at: &mut u64, bytes: &[u8], rpc_len: usize) -> Parsed {
        let mut last = Parsed::Pending;
        for &byte in bytes {
            *at += CHARACTER;
            last = parser.push(*at, byte, |_| rpc_len);
        }
        last
    }

    #[test]
    fn partial_frame_is_dropped_at_the_timeout_and_the_next_taken() {
        // Transcript t15d: a remote of 13 output bytes gets 12.
        let mut parser = Parser::new(BIT);
        let mut at = 0;
        feed(&mut parser, &mut at, &[0xBD; 14], 13);
        at += u64::from(DEFAULT_TIMEOUT) * BIT + 1;
        assert_eq!(parser.expire(at + CHARACTER), Some(14));
        let parsed = feed(&mut parser, &mut at, &[0xDF, 0x16], 13);
        assert!(matches!(
            parsed,
            Parsed::Request(request) if request.command == 0xDF
        ));
    }

    #[test]
    fn gap_of_exactly_the_frame_timeout_is_allowed() {
        let mut parser = Parser::new(BIT);
        let mut at = 0;
        feed(&mut parser, &mut at, &[0xDF], 0);
        at += u64::from(DEFAULT_TIMEOUT) * BIT;
        let parsed = feed(&mut parser, &mut at, &[0x16], 0);
        assert!(matches!(parsed, Parsed::Request(_)));
    }

    #[test]
    fn bad_crc_is_dropped_and_the_next_frame_is_taken_without_a_gap() {
        let mut parser = Parser::new(BIT);
        let mut at = 0;
        assert_eq!(
            feed(&mut parser, &mut at, &[0xDF, 0x17], 0),
            Parsed::CrcError
        );
        let parsed = feed(&mut parser, &mut at, &[0xDF, 0x16], 0);
        assert!(matches!(parsed, Parsed::Request(_)));
    }

    /// A frame without its CRC, and the number of data bytes if it calls an RPC. FACTS 1.3, 1.4.
    fn any_request() -> impl Strategy<Value = (Vec<u8>, usize)> {
        let data = prop::collection::vec(any::<u8>(), 62);
        (0x40..=0xFFu8, data, 0..=62usize).prop_map(|(command, data, rpc_len)| {
            let len = match command {
                0x40..=0x7F => {
                    let address = if command & 4 == 0 { 0 } else { 2 };
                    let written = if command & 0x20 == 0 {
                        0
                    } else {
                        [1, 2, 4, 8][usize::from(command & 3)]
                    };
                    address + written
                }
                0x80..=0xBF => rpc_len,
                0xC0..=0xDF | 0xFF => 0,
                _ => 1,
            };
            ([&[command], &data[..len]].concat(), rpc_len)
        })
    }

    fn sealed(body: &[u8]) -> Vec<u8> {
        [body, &[crc8(body)]].concat()
    }

    proptest! {
        #[test]
        fn every_request_of_a_host_is_parsed_as_what_it_is((body, size) in any_request()) {
            let mut parser = Parser::new(BIT);
            let parsed = feed(&mut parser, &mut 0, &sealed(&body), size);
            let Parsed::Request(received) = parsed else {
                return Err(TestCaseError::fail("not parsed"));
            };
            let mut again = vec![received.command];
            again.extend(received.address.iter().flat_map(|a| a.to_le_bytes()));
            again.extend(received.data());
            prop_assert_eq!(again, body);
        }

        #[test]
        fn arbitrary_characters_never_panic_and_a_gap_resynchronises(
            noise in prop::collection::vec((any::<u8>(), 0..60_000u64), 0..200),
            size in 0..300usize,
        ) {
            let mut parser = Parser::new(BIT);
            let mut at = 0;
            for (byte, gap) in noise {
                at += gap;
                parser.push(at, byte, |_| size);
            }
            at += 1_000_000;
            let parsed = feed(&mut parser, &mut at, &[0xDF, 0x16], size);
            prop_assert!(matches!(parsed, Parsed::Request(_)));
        }

        #[test]
        fn flipped_bit_never_makes_another_request_of_the_same_length(
            (body, size) in any_request(), flip in any::<prop::sample::Index>(),
        ) {
            let mut frame = sealed(&body);
            // Not in the command byte, which determines the length.
            let bit = flip.index((frame.len() - 1) * 8);
            frame[1 + bit / 8] ^= 1 << (bit % 8);
            let mut parser = Parser::new(BIT);
            let mut at = 0;
            prop_assert_eq!(
                feed(&mut parser, &mut at, &frame, size),
                Parsed::CrcError
            );
        }
    }

    #[test]
    fn longest_frame_fits_and_a_longer_one_is_an_overflow() {
        let mut parser = Parser::new(BIT);
        let request = Request::rpc(PROCESS_DATA, &[7; MAX_FRAME - 2], 0);
        let mut at = 0;
        assert!(matches!(
            feed(&mut parser, &mut at, request.as_bytes(), MAX_FRAME - 2),
            Parsed::Request(_)
        ));
        assert_eq!(
            parser.push(at + CHARACTER, 0xBD, |_| MAX_FRAME - 1),
            Parsed::Overflow
        );
    }
}
