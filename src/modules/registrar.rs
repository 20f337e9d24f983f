//! Where a module registers what it reads, writes and is set up with.

use alloc::format;
use alloc::vec::Vec;
use core::fmt;

use super::{RegisterError, Settings};

use crate::bus::{ImagePlan, Phase, ReadSlot, Setting, Stage, WriteSlot};
use crate::hal::{GroupId, PinMaker, PinStore, Place};
use crate::hostmot2::board_table::BoardTable;
use crate::hostmot2::{Gtag, HostMot2, IoPorts, ModuleDescriptor};

/// What a module is made from.
///
/// Registering a register says everything about it. Belongs to set-up: it allocates, and nothing is
/// written to the board yet.
pub struct Registrar<'a> {
    /// What the board's firmware says of itself.
    pub firmware: &'a HostMot2,
    /// What is known of this kind of board.
    pub board: &'static BoardTable,
    /// What the names of its pins begin with, for example `hm2_7i92.0`.
    pub name: &'a str,
    /// What the application asks for: the period of the cycle, and more.
    pub settings: &'a Settings,
    /// The group of the module's pins, a part of that of the board: they are valid and armed together
    /// with all of the board.
    pub group: GroupId,
    /// The group of the driver's own pins, which are valid whatever fails.
    pub(crate) status: GroupId,
    /// Where pins are made.
    pub pins: &'a mut PinStore,
    pub(crate) io: &'a mut IoPorts,
    pub(crate) plan: &'a mut ImagePlan,
    /// Reads a register.
    pub(crate) bus: &'a mut dyn FnMut(u16) -> Result<u32, RegisterError>,
}

/// What there is.
impl Registrar<'_> {
    /// What the firmware says of a module; `None` if it has none.
    pub fn module(&self, gtag: Gtag) -> Option<ModuleDescriptor> {
        self.firmware.find(gtag).copied()
    }

    /// Makes something of each instance of these modules, as far as the firmware has them.
    pub(crate) fn each_instance<T>(
        &mut self,
        kinds: &[Gtag],
        make: impl Fn(&mut Self, &ModuleDescriptor, u8) -> Result<T, RegisterError>,
    ) -> Result<Vec<T>, RegisterError> {
        let mut all = Vec::new();
        for module in kinds.iter().filter_map(|&gtag| self.firmware.find(gtag)) {
            for instance in 0..module.instances {
                all.push(make(self, module, instance)?);
            }
        }
        Ok(all)
    }

    /// Makes pins of the module's [group](Self::group), whose names begin with the board's and `stem`:
    /// `hm2_7i92.0.led.` for `led.`.
    pub fn maker(&mut self, stem: &str) -> PinMaker<'_> {
        let stem = format!("{}.{stem}", self.name);
        PinMaker::new(self.pins, self.group, stem)
    }

    /// The same for pins at a place on the board.
    pub fn maker_at(&mut self, stem: &str, place: Place) -> PinMaker<'_> {
        self.maker(stem).at(place.terminal, place.signal)
    }

    /// Reads a register at once.
    ///
    /// # Errors
    /// [`RegisterError::Peek`]: the bus failed. Pass it on; the driver then fails with the error of
    /// the bus.
    pub fn peek(&mut self, address: u16) -> Result<u32, RegisterError> {
        (self.bus)(address)
    }

    /// Gives instance `instance` of a module its I/O pins: those that it drives are driven by it from
    /// [`Stage::Drive`] on.
    ///
    /// # Errors
    /// [`RegisterError::Firmware`]: it has none, or they are in use.
    pub fn use_io(&mut self, gtag: Gtag, instance: u8) -> Result<(), RegisterError> {
        self.io
            .use_module(self.firmware, gtag, instance, |_| true)?;
        Ok(())
    }
}

/// Registers. Their addresses are multiples of 4. Any number of modules may read a register; one may
/// write it.
impl Registrar<'_> {
    /// Data that is read in every cycle.
    pub fn input(&mut self, address: u16) -> ReadSlot {
        self.plan.read(Phase::Data, address)
    }

    /// Read in every cycle before everything else: what latches or marks a time.
    pub fn latch(&mut self, address: u16) -> ReadSlot {
        self.plan.read(Phase::First, address)
    }

    /// Read in every cycle before data: what says whether the data can be trusted.
    pub fn status(&mut self, address: u16) -> ReadSlot {
        self.plan.read(Phase::Status, address)
    }

    /// Read in every cycle after all data: what says whether the board is the one that was set up.
    pub fn evidence(&mut self, address: u16) -> ReadSlot {
        self.plan.read(Phase::Evidence, address)
    }

    /// Data that is only read after somebody [asked](super::WriteCycle::ask_extra) for it, and when
    /// the driver looks closely.
    pub fn extra_input(&mut self, address: u16) -> ReadSlot {
        self.plan.read_extra(Phase::Data, address)
    }

    /// Data that is written in every cycle, and as `safe` in [`Stage::Configure`] of the set-up.
    pub fn output(&mut self, address: u16, safe: u32) -> WriteSlot {
        self.plan.output(address, safe)
    }

    /// Data that is written in every cycle, and not with the set-up: nothing uses it before a
    /// [`trigger`](Self::trigger).
    pub(crate) fn process_data(&mut self, address: u16) -> WriteSlot {
        self.plan.write(Phase::Data, address, 0)
    }

    /// Written in every cycle after all data, as `idle` until something else is put.
    pub fn trigger(&mut self, address: u16, idle: u32) -> WriteSlot {
        self.plan.write(Phase::Trigger, address, idle)
    }

    /// Written at set-up, when it changes, and after a reset: always with the word it has then.
    ///
    /// One of [`Stage::Drive`] or [`Stage::Enable`] that changes in the cycle is only written to a
    /// board that is seen to be set up before and after it.
    pub fn setting(&mut self, stage: Stage, address: u16, word: u32) -> Setting {
        self.plan.setting(stage, address, word)
    }

    /// The directions of the pins of a port: a setting of [`Stage::Drive`] that is evidence as well,
    /// where the board reads it back.
    pub(crate) fn drive(&mut self, address: u16, word: u32) -> Setting {
        self.plan.drive(address, word)
    }

    /// Written in the cycles in which it changes or is [repeated](super::WriteCycle::repeat), and never
    /// with the set-up.
    pub fn on_demand(&mut self, address: u16) -> Setting {
        self.plan.on_demand(address)
    }

    /// A write of the set-up whose word stays. Within a stage, the set-up is written in the order in
    /// which it is registered.
    pub fn step(&mut self, stage: Stage, address: u16, word: u32) {
        self.plan.step(stage, address, word);
    }
}

impl fmt::Debug for Registrar<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Registrar")
            .field("name", &self.name)
            .field("plan", &self.plan)
            .finish_non_exhaustive()
    }
}
