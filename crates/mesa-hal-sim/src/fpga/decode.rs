//! Address decoder: the register at each address.

use super::firmware::{COOKIE_ADDRESS, IDROM_ADDRESS, SimFirmware};
use crate::modules::RegisterAddress;

/// Target of an address.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Target {
    /// No register.
    #[default]
    Nothing,
    /// Identification and IDROM, read only: index into the words.
    Rom(u16),
    /// A register of a module.
    Module {
        /// Slot of the module.
        slot: u8,
        /// Register number.
        register: u8,
        /// Instance.
        instance: u8,
    },
}

/// The address space, one entry for each 32-bit word, with the contents of its read-only part.
#[derive(Clone, Debug)]
pub(crate) struct AddressSpace {
    targets: Box<[Target]>,
    rom: Vec<u32>,
}

impl AddressSpace {
    /// The address space of a firmware, without the registers of its modules.
    pub(crate) fn new(firmware: &SimFirmware) -> Self {
        let mut space = Self {
            targets: vec![Target::Nothing; 0x4000].into_boxed_slice(),
            rom: SimFirmware::identification().to_vec(),
        };
        space.rom.extend(firmware.idrom());
        space
    }

    /// The target at a byte address.
    pub(crate) fn at(&self, address: u16) -> Target {
        self.targets
            .get(usize::from(address >> 2))
            .copied()
            .unwrap_or_default()
    }

    /// A word of identification and IDROM.
    pub(crate) fn rom(&self, index: u16) -> u32 {
        self.rom.get(usize::from(index)).copied().unwrap_or(0)
    }

    /// Changes a word of identification or IDROM; no effect at other addresses.
    pub(crate) fn override_rom(&mut self, address: u16, value: u32) {
        if let Target::Rom(index) = self.at(address)
            && let Some(word) = self.rom.get_mut(usize::from(index))
        {
            *word = value;
        }
    }

    /// Maps the registers of the module in a slot, in place of those of its predecessor.
    pub(crate) fn map(&mut self, slot: usize, registers: &[RegisterAddress]) {
        let Ok(slot) = u8::try_from(slot) else {
            return;
        };
        for target in &mut self.targets {
            if matches!(target, Target::Module { slot: of, .. } if *of == slot) {
                *target = Target::Nothing;
            }
        }
        for &RegisterAddress {
            address,
            register,
            instance,
        } in registers
        {
            let target = Target::Module {
                slot,
                register,
                instance,
            };
            self.put(address, target);
        }
        self.map_rom();
    }

    /// Maps identification and IDROM, over the registers of any module.
    fn map_rom(&mut self) {
        for index in 0..self.rom.len() as u16 {
            let address = match index.checked_sub(4) {
                None => COOKIE_ADDRESS + 4 * index,
                Some(word) => IDROM_ADDRESS + 4 * word,
            };
            self.put(address, Target::Rom(index));
        }
    }

    fn put(&mut self, address: u16, target: Target) {
        if let Some(slot) = self.targets.get_mut(usize::from(address >> 2)) {
            *slot = target;
        }
    }
}
