//! The registers of a generator.

use super::firmware::Firmware;
use super::pins::PulseSetup;
use crate::bus::{Phase, ReadSlot, Setting, Stage, WriteSlot};
use crate::hostmot2::ModuleDescriptor;
use crate::modules::{RegisterError, Registrar, WriteCycle};

/// The registers of a generator.
#[derive(Debug)]
pub(super) struct Registers {
    pub rate: WriteSlot,
    pub accumulator: ReadSlot,
    pub mode: Setting,
    /// MODE as it reads back; only in version C2.
    pub shown_mode: Option<ReadSlot>,
    dir_setup: Setting,
    dir_hold: Setting,
    step_len: Setting,
    step_space: Setting,
    table: Option<Table>,
}

/// A shift register of 16 entries: all of them are always written together, the first one last.
#[derive(Debug)]
struct Table {
    entries: [Setting; 16],
    last: Setting,
}

impl Registers {
    pub fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        instance: u8,
        pulses: &PulseSetup,
        firmware: Firmware,
    ) -> Result<Self, RegisterError> {
        let [
            rate,
            accumulator,
            mode,
            dir_setup,
            dir_hold,
            step_len,
            step_space,
        ] = registers(module, instance)?;
        let mut setting = |address, word: u32| r.image.setting(Stage::Configure, address, word);
        // Times before the mode, and all of them before the master rate.
        let ticks = &pulses.ticks;
        let dir_setup = setting(dir_setup, ticks.dir_setup);
        let dir_hold = setting(dir_hold, ticks.dir_hold);
        let step_len = setting(step_len, ticks.step_len);
        let step_space = setting(step_space, ticks.step_space);
        let table = if firmware.has_table {
            let (data, last) = (module.register(7, instance)?, module.register(8, instance)?);
            let entries = r.image.sequence(Stage::Configure, data, [0; 16]);
            let last = r.image.setting(Stage::Configure, last, pulses.table_max);
            Some(Table { entries, last })
        } else {
            None
        };
        // Last: the outputs of a table follow it at once.
        let mode_setting = r.image.setting(Stage::Configure, mode, pulses.mode);
        Ok(Self {
            rate: r.image.output(rate, 0),
            accumulator: r.image.read(Phase::Data, accumulator),
            mode: mode_setting,
            shown_mode: firmware.has_latch.then(|| r.image.read(Phase::Data, mode)),
            dir_setup,
            dir_hold,
            step_len,
            step_space,
            table,
        })
    }

    /// Changes the settings of the pulses; the mode follows with the latch.
    pub fn set(&self, cycle: &mut WriteCycle<'_>, old: &PulseSetup, new: &PulseSetup) {
        let ticks = &new.ticks;
        cycle.words.set(self.dir_setup, ticks.dir_setup);
        cycle.words.set(self.dir_hold, ticks.dir_hold);
        cycle.words.set(self.step_len, ticks.step_len);
        cycle.words.set(self.step_space, ticks.step_space);
        let Some(table) = &self.table else {
            return;
        };
        if old.table != new.table {
            // The value written last is the first entry.
            for (entry, word) in table.entries.iter().zip(new.table.iter().rev()) {
                cycle.words.set(*entry, (*word).into());
                cycle.words.repeat(*entry);
            }
            // Puts the pointer to the first entry.
            cycle.words.repeat(table.last);
        }
        cycle.words.set(table.last, new.table_max);
    }
}

/// The addresses of the first registers of an instance.
fn registers(module: &ModuleDescriptor, instance: u8) -> Result<[u16; 7], RegisterError> {
    let mut addresses = [0; 7];
    for (register, address) in (0..).zip(&mut addresses) {
        *address = module.register(register, instance)?;
    }
    Ok(addresses)
}
