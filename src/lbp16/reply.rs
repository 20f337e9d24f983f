//! A reply as a host sees it.

use core::ops::Range;

use byteorder::{ByteOrder, LittleEndian};

use super::Lbp16Error;

/// A reply of the right length.
///
/// The ranges are those that [`RequestBuilder`](super::RequestBuilder) returned.
///
/// # Real time
/// Does not allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply<'a> {
    bytes: &'a [u8],
}

impl<'a> Reply<'a> {
    /// The reply to a request whose builder expects `expected` bytes.
    pub fn new(bytes: &'a [u8], expected: usize) -> Result<Self, Lbp16Error> {
        if bytes.len() == expected {
            return Ok(Self { bytes });
        }
        Err(Lbp16Error::ReplyLength {
            expected,
            actual: bytes.len(),
        })
    }

    /// The bytes of one read.
    pub fn bytes(&self, at: Range<usize>) -> Result<&'a [u8], Lbp16Error> {
        let len = self.bytes.len();
        let (start, end) = (at.start, at.end);
        self.bytes
            .get(at)
            .ok_or(Lbp16Error::Outside { start, end, len })
    }

    /// The registers of a read of 16-bit elements.
    pub fn words(&self, at: Range<usize>) -> Result<impl Iterator<Item = u16> + 'a, Lbp16Error> {
        let bytes = self.bytes(at)?;
        Ok(bytes.chunks_exact(2).map(LittleEndian::read_u16))
    }

    /// The registers of a read of 32-bit elements.
    pub fn doubles(&self, at: Range<usize>) -> Result<impl Iterator<Item = u32> + 'a, Lbp16Error> {
        let bytes = self.bytes(at)?;
        Ok(bytes.chunks_exact(4).map(LittleEndian::read_u32))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lbp16::{RequestBuilder, Space};

    #[test]
    fn the_sample_run_of_the_manual_is_understood() {
        // Manual: 7I97, "ELBPCOM": 01420001 -> fecaaa55; 82492000 -> 450a5863.
        let mut buffer = [0; 16];
        let mut request = RequestBuilder::new(&mut buffer);
        let cookie = request.read(Space::HostMot2, 0x0100, 1).unwrap();
        let address = request.read(Space::Eeprom, 0x0020, 2).unwrap();
        let bytes = [0xFE, 0xCA, 0xAA, 0x55, 0x45, 0x0A, 0x58, 0x63];
        let reply = Reply::new(&bytes, request.reply_len()).unwrap();
        let cookie: Vec<_> = reply.doubles(cookie).unwrap().collect();
        assert_eq!(cookie, [0x55AA_CAFE]);
        let address: Vec<_> = reply.words(address).unwrap().collect();
        assert_eq!(address, [[69, 10], [88, 99]].map(u16::from_le_bytes));
    }

    #[test]
    fn a_reply_of_another_length_is_refused() {
        let error = Reply::new(&[0; 3], 4).unwrap_err();
        let expected = Lbp16Error::ReplyLength {
            expected: 4,
            actual: 3,
        };
        assert_eq!(error, expected);
    }

    proptest! {
        #[test]
        fn arbitrary_replies_and_ranges_never_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..64),
            start: usize,
            end: usize,
        ) {
            let reply = Reply::new(&bytes, bytes.len()).unwrap();
            for at in [start..end, start % 64..end % 64] {
                let inside = at.start <= at.end && at.end <= bytes.len();
                prop_assert_eq!(reply.bytes(at.clone()).is_ok(), inside);
                prop_assert_eq!(reply.words(at.clone()).is_ok(), inside);
                prop_assert_eq!(reply.doubles(at).is_ok(), inside);
            }
        }
    }
}
