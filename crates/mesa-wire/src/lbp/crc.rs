//! The CRC-8 of LBP.

use crc::{CRC_8_MAXIM_DOW, Crc, Table};

const CRC: Crc<u8, Table<1>> = Crc::<u8, Table<1>>::new(&CRC_8_MAXIM_DOW);

/// CRC-8 of `data`: x^8+x^5+x^4+1, reflected, no initial value and no final xor.
///
/// A request's CRC covers all its bytes, command included; a reply's covers the reply data only,
/// so a reply without data is the single byte 00.
///
/// Source: manual 7I77, "CRC"; FACTS 1.1.
pub fn crc8(data: &[u8]) -> u8 {
    CRC.checksum(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crc_of_the_check_string_and_of_recorded_frames() {
        assert_eq!(crc8(b"123456789"), 0xA1);
        // Gateware transcript t03: cookie request and reply, frame timeout, discovery reply.
        assert_eq!(crc8(&[0xDF]), 0x16);
        assert_eq!(crc8(&[0x5A]), 0xA5);
        assert_eq!(crc8(&[0xEB, 0x28]), 0xB7);
        assert_eq!(crc8(&[0x05, 0x02, 0x9A, 0x04, 0xA4, 0x04]), 0xB8);
        assert_eq!(crc8(&[]), 0x00);
    }
}
