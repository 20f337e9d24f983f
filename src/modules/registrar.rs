//! Where a module registers what it reads, writes and is set up with.

use alloc::format;
use alloc::vec::Vec;
use core::fmt;

use super::events::Sink;
use super::undriven::check;
use super::{RegisterError, Settings};

use crate::bus::ImagePlan;
use crate::hal::{GroupId, PinMaker, PinStore, Place};
use crate::hostmot2::board_table::BoardTable;
use crate::hostmot2::{Gtag, HostMot2, IoPorts, ModuleDescriptor};

/// A module of the firmware that is driven.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrivenModule {
    pub descriptor: ModuleDescriptor,
    /// The number of its first instance among all of its kind, which pin descriptors and names count
    /// from.
    pub first: u8,
}

impl DrivenModule {
    /// The number of an instance among all of its kind.
    pub const fn number(&self, instance: u8) -> u8 {
        self.first.saturating_add(instance)
    }
}

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
    /// Where what happened is told.
    pub(crate) events: &'a Sink,
    /// Where registers are registered.
    pub image: &'a mut ImagePlan,
    /// The kinds of modules that were asked for, see [`module`](Self::module).
    pub(crate) claimed: &'a mut Vec<Gtag>,
    /// Reads a register.
    pub(crate) bus: &'a mut dyn FnMut(u16) -> Result<u32, RegisterError>,
}

impl Registrar<'_> {
    /// What the firmware says of the first module of a kind; `None` if it has none. The kind counts as
    /// driven from now on, and is not among the driver's
    /// [remarks](crate::driver::RemarkKind::Undriven).
    pub fn module(&mut self, gtag: Gtag) -> Option<ModuleDescriptor> {
        self.claimed.push(gtag);
        self.firmware.find(gtag).copied()
    }

    /// The modules of these kinds that are driven, in the order of their descriptors.
    pub(crate) fn driven(&self, kinds: &[Gtag]) -> Vec<DrivenModule> {
        let modules = self.firmware.modules.iter();
        let kinds = modules.filter(|module| kinds.contains(&module.gtag));
        kinds
            .filter_map(|module| {
                let mut same = self.firmware.modules_of(module.gtag);
                let (first, _) = same.find(|(_, other)| core::ptr::eq(*other, module))?;
                check(module).ok()?;
                Some(DrivenModule {
                    descriptor: *module,
                    first,
                })
            })
            .collect()
    }

    /// Makes something of each instance of these modules, as far as they are driven.
    pub(crate) fn each_instance<T>(
        &mut self,
        kinds: &[Gtag],
        make: impl Fn(&mut Self, &DrivenModule, u8) -> Result<T, RegisterError>,
    ) -> Result<Vec<T>, RegisterError> {
        let mut all = Vec::new();
        for module in self.driven(kinds) {
            for instance in 0..module.descriptor.instances {
                all.push(make(self, &module, instance)?);
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
        self.maker(stem).at(place)
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
    /// [`Stage::Drive`](crate::bus::Stage::Drive) on.
    ///
    /// # Errors
    /// [`RegisterError::Firmware`]: they are in use.
    pub fn use_io(&mut self, gtag: Gtag, instance: u8) -> Result<(), RegisterError> {
        self.io
            .use_module(self.firmware, gtag, instance, |_| true)?;
        Ok(())
    }
}

impl fmt::Debug for Registrar<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Registrar")
            .field("name", &self.name)
            .field("image", &self.image)
            .finish_non_exhaustive()
    }
}
