//! The place where a module registers the registers that it reads, writes and is set up with.

use alloc::boxed::Box;
use alloc::format;
use alloc::vec::Vec;
use core::fmt;

use super::{Module, RegisterError};
use crate::events::EventSink;

use crate::bus::ImagePlan;
use crate::hal::{GroupId, PinMaker, PinStore, Place};
use crate::hostmot2::board_table::BoardTable;
use crate::hostmot2::{
    CountedKind, Gtag, HostMot2, IoPorts, ModuleDescriptor, ModuleInstance, PinDescriptor,
};
use crate::settings::Settings;

/// A module of the firmware that is driven.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrivenModule {
    pub descriptor: ModuleDescriptor,
    /// The number of its first instance among all instances of its kind; the base for pin
    /// descriptors and names.
    pub first: u8,
    /// All instances of the module are used; else `descriptor` has the number of those in use.
    pub is_whole: bool,
}

impl DrivenModule {
    /// The number of an instance among all instances of its kind.
    pub const fn number(&self, instance: u8) -> u8 {
        self.first.saturating_add(instance)
    }

    /// An instance, by its number within this module.
    pub const fn instance(&self, instance: u8) -> ModuleInstance {
        ModuleInstance::new(self.descriptor.gtag, self.number(instance))
    }
}

/// The environment in which a module is made.
///
/// Registering a register defines everything about it. Used during set-up: it allocates, and the
/// board has not been written to yet.
pub struct Registrar<'a> {
    /// The description of the board's firmware.
    pub firmware: &'a HostMot2,
    /// The table of this kind of board.
    pub board: &'static BoardTable,
    /// Prefix of the pin names, for example `hm2_7i92.0`.
    pub name: &'a str,
    /// The settings of the application: the period of the cycle, and more.
    pub settings: &'a Settings,
    /// The group of the module's pins, a part of the board's group: its pins are valid and armed
    /// together with all pins of the board.
    pub group: GroupId,
    /// The group of the driver's own pins, which stay valid after any failure.
    pub(crate) status: GroupId,
    /// The store in which pins are made.
    pub pins: &'a mut PinStore,
    pub(crate) io: &'a mut IoPorts,
    /// Sink of the driver's events.
    pub(crate) events: &'a EventSink,
    /// The plan in which registers are registered.
    pub image: &'a mut ImagePlan,
    /// The modules that this registration has [added](Self::add).
    pub(crate) added: &'a mut Vec<Box<dyn Module>>,
    /// The kinds of modules that were requested, see [`module`](Self::module).
    pub(crate) claimed: &'a mut Vec<Gtag>,
    /// True if kind, version and layout of a module are supported.
    pub(crate) is_driven: fn(&ModuleDescriptor) -> bool,
    /// Reads a register.
    pub(crate) bus: &'a mut dyn FnMut(u16) -> Result<u32, RegisterError>,
}

impl Registrar<'_> {
    /// Returns the descriptor of the first module of a kind; `None` if the firmware has none. The
    /// kind counts as driven from now on, and does not appear among the driver's
    /// [remarks](crate::driver::RemarkKind::Undriven).
    pub fn module(&mut self, gtag: Gtag) -> Option<ModuleDescriptor> {
        self.claimed.push(gtag);
        self.firmware.find(gtag).copied()
    }

    /// The modules of these kinds that are driven, in the order of their descriptors, each with the
    /// number of instances in use ([`Settings::instances`]). LEDs are no instances. Kinds that are
    /// counted together have to be asked for together.
    pub(crate) fn driven(&self, kinds: &[Gtag]) -> Vec<DrivenModule> {
        let mut left = self.settings.instances.clone();
        let mut driven = Vec::new();
        let modules = self.firmware.modules.iter();
        for module in modules.filter(|module| kinds.contains(&module.gtag)) {
            let mut same = self.firmware.modules_of(module.gtag);
            let first = same.find(|(_, other)| core::ptr::eq(*other, module));
            let (Some((first, _)), true) = (first, (self.is_driven)(module)) else {
                continue;
            };
            let mut descriptor = *module;
            let kind = CountedKind::of(module.gtag);
            if let Some(left) = kind.and_then(|kind| left.get_mut(&kind.key())) {
                if *left == 0 {
                    continue;
                }
                if module.gtag != Gtag::LED {
                    descriptor.instances = module.instances.min(*left);
                    *left = left.saturating_sub(descriptor.instances);
                }
            }
            driven.push(DrivenModule {
                descriptor,
                first,
                is_whole: descriptor.instances == module.instances,
            });
        }
        driven
    }

    /// Makes one item for each instance of a kind of module, in the order of the descriptors:
    /// `make` gets the descriptor, the number of the instance within it, for
    /// [`register`](ModuleDescriptor::register), and its number among all instances of the kind,
    /// for names and [pins](Self::use_io). Empty if the firmware has none. The kind counts as
    /// driven, as after [`module`](Self::module).
    ///
    /// ```
    /// use mesa_hal::bus::{Phase, ReadSlot};
    /// use mesa_hal::hostmot2::Gtag;
    /// use mesa_hal::modules::{RegisterError, Registrar};
    ///
    /// /// The counts of all scaler counters.
    /// fn counts(r: &mut Registrar<'_>) -> Result<Vec<ReadSlot>, RegisterError> {
    ///     r.each_instance(Gtag::SCALER, |r, module, instance, number| {
    ///         r.use_io(Gtag::SCALER, number)?;
    ///         Ok(r.image.read(Phase::Data, module.register(0, instance)?))
    ///     })
    /// }
    /// ```
    ///
    /// # Errors
    /// Those of `make`.
    pub fn each_instance<T>(
        &mut self,
        gtag: Gtag,
        mut make: impl FnMut(&mut Self, ModuleDescriptor, u8, u8) -> Result<T, RegisterError>,
    ) -> Result<Vec<T>, RegisterError> {
        self.claimed.push(gtag);
        let modules: Vec<_> = self.firmware.modules_of(gtag).collect();
        let mut all = Vec::new();
        for (first, &module) in modules {
            for instance in 0..module.instances {
                let number = first.saturating_add(instance);
                all.push(make(self, module, instance, number)?);
            }
        }
        Ok(all)
    }

    /// True if the driver runs the firmware's phase-locked loop: a module whose registers can be
    /// latched by one of the loop's timers (1 to 4) may select it, in a setting of its own. The
    /// times of the timers are the pins `dpll.NN.timer-us`.
    ///
    /// ```
    /// # use mesa_hal::bus::Stage;
    /// # use mesa_hal::hostmot2::ModuleDescriptor;
    /// # use mesa_hal::modules::{RegisterError, Registrar};
    /// # fn latch(r: &mut Registrar<'_>, module: ModuleDescriptor) -> Result<(), RegisterError> {
    /// if r.has_dpll() {
    ///     let latched_by = module.register(3, 0)?;
    ///     r.image.setting(Stage::Configure, latched_by, 2); // timer 2
    /// }
    /// # Ok(())
    /// # }
    /// ```
    pub fn has_dpll(&self) -> bool {
        !self.driven(&[Gtag::HM2DPLL]).is_empty()
    }

    /// Makes one item for each instance of these modules, as far as they are driven.
    pub(crate) fn each_driven<T>(
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

    /// Makes pins in the module's [group](Self::group), with names that begin with the board's name
    /// and `stem`: `hm2_7i92.0.led.` for `led.`.
    pub fn maker(&mut self, stem: &str) -> PinMaker<'_> {
        let stem = format!("{}.{stem}", self.name);
        PinMaker::new(self.pins, self.group, stem)
    }

    /// Makes pins like [`maker`](Self::maker), at a place on the board.
    pub fn maker_at(&mut self, stem: &str, place: Place) -> PinMaker<'_> {
        self.maker(stem).at(place)
    }

    /// Adds a module to the cycle, with the registers and pins that were registered for it. If the
    /// registration fails afterwards, the module is discarded.
    pub fn add(&mut self, module: impl Module) {
        self.added.push(Box::new(module));
    }

    /// Reads a register at once.
    ///
    /// # Errors
    /// [`RegisterError::Peek`]: the bus failed. Pass it on; the driver then fails with the error of
    /// the bus.
    pub fn peek(&mut self, address: u16) -> Result<u32, RegisterError> {
        (self.bus)(address)
    }

    /// Gives instance `instance` of a module its I/O pins: the module drives its outputs from
    /// [`Stage::Drive`](crate::bus::Stage::Drive) on.
    ///
    /// # Errors
    /// [`RegisterError::Firmware`]: the pins are in use.
    pub fn use_io(&mut self, gtag: Gtag, instance: u8) -> Result<(), RegisterError> {
        self.use_io_if(gtag, instance, |_| true)
    }

    /// As [`use_io`](Self::use_io), for those pins of the instance that are `wanted`; the others
    /// stay plain I/O.
    ///
    /// ```
    /// # use mesa_hal::hostmot2::{Gtag, PinDescriptor};
    /// # use mesa_hal::modules::{RegisterError, Registrar};
    /// # fn pins(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
    /// // The step output alone, number 1, which the module drives: bit 7.
    /// r.use_io_if(Gtag(0x99), 0, |pin: PinDescriptor| pin.secondary_pin == 0x81)?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`use_io`](Self::use_io).
    pub fn use_io_if(
        &mut self,
        gtag: Gtag,
        instance: u8,
        wanted: impl Fn(PinDescriptor) -> bool,
    ) -> Result<(), RegisterError> {
        self.io.use_module(self.firmware, gtag, instance, wanted)?;
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
