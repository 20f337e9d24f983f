//! What the board keeps when its power is off: EEPROM and flash as bytes.

use byteorder::{ByteOrder, LittleEndian};

use super::{
    Gateware, SimBoard, control::status_after_reset, eeprom::EEPROM_WORDS, flash::FLASH_SIZE,
};

/// How a state begins: what it is, and its format.
const MAGIC: &[u8; 16] = b"mesa-hal board 1";
const EEPROM_LEN: usize = 2 * EEPROM_WORDS;
const LEN: usize = MAGIC.len() + EEPROM_LEN + FLASH_SIZE;

impl<G: Gateware> SimBoard<G> {
    /// EEPROM and flash as bytes, for [`restore`](Self::restore).
    pub fn state(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(LEN);
        bytes.extend_from_slice(MAGIC);
        bytes.extend(
            self.eeprom
                .words()
                .iter()
                .flat_map(|word| word.to_le_bytes()),
        );
        bytes.extend_from_slice(self.flash.memory());
        bytes
    }

    /// Puts EEPROM and flash back, as after a power cycle.
    ///
    /// The first 0x20 bytes of the EEPROM (MAC address and card name) belong to the board and not
    /// to the state: a state of another kind of board is refused.
    pub fn restore(&mut self, state: &[u8]) -> Result<(), StateError> {
        let rest = state.strip_prefix(MAGIC).ok_or(StateError::NoState)?;
        let (eeprom, flash) = rest
            .split_at_checked(EEPROM_LEN)
            .filter(|(_, flash)| flash.len() == FLASH_SIZE)
            .ok_or(StateError::Length {
                expected: LEN,
                actual: state.len(),
            })?;
        let mut words = [0; EEPROM_WORDS];
        LittleEndian::read_u16_into(eeprom, &mut words);
        let own = self.eeprom.words();
        let fixed = mesa_wire::lbp16::registers::eeprom::FIRST_WRITABLE as usize / 2;
        if words.iter().zip(own).take(fixed).any(|(a, b)| a != b) {
            return Err(StateError::OtherBoard);
        }
        self.eeprom.restore(words);
        self.flash.memory_mut().copy_from_slice(flash);
        self.status = status_after_reset(self.eeprom.led_mode());
        Ok(())
    }
}

/// Bytes that are not the state of this board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// Something else altogether.
    #[error("this is no state of a simulated board; name another file")]
    NoState,
    /// A part is missing, or there is too much.
    #[error("a state of {actual} bytes, expected {expected}; it is damaged, delete the file")]
    Length {
        /// Bytes of a whole state.
        expected: usize,
        /// Bytes given.
        actual: usize,
    },
    /// MAC address or card name are different.
    #[error("this is the state of another board; name another file")]
    OtherBoard,
}
