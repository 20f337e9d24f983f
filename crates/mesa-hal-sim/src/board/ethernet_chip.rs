//! Space 1: the registers of the Ethernet chip, a KSZ8851-16.

use super::BoardConfig;

const WORDS: usize = 128;

/// Low word of the MAC address; the other two follow.
const MAC_LOW: usize = 0x10;
/// Chip id and enable register.
const CIDER: usize = 0xC0;
/// Family 88, chip 7, revision 1.
const CHIP_ID: u16 = 0x8872;

/// The register file, for debugging: writes are kept, except that the id does not change.
#[derive(Clone, Debug)]
pub(super) struct EthernetChip {
    words: [u16; WORDS],
}

impl EthernetChip {
    pub(super) fn new(config: &BoardConfig) -> Self {
        let mut this = Self { words: [0; WORDS] };
        let slots = this.words.iter_mut().skip(MAC_LOW / 2);
        for (slot, word) in slots.zip(config.mac_words()) {
            *slot = word;
        }
        this
    }

    /// The register at a byte address; `None` past the end.
    pub(super) fn read(&self, address: u16) -> Option<u16> {
        let word = self.words.get(usize::from(address / 2)).copied()?;
        let is_id = usize::from(address & !1) == CIDER;
        Some(if is_id { CHIP_ID } else { word })
    }

    /// Writes the register at a byte address; `None` past the end.
    pub(super) fn write(&mut self, address: u16, value: u16) -> Option<()> {
        *self.words.get_mut(usize::from(address / 2))? = value;
        Some(())
    }
}
