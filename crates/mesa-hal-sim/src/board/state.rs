//! The board's non-volatile state: EEPROM and flash as bytes.

use byteorder::{ByteOrder, LittleEndian};

use super::{
    Gateware, SimBoard, control::status_after_reset, eeprom::EEPROM_WORDS, flash::FLASH_SIZE,
};

/// First bytes of a state: its kind and format.
const MAGIC: &[u8; 16] = b"mesa-hal board 1";
const EEPROM_LEN: usize = 2 * EEPROM_WORDS;
const LEN: usize = MAGIC.len() + EEPROM_LEN + FLASH_SIZE;

impl<G: Gateware> SimBoard<G> {
    /// Exports EEPROM and flash as bytes, for [`restore`](Self::restore).
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

    /// Restores EEPROM and flash, as after a power cycle.
    ///
    /// The first 0x20 bytes of the EEPROM (MAC address and card name) belong to the board and not
    /// to the state: the state of a different board is refused.
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

/// Bytes that are not a state of this board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// The bytes do not begin like a state.
    #[error("this is no state of a simulated board; name another file")]
    NoState,
    /// The state is truncated or too long.
    #[error("a state of {actual} bytes, expected {expected}; it is damaged, delete the file")]
    Length {
        /// Length of a whole state in bytes.
        expected: usize,
        /// Length of the given bytes.
        actual: usize,
    },
    /// MAC address or card name differ.
    #[error(
        "this is the state of a board with another MAC address or card name; name another file"
    )]
    OtherBoard,
}
