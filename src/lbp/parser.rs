//! The remote's side of the wire: requests out of characters and times.

use super::{Command, MAX_FRAME, RpcNumber, crc8};

/// How many data bytes the requests of a remote's RPCs carry: the parser has to know to find
/// their end.
pub trait RpcSizes {
    /// Data bytes between the RPC's command byte and its CRC.
    fn request_len(&self, number: RpcNumber) -> usize;
}

/// A request as a remote received it, its CRC checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceivedRequest {
    /// The command.
    pub command: Command,
    /// The address that came with it.
    pub address: Option<u16>,
    data: [u8; MAX_FRAME],
    len: u8,
}

impl ReceivedRequest {
    /// The data that came with it.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&[])
    }

    /// The first data byte, 0 without data.
    pub fn byte(&self) -> u8 {
        self.data().first().copied().unwrap_or(0)
    }
}

/// What a character did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parsed {
    /// The request is not complete yet, or the character was skipped.
    Pending,
    /// It completed a request.
    Request(ReceivedRequest),
    /// It completed a frame whose CRC is wrong; the frame is dropped.
    CrcError,
    /// It is no command. Everything is skipped until the line has been idle.
    NotACommand,
    /// It began a frame that does not fit the buffer. Everything is skipped until the line has
    /// been idle.
    Overflow,
}

/// What a [`Parser`] has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParserCounts {
    /// Requests with a good CRC.
    pub requests: u32,
    /// Frames with a bad one.
    pub crc_errors: u32,
    /// Partial frames dropped by the frame timeout.
    pub timeouts: u32,
    /// Characters that began no command.
    pub not_commands: u32,
    /// Frames longer than the buffer.
    pub overflows: u32,
}

/// Incremental parser of a remote: characters with times in, complete requests out.
///
/// A partial frame is dropped when the line has been idle for longer than the frame timeout.
/// Manual: 7I77, "FRAMING"; FACTS 1.5.
///
/// # Real time
/// Bounded by a constant for each character; allocates nothing.
#[derive(Clone, Debug)]
pub struct Parser {
    buffer: [u8; MAX_FRAME],
    len: usize,
    expected: usize,
    skipping: bool,
    last: u64,
    bit: u64,
    timeout_bits: u8,
    counts: ParserCounts,
}

impl Parser {
    /// Frame timeout until the host sets one, in bit times: four characters.
    pub const DEFAULT_TIMEOUT: u8 = 40;

    /// A parser for characters of ten bits of `bit` nanoseconds.
    pub const fn new(bit: u64) -> Self {
        Self {
            buffer: [0; MAX_FRAME],
            len: 0,
            expected: 0,
            skipping: false,
            last: 0,
            bit,
            timeout_bits: Self::DEFAULT_TIMEOUT,
            counts: ParserCounts {
                requests: 0,
                crc_errors: 0,
                timeouts: 0,
                not_commands: 0,
                overflows: 0,
            },
        }
    }

    /// Sets the frame timeout in bit times (command EB). 0 counts as 1: without any timeout, one
    /// lost character would silence the remote for good.
    pub const fn set_timeout(&mut self, bits: u8) {
        self.timeout_bits = bits;
    }

    /// The frame timeout in bit times.
    pub const fn timeout(&self) -> u8 {
        self.timeout_bits
    }

    /// Changes the length of a bit, in nanoseconds.
    pub const fn set_bit(&mut self, bit: u64) {
        self.bit = bit;
    }

    /// What came in so far.
    pub const fn counts(&self) -> ParserCounts {
        self.counts
    }

    /// Drops what is there of a frame.
    pub const fn reset(&mut self) {
        self.len = 0;
        self.skipping = false;
    }

    /// Drops a partial frame if the character that ends at `at` (nanoseconds) comes later than the
    /// frame timeout allows; says how many characters were dropped.
    pub fn expire(&mut self, at: u64) -> Option<usize> {
        let idle = at.saturating_sub(self.last + 10 * self.bit);
        let waiting = self.len > 0 || self.skipping;
        if !waiting || idle <= u64::from(self.timeout_bits.max(1)) * self.bit {
            return None;
        }
        let dropped = self.len;
        self.reset();
        (dropped > 0).then(|| {
            self.counts.timeouts = self.counts.timeouts.wrapping_add(1);
            dropped
        })
    }

    /// Takes the character that ended at `at` nanoseconds.
    pub fn push(&mut self, at: u64, byte: u8, sizes: &impl RpcSizes) -> Parsed {
        self.expire(at);
        self.last = at;
        if self.skipping {
            return Parsed::Pending;
        }
        if self.len == 0 {
            let Some(command) = Command::from_byte(byte) else {
                self.skipping = true;
                self.counts.not_commands = self.counts.not_commands.wrapping_add(1);
                return Parsed::NotACommand;
            };
            self.expected = frame_len(command, sizes);
            if self.expected > MAX_FRAME {
                self.skipping = true;
                self.counts.overflows = self.counts.overflows.wrapping_add(1);
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
        self.complete()
    }

    fn complete(&mut self) -> Parsed {
        let frame = self.buffer.get(..self.len).unwrap_or(&[]);
        self.len = 0;
        let Some((&crc, body)) = frame.split_last() else {
            return Parsed::Pending;
        };
        if crc8(body) != crc {
            self.counts.crc_errors = self.counts.crc_errors.wrapping_add(1);
            return Parsed::CrcError;
        }
        match request(body) {
            Some(request) => {
                self.counts.requests = self.counts.requests.wrapping_add(1);
                Parsed::Request(request)
            }
            None => Parsed::Pending,
        }
    }
}

fn frame_len(command: Command, sizes: &impl RpcSizes) -> usize {
    2 + match command {
        Command::Access(access) => access.address_len() + access.data_len(),
        Command::Rpc(number) => sizes.request_len(number),
        Command::LocalRead(_) => 0,
        Command::LocalWrite(write) => write.data_len(),
    }
}

fn request(body: &[u8]) -> Option<ReceivedRequest> {
    let (&first, rest) = body.split_first()?;
    let command = Command::from_byte(first)?;
    let (address, rest) = match (command, rest) {
        (Command::Access(access), [low, high, rest @ ..]) if access.with_address => {
            (Some(u16::from_le_bytes([*low, *high])), rest)
        }
        _ => (None, rest),
    };
    let mut data = [0; MAX_FRAME];
    for (to, &from) in data.iter_mut().zip(rest) {
        *to = from;
    }
    Some(ReceivedRequest {
        command,
        address,
        data,
        len: rest.len() as u8,
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Access, DataSize, LocalRead, LocalWrite, Request};
    use super::*;
    use proptest::prelude::*;

    struct Sizes(usize);

    impl RpcSizes for Sizes {
        fn request_len(&self, _number: RpcNumber) -> usize {
            self.0
        }
    }

    const BIT: u64 = 400;
    const CHARACTER: u64 = 10 * BIT;

    fn feed(parser: &mut Parser, at: &mut u64, bytes: &[u8], sizes: &Sizes) -> Parsed {
        let mut last = Parsed::Pending;
        for &byte in bytes {
            *at += CHARACTER;
            last = parser.push(*at, byte, sizes);
        }
        last
    }

    #[test]
    fn a_partial_frame_is_dropped_after_the_frame_timeout_and_the_next_one_is_taken() {
        // transcript t15d: a remote of 13 output bytes gets 12
        let mut parser = Parser::new(BIT);
        let mut at = 0;
        feed(&mut parser, &mut at, &[0xBD; 14], &Sizes(13));
        at += u64::from(Parser::DEFAULT_TIMEOUT) * BIT + 1;
        assert_eq!(parser.expire(at + CHARACTER), Some(14));
        let parsed = feed(&mut parser, &mut at, &[0xDF, 0x16], &Sizes(13));
        assert!(matches!(
            parsed,
            Parsed::Request(request) if request.command == Command::LocalRead(LocalRead::Cookie)
        ));
        assert_eq!(parser.counts().timeouts, 1);
    }

    #[test]
    fn a_gap_of_exactly_the_frame_timeout_is_allowed() {
        let mut parser = Parser::new(BIT);
        let mut at = 0;
        feed(&mut parser, &mut at, &[0xDF], &Sizes(0));
        at += u64::from(Parser::DEFAULT_TIMEOUT) * BIT;
        let parsed = feed(&mut parser, &mut at, &[0x16], &Sizes(0));
        assert!(matches!(parsed, Parsed::Request(_)));
    }

    #[test]
    fn a_bad_crc_is_dropped_and_the_next_frame_is_taken_without_a_gap() {
        let mut parser = Parser::new(BIT);
        let mut at = 0;
        assert_eq!(
            feed(&mut parser, &mut at, &[0xDF, 0x17], &Sizes(0)),
            Parsed::CrcError
        );
        let parsed = feed(&mut parser, &mut at, &[0xDF, 0x16], &Sizes(0));
        assert!(matches!(parsed, Parsed::Request(_)));
    }

    fn any_request() -> impl Strategy<Value = (Request, usize)> {
        let access =
            (0x40..=0x7Fu8, any::<u16>(), any::<[u8; 8]>()).prop_map(|(byte, at, data)| {
                let access = Access::from_byte(byte).unwrap();
                let address = access.with_address.then_some(at);
                let request = Request::access(access, address, &data[..access.data_len()]);
                (request.unwrap(), 0)
            });
        let read = (0xC0..=0xDFu8)
            .prop_map(|byte| (Request::local_read(LocalRead::from_byte(byte).unwrap()), 0));
        let write = (0xE0..=0xFFu8, any::<u8>()).prop_map(|(byte, data)| {
            (
                Request::local_write(LocalWrite::from_byte(byte).unwrap(), data),
                0,
            )
        });
        let rpc = (0..64u8, prop::collection::vec(any::<u8>(), 0..=62)).prop_map(|(n, data)| {
            let request = Request::rpc(RpcNumber::new(n).unwrap(), &data, 4).unwrap();
            (request, data.len())
        });
        prop_oneof![access, read, write, rpc]
    }

    proptest! {
        #[test]
        fn every_request_of_a_host_is_parsed_as_what_it_is((request, size) in any_request()) {
            let mut parser = Parser::new(BIT);
            let mut at = 0;
            let frame = request.as_bytes();
            let parsed = feed(&mut parser, &mut at, frame, &Sizes(size));
            let Parsed::Request(received) = parsed else {
                return Err(TestCaseError::fail("not parsed"));
            };
            prop_assert_eq!(Some(received.command), request.command());
            let mut again = vec![received.command.to_byte()];
            again.extend(received.address.iter().flat_map(|a| a.to_le_bytes()));
            again.extend(received.data());
            prop_assert_eq!(&again[..], &frame[..frame.len() - 1]);
        }

        #[test]
        fn arbitrary_characters_never_panic_and_a_gap_always_resynchronises(
            noise in prop::collection::vec((any::<u8>(), 0..60_000u64), 0..200),
            size in 0..300usize,
        ) {
            let mut parser = Parser::new(BIT);
            let mut at = 0;
            for (byte, gap) in noise {
                at += gap;
                parser.push(at, byte, &Sizes(size));
            }
            at += 1_000_000;
            let parsed = feed(&mut parser, &mut at, &[0xDF, 0x16], &Sizes(size));
            prop_assert!(matches!(parsed, Parsed::Request(_)));
        }

        #[test]
        fn a_flipped_bit_in_a_frame_is_never_taken_for_another_request_of_the_same_length(
            (request, size) in any_request(), flip in any::<prop::sample::Index>(),
        ) {
            let mut frame = request.as_bytes().to_vec();
            // not in the command byte: that changes the length
            let bit = flip.index((frame.len() - 1) * 8);
            frame[1 + bit / 8] ^= 1 << (bit % 8);
            let mut parser = Parser::new(BIT);
            let mut at = 0;
            prop_assert_eq!(
                feed(&mut parser, &mut at, &frame, &Sizes(size)),
                Parsed::CrcError
            );
        }
    }

    #[test]
    fn longest_frame_fits_and_a_longer_one_is_an_overflow() {
        let mut parser = Parser::new(BIT);
        let request = Request::rpc(RpcNumber::PROCESS_DATA, &[7; MAX_FRAME - 2], 0).unwrap();
        let mut at = 0;
        let sizes = Sizes(MAX_FRAME - 2);
        assert!(matches!(
            feed(&mut parser, &mut at, request.as_bytes(), &sizes),
            Parsed::Request(_)
        ));
        assert_eq!(
            parser.push(at + CHARACTER, 0xBD, &Sizes(MAX_FRAME - 1)),
            Parsed::Overflow
        );
        assert!(
            Request::access(Access::write(DataSize::Word), Some(0), &[1]).is_err(),
            "a word takes two bytes"
        );
    }
}
