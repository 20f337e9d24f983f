//! Who has the user LEDs of a board: its FPGA, or the firmware of its network side.

use super::EthernetError;
use super::packets::{Lbp16Board, QUICK, run};
use super::{EthernetBoard, packets::read_words};
use crate::lbp16::{Space, registers};

/// What the user LEDs of a board show.
///
/// Source: manual 7I97, "MEMORY SPACE 6 LAYOUT", LEDMode, and "ETHERNET EEPROM LAYOUT", DEBUG LED
/// Mode: only the lowest bit counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LedMode {
    /// What `HostMot2` says: the pins `led.CR01` to `led.CR04`.
    HostMot2,
    /// A variable of the network side, usually the number of packets received. Boards come so.
    Debug,
}

impl LedMode {
    const DEBUG: u16 = 1;

    const fn of(word: u16) -> Self {
        if word & Self::DEBUG == 0 {
            Self::HostMot2
        } else {
            Self::Debug
        }
    }

    /// The word with this mode, and all else as it was.
    const fn put(self, word: u16) -> u16 {
        match self {
            Self::HostMot2 => word & !Self::DEBUG,
            Self::Debug => word | Self::DEBUG,
        }
    }
}

impl<B: Lbp16Board> EthernetBoard<B> {
    /// What the user LEDs show at present.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn led_mode(&mut self) -> Result<LedMode, EthernetError<B::Error>> {
        let [word] = read_words(self.bus(), Space::Control, registers::control::LED_MODE)?;
        Ok(LedMode::of(word))
    }

    /// Gives the user LEDs to the FPGA or to the network side, from now on until the board restarts;
    /// reads it back. Until they are the FPGA's, the driver's LED pins show nothing.
    ///
    /// # Errors
    /// [`EthernetError::NotTaken`], and those of the bus.
    pub fn set_led_mode(&mut self, mode: LedMode) -> Result<(), EthernetError<B::Error>> {
        let address = registers::control::LED_MODE;
        let [word] = read_words(self.bus(), Space::Control, address)?;
        let expected = mode.put(word);
        let mut reply = [0; 2];
        run(self.bus(), &mut reply, QUICK, |request| {
            request.write_words(Space::Control, address, &[expected])?;
            request.read(Space::Control, address, 1).map(drop)
        })?;
        let found = u16::from_le_bytes(reply);
        if LedMode::of(found) != mode {
            return Err(EthernetError::NotTaken {
                address,
                expected,
                found,
            });
        }
        Ok(())
    }

    /// What the user LEDs show after a restart, as the EEPROM says.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn eeprom_led_mode(&mut self) -> Result<LedMode, EthernetError<B::Error>> {
        let [word] = read_words(self.bus(), Space::Eeprom, registers::eeprom::LED_MODE)?;
        Ok(LedMode::of(word))
    }

    /// Sets in the EEPROM what the user LEDs show after each restart, and reads it back. What they
    /// show now stays: see [`set_led_mode`](Self::set_led_mode).
    ///
    /// # Errors
    /// [`EthernetError::NotWritten`], and those of the bus.
    pub fn set_eeprom_led_mode(&mut self, mode: LedMode) -> Result<(), EthernetError<B::Error>> {
        let address = registers::eeprom::LED_MODE;
        let [word] = read_words(self.bus(), Space::Eeprom, address)?;
        // The EEPROM wears out with writes.
        if LedMode::of(word) == mode {
            return Ok(());
        }
        self.write_eeprom(address, [mode.put(word)])
    }
}
