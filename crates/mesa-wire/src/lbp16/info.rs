//! The info area that describes a space.

use super::{ElementSize, Lbp16Error, Space};

/// High bits of the cookie; the low four bits are the number of the space.
const COOKIE: u16 = 0x5A00;

/// The info area of a space.
///
/// Manual: 7I97, "INFO AREA".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InfoArea {
    /// The described space.
    pub space: Space,
    /// Type of memory, and the permitted accesses.
    pub sizes: MemorySizes,
    /// Sizes of the space, its pages and its erase blocks.
    pub ranges: MemoryRanges,
    /// Current address pointer of the space.
    pub pointer: u16,
    /// Name, padded with zeros.
    pub name: [u8; 8],
}

impl InfoArea {
    /// Length of an info area in words.
    pub const WORDS: usize = 8;

    /// Decodes the words of the info area of `space`.
    ///
    /// # Errors
    /// [`Lbp16Error::Cookie`].
    pub fn parse(space: Space, words: [u16; Self::WORDS]) -> Result<Self, Lbp16Error> {
        let [found, sizes, ranges, pointer, a, b, c, d] = words;
        let expected = COOKIE | space as u16;
        if found != expected {
            return Err(Lbp16Error::Cookie {
                space,
                expected,
                found,
            });
        }
        let [[a0, a1], [b0, b1], [c0, c1], [d0, d1]] = [a, b, c, d].map(u16::to_le_bytes);
        Ok(Self {
            space,
            sizes: MemorySizes(sizes),
            ranges: MemoryRanges(ranges),
            pointer,
            name: [a0, a1, b0, b1, c0, c1, d0, d1],
        })
    }

    /// Encodes the words as a board returns them.
    pub fn words(&self) -> [u16; Self::WORDS] {
        let [a0, a1, b0, b1, c0, c1, d0, d1] = self.name;
        let [a, b, c, d] = [[a0, a1], [b0, b1], [c0, c1], [d0, d1]].map(u16::from_le_bytes);
        let cookie = COOKIE | self.space as u16;
        let Self { sizes, ranges, .. } = self;
        [cookie, sizes.0, ranges.0, self.pointer, a, b, c, d]
    }

    /// The name without its padding; `?` if it is not valid text.
    pub fn name(&self) -> &str {
        text(&self.name)
    }
}

/// The text up to the first zero, without trailing blanks; `?` if it is not valid text.
pub fn text(padded: &[u8]) -> &str {
    let used = padded.split(|&byte| byte == 0).next().unwrap_or(&[]);
    str::from_utf8(used).unwrap_or("?").trim_end()
}

/// Memory type of a space. Manual: 7I97, "INFO AREA MEMSIZES FORMAT".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum MemoryType {
    /// Registers.
    Register = 0x01,
    /// Memory.
    Memory = 0x02,
    /// EEPROM.
    Eeprom = 0x0E,
    /// Flash.
    Flash = 0x0F,
}

/// The MEMSIZES word: writable, type, and permitted element sizes.
///
/// Manual: 7I97, "INFO AREA MEMSIZES FORMAT".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MemorySizes(pub u16);

impl MemorySizes {
    /// The word for a space with a single element size.
    pub const fn new(kind: MemoryType, size: ElementSize, writable: bool) -> Self {
        Self((writable as u16) << 15 | (kind as u16) << 8 | 1 << size as u8)
    }

    /// True if the space can be written.
    pub const fn writable(self) -> bool {
        self.0 & 1 << 15 != 0
    }

    /// Memory type; `None` for a code that the manual does not list.
    pub const fn kind(self) -> Option<MemoryType> {
        match self.0 >> 8 & 0x7F {
            0x01 => Some(MemoryType::Register),
            0x02 => Some(MemoryType::Memory),
            0x0E => Some(MemoryType::Eeprom),
            0x0F => Some(MemoryType::Flash),
            _ => None,
        }
    }

    /// True if elements of this size are permitted.
    pub const fn allows(self, size: ElementSize) -> bool {
        self.0 & 1 << size as u8 != 0
    }
}

/// The MEMRANGES word: address range, page and erase-block size.
///
/// Manual: 7I97, "INFO AREA MEMRANGES FORMAT".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MemoryRanges(pub u16);

impl MemoryRanges {
    /// The word for 2^`erase` bytes per erase block, 2^`page` per page, 2^`range` in all; `erase`
    /// and `page` are 0 for anything but flash.
    pub const fn new(erase: u8, page: u8, range: u8) -> Self {
        Self((erase as u16 & 0x1F) << 11 | (page as u16 & 0x1F) << 6 | range as u16 & 0x3F)
    }

    /// Bytes of an erase block; 1 if nothing needs erasing.
    pub const fn erase_block(self) -> u64 {
        1 << (self.0 >> 11)
    }

    /// Bytes of a page, the unit of a write; 1 if any number can be written.
    pub const fn page(self) -> u64 {
        1 << (self.0 >> 6 & 0x1F)
    }

    /// Size of the space in bytes.
    pub const fn range(self) -> u64 {
        1 << (self.0 & 0x3F)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn memsizes_layout_matches_the_manual() {
        // Manual: 7I97, "INFO AREA MEMSIZES FORMAT": "0x06 means 16 bit and 32 bit operations".
        let sizes = MemorySizes(0x8206);
        assert!(sizes.writable());
        assert_eq!(sizes.kind(), Some(MemoryType::Memory));
        let allowed = [0, 1, 2, 3].map(|bits| sizes.allows(ElementSize::from_bits(bits)));
        assert_eq!(allowed, [false, true, true, false]);
        let flash = MemorySizes::new(MemoryType::Flash, ElementSize::Double, true);
        assert_eq!(flash, MemorySizes(0x8F04));
    }

    #[test]
    fn memranges_layout_matches_the_manual() {
        // Manual: 7I97, "INFO AREA MEMRANGES FORMAT", for the M25P16 of "EEPROM LAYOUT": 2 MB,
        // sectors of 64 KB, pages of 256 bytes.
        let ranges = MemoryRanges::new(16, 8, 21);
        assert_eq!(ranges.0, 0b1000_0010_0001_0101);
        assert_eq!(ranges.erase_block(), 0x1_0000);
        assert_eq!(ranges.page(), 256);
        assert_eq!(ranges.range(), 2 << 20);
        assert_eq!(MemoryRanges(16).erase_block(), 1);
        assert_eq!(MemoryRanges(16).page(), 1);
    }

    #[test]
    fn cookie_names_the_space() {
        let words = [0x5A03, 0x8F04, 0, 0, 0x5046, 0x4147, 0, 0];
        let area = InfoArea::parse(Space::Flash, words).unwrap();
        assert_eq!(area.name(), "FPGA");
        let error = InfoArea::parse(Space::Eeprom, words).unwrap_err();
        let expected = Lbp16Error::Cookie {
            space: Space::Eeprom,
            expected: 0x5A02,
            found: 0x5A03,
        };
        assert_eq!(error, expected);
    }

    proptest! {
        #[test]
        fn arbitrary_words_never_panic_and_good_ones_come_back(words: [u16; 8], space in 0..8_u16) {
            let space = Space::from_bits(space);
            let [_, rest @ ..] = words;
            let mut good = [COOKIE | space as u16; 8];
            good[1..].copy_from_slice(&rest);
            for words in [words, good] {
                if let Ok(area) = InfoArea::parse(space, words) {
                    prop_assert_eq!(area.words(), words);
                    let _ = (area.name(), area.sizes.kind(), area.ranges.range());
                    let _ = (area.ranges.page(), area.ranges.erase_block());
                } else {
                    prop_assert_ne!(words[0], good[0]);
                }
            }
        }
    }
}
