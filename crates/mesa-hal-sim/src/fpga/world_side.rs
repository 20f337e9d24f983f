//! The outside of the FPGA: pins, sockets, motors, inputs and outputs.

use super::fabric::Fabric;
use super::plant::{AxisWiring, DriveSignal, DriveSource, StepperWiring};
use super::{AccessCounters, SimFirmware, SimFpga, gtag};
use crate::modules::{
    EncoderBank, Inputs, SimDpll, SimIoPorts, SimLeds, SimModule, SimOutputs, SimPwm, SimStepgen,
    SimWatchdog, SmartSerial,
};
use crate::wire::{Nanos, RemoteEnd};
use crate::world::{Motor, Stepper};

impl SimFpga {
    /// The firmware of the FPGA.
    pub fn firmware(&self) -> &SimFirmware {
        &self.fabric.firmware
    }

    /// Access statistics.
    pub fn counters(&self) -> AccessCounters {
        self.counters
    }

    /// Sets the virtual time that each access through the bus takes.
    pub fn set_access_cost(&mut self, cost: Nanos) {
        self.access_cost = cost;
    }

    /// Overrides a word of identification or IDROM: a firmware with a defect. Has no effect at
    /// other addresses.
    pub fn override_rom(&mut self, address: u16, value: u32) {
        self.space.override_rom(address, value);
    }

    /// The I/O ports.
    pub fn io(&self) -> &SimIoPorts {
        self.fabric.io()
    }

    /// The level of an I/O pin.
    pub fn pin_level(&self, pin: usize) -> bool {
        self.fabric.pin_level(pin)
    }

    /// The level that the FPGA or the outside drives on an I/O pin; `None` if it is only pulled up.
    pub fn driven_level(&self, pin: usize) -> Option<bool> {
        self.fabric.driven_level(pin)
    }

    /// True if the FPGA drives an I/O pin, to any level.
    pub fn is_driven(&self, pin: usize) -> bool {
        self.fabric.io.is_output(pin)
    }

    /// Drives an I/O pin from outside, or releases it.
    pub fn drive_pin(&mut self, pin: usize, level: Option<bool>) {
        self.fabric.io.drive(pin, level);
        self.fabric.settle();
        self.fabric.pin_driven(pin);
    }

    /// Adds a module in place of the firmware's module with this GTAG, which the simulator may
    /// implement or not. The module can drive a motor: [`DriveSource::Module`].
    pub fn add_module(&mut self, gtag: u8, module: Box<dyn SimModule>) {
        self.fabric.settle();
        let slot = self.fabric.modules.replace(gtag, module);
        self.map_module(slot);
        self.fabric.pins_changed();
        self.fabric.settle();
    }

    /// The module with this GTAG, if it is of type `T`: one that was added with
    /// [`add_module`](Self::add_module), or one of the simulator's own.
    pub fn module<T: SimModule>(&self, gtag: u8) -> Option<&T> {
        let module: &dyn core::any::Any = self.fabric.modules.get(gtag)?;
        module.downcast_ref()
    }

    /// Mutable access to the module with this GTAG, if it is of type `T`.
    pub fn module_mut<T: SimModule>(&mut self, gtag: u8) -> Option<&mut T> {
        let module: &mut dyn core::any::Any = self.fabric.modules.get_mut(gtag)?;
        module.downcast_mut()
    }

    /// The watchdog; one that stands still if the firmware has none.
    pub fn watchdog(&self) -> SimWatchdog {
        let watchdog = self.fabric.modules.first().copied();
        watchdog.unwrap_or_default()
    }

    /// Number of smart serial ports.
    pub fn serial_ports(&self) -> usize {
        self.fabric.modules.ports().count()
    }

    /// A smart serial port.
    pub fn serial_port(&self, port: usize) -> Option<&SmartSerial> {
        self.fabric.modules.ports().nth(port)
    }

    /// Plugs a remote into a channel (`None` unplugs) and returns the one that was there.
    pub fn plug(
        &mut self,
        port: usize,
        channel: usize,
        remote: Option<Box<dyn RemoteEnd>>,
    ) -> Option<Box<dyn RemoteEnd>> {
        self.fabric.settle();
        let socket = self.fabric.modules.port_mut(port)?;
        let previous = socket.plug(channel, remote);
        self.fabric.settle();
        previous
    }

    /// The remote plugged into a channel.
    pub fn remote(&self, port: usize, channel: usize) -> Option<&dyn RemoteEnd> {
        self.serial_port(port)?.remote(channel)
    }

    /// Mutable access to the remote plugged into a channel.
    pub fn remote_mut(&mut self, port: usize, channel: usize) -> Option<&mut dyn RemoteEnd> {
        self.fabric.remote_mut(port, channel)
    }

    /// The device of type `T` on a channel, behind any wrappers.
    pub fn device<T: RemoteEnd>(&self, port: usize, channel: usize) -> Option<&T> {
        device(self.remote(port, channel)?)
    }

    /// Mutable access to the device of type `T` on a channel, behind any wrappers.
    pub fn device_mut<T: RemoteEnd>(&mut self, port: usize, channel: usize) -> Option<&mut T> {
        device_mut(self.remote_mut(port, channel)?)
    }

    /// Number of axes: motors and their loads.
    pub fn axes(&self) -> usize {
        self.fabric.plant.len()
    }

    /// Wires a motor to a drive signal and an encoder; returns the index of the axis.
    pub fn wire_axis(&mut self, wiring: AxisWiring) -> usize {
        let fabric = &mut self.fabric;
        fabric.settle();
        fabric.pins_changed();
        let axis = fabric.plant.add(wiring, fabric.modules.first_mut());
        fabric.visit_remotes(|_| true);
        fabric.pins_changed();
        axis
    }

    /// Wires a stepper motor to a step generator; returns the index of the axis.
    pub fn wire_stepper(&mut self, wiring: StepperWiring) -> usize {
        self.fabric.settle();
        self.fabric.pins_changed();
        let Fabric {
            firmware,
            io,
            modules,
            plant,
            ..
        } = &mut self.fabric;
        let axis = plant.add_stepper(wiring, firmware, io, modules);
        self.fabric.pins_changed();
        axis
    }

    /// The stepper motor of an axis, up to date.
    pub fn stepper(&mut self, axis: usize) -> Option<&mut Stepper> {
        self.fabric.settle();
        self.fabric.plant.stepper_mut(axis)
    }

    /// The servo motor of an axis, up to date.
    pub fn motor(&mut self, axis: usize) -> Option<&mut Motor> {
        self.fabric.settle();
        self.fabric.plant.motor_mut(axis)
    }

    /// The present signal to the drive of an axis, and its enable.
    pub fn drive_signal(&mut self, axis: usize) -> Option<DriveSignal> {
        self.fabric.settle();
        let source = self.fabric.plant.source(axis)?;
        let signal = match source {
            DriveSource::Nothing => DriveSignal::default(),
            DriveSource::Pwm { .. } | DriveSource::Module { .. } => {
                let (gtag, output) = source.module()?;
                self.module_signal(gtag, output)
            }
            DriveSource::Remote {
                port,
                channel,
                output,
                readout,
            } => {
                let remote = self.remote(port, channel);
                remote.map_or(DriveSignal::default(), |end| readout(end, output))
            }
        };
        Some(signal)
    }

    /// The present signal of a module's output.
    fn module_signal(&self, gtag: u8, output: u8) -> DriveSignal {
        let Fabric {
            modules, io, now, ..
        } = &self.fabric;
        modules.drive_signal(gtag, *now, output, io)
    }

    /// The first encoder module, up to date.
    pub fn encoders(&mut self) -> Option<&mut EncoderBank> {
        self.fabric.settle();
        self.fabric.modules.first_mut()
    }

    /// The step generators, up to date.
    pub fn stepgen(&mut self) -> Option<&SimStepgen> {
        self.fabric.settle();
        self.fabric.modules.first()
    }

    /// The PWM generators.
    pub fn pwm(&self) -> Option<&SimPwm> {
        self.fabric.modules.first()
    }

    /// The signal of an analog output of a 7I97 to its drive.
    pub fn analog_output(&self, output: usize) -> DriveSignal {
        let output = u8::try_from(output).unwrap_or(u8::MAX);
        self.module_signal(gtag::PWM, output)
    }

    /// The isolated inputs.
    pub fn inputs(&self) -> Option<&Inputs> {
        self.fabric.modules.first()
    }

    /// Switches the current into an isolated input on or off.
    pub fn set_input(&mut self, input: usize, on: bool) {
        self.fabric.set_input(self.fabric.now, input, on);
    }

    /// True if an isolated output conducts.
    pub fn isolated_output(&self, output: usize) -> bool {
        let outputs = self.ssr().or(self.out_m());
        outputs.is_some_and(|outputs| outputs.is_on(output, self.fabric.io()))
    }

    /// The plain output module.
    pub fn out_m(&self) -> Option<&SimOutputs> {
        self.module(gtag::OUT_M)
    }

    /// The solid-state relay module.
    pub fn ssr(&self) -> Option<&SimOutputs> {
        self.module(gtag::SSR)
    }

    /// The LEDs; none is lit if the firmware has no such module.
    pub fn leds(&self) -> SimLeds {
        self.fabric.modules.first().copied().unwrap_or_default()
    }

    /// The phase-locked loop.
    pub fn dpll(&self) -> Option<&SimDpll> {
        self.fabric.modules.first()
    }
}

/// Finds a device behind any wrappers.
pub(crate) fn device<T: RemoteEnd>(mut end: &dyn RemoteEnd) -> Option<&T> {
    loop {
        let any: &dyn core::any::Any = end;
        if let Some(found) = any.downcast_ref() {
            return Some(found);
        }
        end = end.inner()?;
    }
}

fn device_mut<T: RemoteEnd>(end: &mut dyn RemoteEnd) -> Option<&mut T> {
    if (end as &dyn core::any::Any).is::<T>() {
        return (end as &mut dyn core::any::Any).downcast_mut();
    }
    device_mut(end.inner_mut()?)
}
