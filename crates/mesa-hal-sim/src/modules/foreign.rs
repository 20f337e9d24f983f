//! A module that the simulator does not know.

use core::any::Any;
use core::fmt;

use super::IoPorts;
use crate::fpga::DriveSignal;
use crate::wire::Nanos;

/// A module of somebody's own gateware, for the address space of a [`SimFpga`](crate::SimFpga).
///
/// The [`Firmware`](crate::Firmware) needs a [`ModuleDescriptor`](crate::ModuleDescriptor)
/// with its GTAG, which says where its registers are, and
/// [`PinDescriptor`](crate::PinDescriptor)s for the I/O pins that it can use.
pub trait ForeignModule: Any + fmt::Debug + Send {
    /// Reads register `register` of an instance.
    fn read(&mut self, now: Nanos, register: u8, instance: u8) -> u32;

    /// Writes register `register` of an instance.
    fn write(&mut self, now: Nanos, register: u8, instance: u8, value: u32);

    /// What it puts out on pin `pin` of an instance, where the I/O port lets it.
    fn level(&self, now: Nanos, instance: u8, pin: u8) -> bool;

    /// The FPGA is configured again: everything is as after power-up.
    fn reload(&mut self, now: Nanos);

    /// The signal that a drive gets from output `output`, which the circuit behind the module's pins
    /// makes: for an axis whose [`DriveSource`](crate::DriveSource) is this module. The outputs
    /// are the module's to number.
    ///
    /// `io` tells by [`IoPorts::source`] what the pins of the circuit are driven from: a module's
    /// signal does not get out of a pin that is an input, as after a bite of the watchdog.
    ///
    /// The simulator takes the signal whenever the host has accessed the module, set up a pin or let
    /// the watchdog bite, each millisecond, and at [`next_change`](Self::next_change). Without an
    /// implementation the drive has 0 V and is not enabled.
    fn drive_signal(&self, now: Nanos, output: u8, io: &IoPorts) -> DriveSignal {
        let _ = (now, output, io);
        DriveSignal::default()
    }

    /// The time, later than `now`, at which a signal of its outputs next changes by itself. Without
    /// an implementation none does.
    fn next_change(&self, now: Nanos) -> Option<Nanos> {
        let _ = now;
        None
    }
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

    /// The signal of an output; none if the module is not there.
    pub(crate) fn drive_signal(
        &self,
        gtag: u8,
        now: Nanos,
        output: u8,
        io: &IoPorts,
    ) -> DriveSignal {
        let module = self.get(gtag);
        module.map_or(DriveSignal::default(), |module| {
            module.drive_signal(now, output, io)
        })
    }

    /// The first time after `now` at which an output changes by itself.
    pub(crate) fn next_change(&self, now: Nanos) -> Option<Nanos> {
        let modules = self.0.iter();
        modules.filter_map(|(_, one)| one.next_change(now)).min()
    }

    pub(crate) fn reload(&mut self, now: Nanos) {
        for (_, module) in &mut self.0 {
            module.reload(now);
        }
    }
}
