//! LEDs in the cycle.

use super::{Making, PartError};
use crate::boards::fpga::LedPins;
use crate::bus::ImagePlan;
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hostmot2::{Gtag, Leds};

/// The user LEDs: CR01 to CR04 of the boards with Ethernet.
/// Manual: 7I97, "BOARD STATUS LEDS".
const LEDS: usize = 4;

/// The board's LEDs.
#[derive(Debug)]
pub(in crate::driver) struct LedModule {
    registers: Leds,
    pins: LedPins,
    word: Option<SettingSlot>,
}

impl LedModule {
    /// The LEDs of a firmware, if it has any.
    pub fn build(parts: &mut Making<'_>) -> Result<Option<Self>, PartError> {
        if parts.firmware.find(Gtag::LED).is_none() {
            return Ok(None);
        }
        let registers = Leds::locate(parts.firmware)?;
        let pins = LedPins::new(parts.pins, parts.group, parts.board, LEDS)?;
        parts.made.leds = Some(pins.clone());
        Ok(Some(Self {
            registers,
            pins,
            word: None,
        }))
    }
}

impl Module for LedModule {
    fn set_up(&self, list: &mut SetupList) {
        list.push(self.registers.data, 0);
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        self.word = Some(SettingSlot::claim(plan, self.registers.data, 0));
    }

    fn take(&mut self, _: &mut Take<'_>) {}

    /// Written when it changes: an LED is not worth eight bytes in every packet.
    fn put(&mut self, cycle: &mut Put<'_>) {
        let word = self.pins.word(cycle.pins);
        cycle.change(self.word, word);
    }
}
