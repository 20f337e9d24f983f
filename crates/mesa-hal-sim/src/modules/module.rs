//! The interface of a simulated module.

use core::any::Any;
use core::fmt;

use mesa_wire::bus::Direction;

use super::{SimIoPorts, SmartSerial};
use crate::fpga::{DriveSignal, Fabric, SimFirmware, SimModuleDescriptor, SimPinDescriptor};
use crate::wire::Nanos;

/// A HostMot2 module of the simulated FPGA: the simulator's own, or one of a user's gateware.
///
/// A [`SimFpga`](crate::SimFpga) makes a module for each [`SimModuleDescriptor`] of its
/// [`SimFirmware`] from the simulator's table; [`SimFpga::add_module`](crate::SimFpga::add_module)
/// puts a user's own in the place of one. The descriptor gives the place of the registers, and the
/// [`SimPinDescriptor`]s with its GTAG the I/O pins that the module can use.
///
/// Only registers and reset are required. The other functions have a default that suits a module
/// without the feature.
pub trait SimModule: Any + fmt::Debug + Send {
    /// Reads register `register` of an instance.
    fn read(&mut self, fabric: &Fabric, register: u8, instance: u8) -> u32;

    /// Writes register `register` of an instance.
    fn write(&mut self, fabric: &mut Fabric, register: u8, instance: u8, value: u32);

    /// Resets the module at a new configuration of the FPGA: as after power-up. What is outside of
    /// the FPGA, such as the levels at its inputs, stays.
    fn reload(&mut self, configuration: &Configuration<'_>);

    /// The addresses of the module's registers. The default is those of its descriptor.
    fn addresses(&self, configuration: &Configuration<'_>) -> Vec<RegisterAddress> {
        configuration.addresses(configuration.module.registers)
    }

    /// What moves up to the present before the host accesses the module. The default is
    /// [`Settles::Drives`].
    fn settles(&self, access: Direction) -> Settles {
        let _ = access;
        Settles::Drives
    }

    /// True if a write can change driven outputs at once: the [`Director`](crate::Director)
    /// observes each. The default is false.
    fn is_driving(&self) -> bool {
        false
    }

    /// The module's signal at one of its I/O pins, as far as the I/O port passes it on. The default
    /// is 1, like idle serial lines and signals between their pulses.
    fn level(&self, now: Nanos, pin: SimPinDescriptor) -> bool {
        let _ = (now, pin);
        true
    }

    /// Takes a level of one of its I/O pins from outside of the board
    /// ([`SimFpga::drive_pin`](crate::SimFpga::drive_pin)): for modules that count or latch its
    /// edges. The default ignores it.
    fn set_input(&mut self, now: Nanos, pin: SimPinDescriptor, level: bool) {
        let _ = (now, pin, level);
    }

    /// Takes a new set-up of the I/O pins; also called at power-up. The default ignores it.
    fn pins_changed(&mut self, now: Nanos, io: &SimIoPorts) {
        let _ = (now, io);
    }

    /// The signal of output `output` to a drive, made by the circuit behind the module's pins: for
    /// an axis whose [`DriveSource`](crate::DriveSource) is this module. The module numbers its own
    /// outputs.
    ///
    /// `io` gives the source of the circuit's pins by [`SimIoPorts::source`]: a module's signal
    /// does not reach a pin that is an input, as after a bite of the watchdog.
    ///
    /// The simulator takes the signal after the host has accessed the module, after a change of a
    /// pin's set-up or a bite of the watchdog, each millisecond, and at
    /// [`next_event`](Self::next_event). By default the drive has 0 V and is not enabled.
    fn drive_signal(&self, now: Nanos, output: u8, io: &SimIoPorts) -> DriveSignal {
        let _ = (now, output, io);
        DriveSignal::default()
    }

    /// The time, later than `now`, of the next spontaneous change of an output. The simulator asks
    /// again after each access and each event. The default is none.
    fn next_event(&self, now: Nanos) -> Option<Nanos> {
        let _ = now;
        None
    }

    /// Handles the event that is due at `now`, and returns its effect. The default has nothing to
    /// handle: its outputs follow from the time.
    fn event(&mut self, now: Nanos) -> Effect {
        let _ = now;
        Effect::Outputs
    }

    /// Advances to `to`, before motors do, and reports changes of outputs that drives follow at
    /// their exact time. The default does nothing, and returns false: the module need not be called
    /// again.
    fn advance(&mut self, fabric: &mut Fabric, to: Nanos) -> bool {
        let _ = (fabric, to);
        false
    }

    /// The timer of the DPLL at whose rising edge the module latches its registers, 0 for the
    /// reference, if one is selected. The default is none.
    fn latching_timer(&self) -> Option<u8> {
        None
    }

    /// Latches the registers at a rise of the timer. The default does nothing.
    fn latch(&mut self, edge: Nanos) {
        let _ = edge;
    }

    /// The smart serial ports of the module. The default is none.
    fn ports(&self) -> &[SmartSerial] {
        &[]
    }

    /// Mutable access to the smart serial ports.
    fn ports_mut(&mut self) -> &mut [SmartSerial] {
        &mut []
    }
}

/// What moves up to the present before the host accesses a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Settles {
    /// Nothing: the registers depend on writes and time only.
    Nothing,
    /// The signals of switches and handwheels, and the motion that they depend on.
    Signals,
    /// Motors and all that they move, if a drive gets its signal from an added module: the new
    /// signal applies from now on.
    Drives,
    /// Motors and all that they move.
    World,
}

/// Effect of an event in a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Effect {
    /// No output changes.
    Nothing,
    /// Outputs of the module change.
    Outputs,
    /// All I/O pins become inputs: the watchdog bites.
    Bite,
}

/// A configuration of the FPGA, for one of its modules.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Configuration<'a> {
    /// The firmware.
    pub firmware: &'a SimFirmware,
    /// The module's descriptor.
    pub module: &'a SimModuleDescriptor,
    /// The I/O ports: all pins are inputs.
    pub io: &'a SimIoPorts,
    /// The present time, at which the registers are as after configuration.
    pub now: Nanos,
    /// Time at which the configuration is complete, not before `now`.
    pub complete: Nanos,
}

impl Configuration<'_> {
    /// Frequency of the module's clock in hertz, at least 1.
    pub fn clock(&self) -> u32 {
        self.firmware.clock(self.module.clock).max(1)
    }

    /// The addresses of the first `registers` registers (at most 32), with the strides of the
    /// descriptor.
    pub fn addresses(&self, registers: u8) -> Vec<RegisterAddress> {
        let module = self.module;
        let (register_stride, instance_stride) = SimFirmware::strides(module);
        let addresses = (0..registers.min(32)).flat_map(|register| {
            let is_multiple = module.multiple >> register & 1 != 0;
            let instances = if is_multiple {
                module.instances
            } else {
                module.instances.min(1)
            };
            let base = module.base;
            let first = base.wrapping_add(u16::from(register).wrapping_mul(register_stride));
            (0..instances).map(move |instance| RegisterAddress {
                address: first.wrapping_add(u16::from(instance).wrapping_mul(instance_stride)),
                register,
                instance,
            })
        });
        addresses.collect()
    }
}

/// The address of a register in one instance of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisterAddress {
    /// Byte address.
    pub address: u16,
    /// Register number.
    pub register: u8,
    /// Instance.
    pub instance: u8,
}
