//! The FPGA's configuration port, as far as a reload needs it.

const SYNC: [u16; 2] = [0xAA99, 0x5566];
/// Type 1, operation write, before register and number of words.
const TYPE1_WRITE: u16 = 0b0_0110;
const REGISTER_COMMAND: u16 = 0x05;
const REGISTER_GENERAL1: u16 = 0x13;
const REGISTER_GENERAL2: u16 = 0x14;
const COMMAND_DESYNC: u16 = 0x0D;
const COMMAND_IPROG: u16 = 0x0E;

/// The ICAP port, word by word: the packets of a Spartan-6 (its configuration guide, UG380).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Icap {
    synced: bool,
    previous: u16,
    register: u16,
    words: u16,
    general1: u16,
    general2: u16,
}

impl Icap {
    /// Writes a word. If the word starts a reload, returns the flash address to load from.
    pub(super) fn write(&mut self, word: u16) -> Option<u32> {
        let previous = core::mem::replace(&mut self.previous, word);
        if !self.synced {
            self.synced = [previous, word] == SYNC;
            return None;
        }
        if self.words > 0 {
            self.words -= 1;
            return self.data(word);
        }
        if word >> 11 == TYPE1_WRITE {
            self.register = word >> 5 & 0x3F;
            self.words = word & 0x1F;
        }
        None
    }

    fn data(&mut self, word: u16) -> Option<u32> {
        match (self.register, word) {
            (REGISTER_GENERAL1, _) => self.general1 = word,
            (REGISTER_GENERAL2, _) => self.general2 = word,
            (REGISTER_COMMAND, COMMAND_DESYNC) => *self = Self::default(),
            (REGISTER_COMMAND, COMMAND_IPROG) => {
                return Some(u32::from(self.general2 & 0xFF) << 16 | u32::from(self.general1));
            }
            _ => {}
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reload(words: &[u16]) -> Option<u32> {
        let mut icap = Icap::default();
        words
            .iter()
            .fold(None, |found, &word| icap.write(word).or(found))
    }

    #[test]
    fn sequence_for_a_reload_gives_the_address() {
        let words = [
            0xFFFF, 0xFFFF, 0xAA99, 0x5566, 0x3261, 0x1234, 0x3281, 0x0B10, 0x30A1, 0x000E, 0x2000,
        ];
        assert_eq!(reload(&words), Some(0x10_1234));
    }

    #[test]
    fn icap_takes_no_command_without_sync_or_after_its_end() {
        assert_eq!(reload(&[0x30A1, 0x000E]), None);
        assert_eq!(reload(&[0xAA99, 0x30A1, 0x000E]), None);
        let words = [0xAA99, 0x5566, 0x30A1, 0x000D, 0x30A1, 0x000E];
        assert_eq!(reload(&words), None);
    }
}
