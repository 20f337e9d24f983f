//! Spaces 4, 6 and 7: timers, status and control, card information.

use super::BoardConfig;
use crate::wire::Nanos;
use mesa_wire::lbp16::{
    ErrorRegister,
    registers::{control, read_only, timer},
};

/// Words of each of the three spaces.
const WORDS: usize = 16;

/// A sequence of 16-bit registers by byte address.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Words([u16; WORDS]);

impl Words {
    /// The register; 0 past the end.
    pub(super) fn get(&self, address: u16) -> u16 {
        let word = self.0.get(usize::from(address / 2));
        word.copied().unwrap_or(0)
    }

    /// Sets the register.
    pub(super) fn set(&mut self, address: u16, value: u16) {
        if let Some(word) = self.0.get_mut(usize::from(address / 2)) {
            *word = value;
        }
    }

    /// Increments a counter; packet counters wrap to 0 (they serve as sequence numbers).
    pub(super) fn count(&mut self, address: u16) {
        self.set(address, self.get(address).wrapping_add(1));
    }
}

/// Counts an error, up to the maximum of the counter, and sets its bit.
pub(super) fn count_error(status: &mut Words, error: ErrorRegister) {
    let counter = match error {
        ErrorRegister::PARSE => Some(control::PARSE_ERRORS),
        ErrorRegister::MEMORY => Some(control::MEMORY_ERRORS),
        ErrorRegister::WRITE => Some(control::WRITE_ERRORS),
        ErrorRegister::RECEIVE => Some(control::RX_BAD),
        ErrorRegister::TRANSMIT => Some(control::TX_BAD),
        _ => None,
    };
    if let Some(counter) = counter {
        status.set(counter, status.get(counter).saturating_add(1));
    }
    let bits = status.get(control::ERROR) | error.bits();
    status.set(control::ERROR, bits);
}

/// Space 6 after a reset.
pub(super) fn status_after_reset(led_mode: u16) -> Words {
    let mut status = Words::default();
    status.set(control::LED_MODE, led_mode);
    status.set(control::DEBUG_LED_POINTER, control::RX_PACKETS);
    status
}

/// Space 7 after a reset.
pub(super) fn card(config: &BoardConfig) -> Words {
    let mut card = Words::default();
    for (address, word) in (read_only::CARD_NAME..).step_by(2).zip(config.name_words()) {
        card.set(address, word);
    }
    card.set(read_only::LBP_VERSION, config.lbp_version);
    card.set(read_only::FIRMWARE_VERSION, config.firmware_version);
    card.set(read_only::JUMPERS, config.jumpers as u16);
    card
}

/// The free-running microsecond timer.
pub(super) fn microseconds(now: Nanos) -> u16 {
    (now / 1000) as u16
}

/// The HostMot2 timer that a register of space 4 waits for: 0 is the reference, 1 to 4 are the
/// timers.
pub(super) fn waits_for(address: u16) -> Option<u8> {
    let offset = (address & !1).checked_sub(timer::WAIT_FOR_HM2_REFERENCE)? / 2;
    (offset <= 4).then_some(offset as u8)
}
