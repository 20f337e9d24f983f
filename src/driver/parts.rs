//! The parts of the cycle: watchdog, connection, serial ports and modules.

use alloc::{boxed::Box, vec::Vec};
use core::any::Any;

use super::connection::Connection;
use crate::hal::GroupId;
use crate::modules::Module;
use crate::modules::serial::SerialPort;
use crate::modules::watchdog::Watchdog;

/// All parts of the cycle.
#[derive(Debug)]
pub(super) struct Parts {
    pub watchdog: Watchdog,
    pub connection: Connection,
    pub ports: Vec<SerialPort>,
    pub modules: Vec<ModulePart>,
}

/// A module and the group of its pins.
#[derive(Debug)]
pub(super) struct ModulePart {
    pub module: Box<dyn Module>,
    pub group: GroupId,
    /// The version of the outputs that were put last.
    pub version: Option<u64>,
}

impl Parts {
    /// The modules of a kind.
    pub fn of<M: Module>(&self) -> impl Iterator<Item = &M> {
        let parts = self.modules.iter();
        let all = parts.map(|part| -> &dyn Any { &*part.module });
        let all = all.chain(core::iter::once::<&dyn Any>(&self.watchdog));
        all.filter_map(|module| module.downcast_ref())
    }

    pub fn each(&mut self) -> impl Iterator<Item = &mut dyn Module> {
        let watchdog: &mut dyn Module = &mut self.watchdog;
        let ports = self.ports.iter_mut().map(|port| port as &mut dyn Module);
        let modules = self.modules.iter_mut().map(|part| &mut *part.module);
        core::iter::once(watchdog).chain(ports).chain(modules)
    }
}
