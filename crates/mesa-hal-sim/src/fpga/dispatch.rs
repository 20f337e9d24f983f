//! Accesses to the registers of modules.

use mesa_wire::bus::Direction;

use super::fabric::Fabric;
use crate::modules::{Settles, SimModule};

impl Fabric {
    /// Reads a register of the module in a slot.
    pub(super) fn read(&mut self, slot: usize, register: u8, instance: u8) -> u32 {
        let word = self.access(slot, Direction::Read, |module, fabric| {
            module.read(fabric, register, instance)
        });
        word.unwrap_or(0)
    }

    /// Writes a register of the module in a slot; true if driven outputs may have changed.
    pub(super) fn write(&mut self, slot: usize, register: u8, instance: u8, value: u32) -> bool {
        let drives = self.access(slot, Direction::Write, |module, fabric| {
            module.write(fabric, register, instance, value);
            module.is_driving()
        });
        drives.unwrap_or(false)
    }

    fn access<R>(
        &mut self,
        slot: usize,
        access: Direction,
        work: impl FnOnce(&mut dyn SimModule, &mut Self) -> R,
    ) -> Option<R> {
        let settles = self.modules.at(slot)?.settles(access);
        let is_settled = self.settle_for(settles);
        let result = self.with(slot, work);
        self.modules.accessed(slot, self.now);
        // The simulator's own modules change no output when they are read.
        if is_settled && (access == Direction::Write || settles == Settles::Drives) {
            self.plant.take_from(slot, &self.modules, &self.io);
        }
        result
    }

    /// Moves what an access depends on up to the present; true if drives can take new signals.
    fn settle_for(&mut self, settles: Settles) -> bool {
        let is_meant = match settles {
            Settles::Nothing => false,
            Settles::Signals => !self.plant.installation.is_empty(),
            Settles::Drives => self.plant.is_driven_by_modules(),
            Settles::World => true,
        };
        if is_meant {
            self.settle();
        }
        is_meant
    }
}
