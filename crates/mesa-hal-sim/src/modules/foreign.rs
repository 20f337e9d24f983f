//! Modules that the simulator does not implement.

use core::any::Any;
use core::fmt;

use super::SimIoPorts;
use crate::fpga::DriveSignal;
use crate::wire::Nanos;

/// A module of a user's own gateware, for the address space of a [`SimFpga`](crate::SimFpga).
///
/// The [`SimFirmware`](crate::SimFirmware) needs a
/// [`SimModuleDescriptor`](crate::SimModuleDescriptor) with its GTAG, which gives the place of its
/// registers, and [`SimPinDescriptor`](crate::SimPinDescriptor)s for the I/O pins that the module
/// can use.
pub trait ForeignModule: Any + fmt::Debug + Send {
    /// Reads register `register` of an instance.
    fn read(&mut self, now: Nanos, register: u8, instance: u8) -> u32;

    /// Writes register `register` of an instance.
    fn write(&mut self, now: Nanos, register: u8, instance: u8, value: u32);

    /// The module's output on pin `pin` of an instance, as far as the I/O port passes it on.
    fn level(&self, now: Nanos, instance: u8, pin: u8) -> bool;

    /// Takes a level of input `pin` of an instance from outside of the board
    /// ([`SimFpga::drive_pin`](crate::SimFpga::drive_pin)): for modules that count or latch its edges.
    /// The default ignores it.
    fn set_input(&mut self, now: Nanos, instance: u8, pin: u8, level: bool) {
        let _ = (now, instance, pin, level);
    }

    /// Resets the module at a new configuration of the FPGA: as after power-up.
    fn reload(&mut self, now: Nanos);

    /// The signal of output `output` to a drive, made by the circuit behind the module's pins: for
    /// an axis whose [`DriveSource`](crate::DriveSource) is this module. The module numbers its own
    /// outputs.
    ///
    /// `io` gives the source of the circuit's pins by [`SimIoPorts::source`]: a module's signal
    /// does not reach a pin that is an input, as after a bite of the watchdog.
    ///
    /// The simulator takes the signal after the host has accessed the module, after a change of a
    /// pin's set-up or a bite of the watchdog, each millisecond, and at
    /// [`next_change`](Self::next_change). Without an implementation the drive has 0 V and is not
    /// enabled.
    fn drive_signal(&self, now: Nanos, output: u8, io: &SimIoPorts) -> DriveSignal {
        let _ = (now, output, io);
        DriveSignal::default()
    }

    /// The time, later than `now`, of the next spontaneous change of an output signal. The default
    /// is none.
    fn next_change(&self, now: Nanos) -> Option<Nanos> {
        let _ = now;
        None
    }
}

/// All foreign modules, with their GTAGs.
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

    /// The signal of an output; the default signal if the module does not exist.
    pub(crate) fn drive_signal(
        &self,
        gtag: u8,
        now: Nanos,
        output: u8,
        io: &SimIoPorts,
    ) -> DriveSignal {
        let module = self.get(gtag);
        module.map_or(DriveSignal::default(), |module| {
            module.drive_signal(now, output, io)
        })
    }

    /// The first time after `now` at which an output changes spontaneously.
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
