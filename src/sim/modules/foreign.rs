//! A module that the simulator does not know.

use core::any::Any;
use core::fmt;

use crate::sim::wire::Nanos;

/// A module of somebody's own gateware, for the address space of a [`SimFpga`](crate::sim::SimFpga).
///
/// The [`Firmware`](crate::sim::Firmware) needs a [`ModuleDescriptor`](crate::sim::ModuleDescriptor)
/// with its GTAG, which says where its registers are, and
/// [`PinDescriptor`](crate::sim::PinDescriptor)s for the I/O pins that it can use.
pub trait ForeignModule: Any + fmt::Debug + Send {
    /// Reads register `register` of an instance.
    fn read(&mut self, now: Nanos, register: u8, instance: u8) -> u32;

    /// Writes register `register` of an instance.
    fn write(&mut self, now: Nanos, register: u8, instance: u8, value: u32);

    /// What it puts out on pin `pin` of an instance, where the I/O port lets it.
    fn level(&self, now: Nanos, instance: u8, pin: u8) -> bool;

    /// The FPGA is configured again: everything is as after power-up.
    fn reload(&mut self, now: Nanos);
}

/// All that were added, with their GTAGs.
#[derive(Debug, Default)]
pub(crate) struct ForeignModules(Vec<(u8, Box<dyn ForeignModule>)>);

impl ForeignModules {
    pub(crate) fn add(&mut self, gtag: u8, module: Box<dyn ForeignModule>) {
        self.0.retain(|(other, _)| *other != gtag);
        self.0.push((gtag, module));
    }

    pub(crate) fn get(&self, gtag: u8) -> Option<&dyn ForeignModule> {
        let found = self.0.iter().find(|(other, _)| *other == gtag);
        found.map(|(_, module)| &**module)
    }

    pub(crate) fn get_mut(&mut self, gtag: u8) -> Option<&mut dyn ForeignModule> {
        let found = self.0.iter_mut().find(|(other, _)| *other == gtag);
        found.map(|(_, module)| &mut **module)
    }

    pub(crate) fn reload(&mut self, now: Nanos) {
        for (_, module) in &mut self.0 {
            module.reload(now);
        }
    }
}
