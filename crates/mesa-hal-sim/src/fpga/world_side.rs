//! The outside of the FPGA: pins, sockets, motors, inputs and outputs.

use super::plant::{AxisWiring, DriveSignal, DriveSource, StepperWiring};
use super::{AccessCounters, SimFirmware, SimFpga, Target, gtag};
use crate::modules::{
    EncoderBank, ForeignModule, Inputs, SimDpll, SimIoPorts, SimLeds, SimOutputs, SimPwm,
    SimStepgen, SimWatchdog, SmartSerial,
};
use crate::wire::{Nanos, RemoteEnd};
use crate::world::{Motor, Stepper};

impl SimFpga {
    /// The firmware of the FPGA.
    pub fn firmware(&self) -> &SimFirmware {
        &self.firmware
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
        if let Target::Rom(index) = self.map.at(address)
            && let Some(word) = self.rom.get_mut(usize::from(index))
        {
            *word = value;
        }
    }

    /// The I/O ports.
    pub fn io(&self) -> &SimIoPorts {
        &self.io
    }

    /// The level of an I/O pin.
    pub fn pin_level(&self, pin: usize) -> bool {
        let levels = |pin| self.module_level(pin);
        self.io.level(pin, &levels)
    }

    /// The level that the FPGA or the outside drives on an I/O pin; `None` if it is only pulled up.
    pub fn driven_level(&self, pin: usize) -> Option<bool> {
        let levels = |pin| self.module_level(pin);
        self.io.driven_level(pin, &levels)
    }

    /// True if the FPGA drives an I/O pin, to any level.
    pub fn is_driven(&self, pin: usize) -> bool {
        self.io.is_output(pin)
    }

    /// Drives an I/O pin from outside, or releases it.
    pub fn drive_pin(&mut self, pin: usize, level: Option<bool>) {
        self.io.drive(pin, level);
        self.settle();
        self.pin_driven(pin);
    }

    /// Passes the level of a pin to the module whose input it is.
    pub(super) fn pin_driven(&mut self, pin: usize) {
        let Some(found) = self.firmware.pins.get(pin).copied() else {
            return;
        };
        let (level, now) = (self.pin_level(pin), self.now);
        match found.secondary {
            gtag::ENCODER | gtag::MUXED_ENCODER => {
                if let Some(bank) = self.bank(found.secondary)
                    && let Some(bank) = self.plant.banks.get_mut(bank)
                {
                    bank.set_pin(now, found.unit, found.pin, level);
                }
            }
            gtag::STEPGEN => {
                if let Some(steps) = &mut self.plant.stepgen {
                    steps.set_pin(found.unit, found.pin, level);
                }
            }
            other => {
                if let Some(module) = self.foreign.get_mut(other) {
                    module.set_input(now, found.unit, found.pin, level);
                }
            }
        }
    }

    /// Adds a module that the simulator does not implement, in place of the firmware's module with
    /// this GTAG. The module can drive a motor: [`DriveSource::Module`].
    pub fn add_module(&mut self, gtag: u8, module: Box<dyn ForeignModule>) {
        self.settle();
        self.foreign.add(gtag, module);
        self.settle();
    }

    /// A module added with [`add_module`](Self::add_module).
    pub fn module<T: ForeignModule>(&self, gtag: u8) -> Option<&T> {
        let module: &dyn core::any::Any = self.foreign.get(gtag)?;
        module.downcast_ref()
    }

    /// Mutable access to an added module.
    pub fn module_mut<T: ForeignModule>(&mut self, gtag: u8) -> Option<&mut T> {
        let module: &mut dyn core::any::Any = self.foreign.get_mut(gtag)?;
        module.downcast_mut()
    }

    /// The watchdog.
    pub fn watchdog(&self) -> &SimWatchdog {
        &self.watchdog
    }

    /// Number of smart serial ports.
    pub fn serial_ports(&self) -> usize {
        self.serial.len()
    }

    /// A smart serial port.
    pub fn serial_port(&self, port: usize) -> Option<&SmartSerial> {
        self.serial.get(port)
    }

    /// Plugs a remote into a channel (`None` unplugs) and returns the one that was there.
    pub fn plug(
        &mut self,
        port: usize,
        channel: usize,
        remote: Option<Box<dyn RemoteEnd>>,
    ) -> Option<Box<dyn RemoteEnd>> {
        self.settle();
        let previous = self.serial.get_mut(port)?.plug(channel, remote);
        self.settle();
        previous
    }

    /// The remote plugged into a channel.
    pub fn remote(&self, port: usize, channel: usize) -> Option<&dyn RemoteEnd> {
        self.serial.get(port)?.remote(channel)
    }

    /// Mutable access to the remote plugged into a channel.
    pub fn remote_mut(&mut self, port: usize, channel: usize) -> Option<&mut dyn RemoteEnd> {
        self.serial.get_mut(port)?.remote_mut(channel)
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
        self.plant.len()
    }

    /// Wires a motor to a drive signal and an encoder; returns the index of the axis.
    pub fn wire_axis(&mut self, wiring: AxisWiring) -> usize {
        self.settle();
        let axis = self.plant.add(wiring, &self.io);
        self.visit_remotes(|_| true);
        self.pins_changed();
        axis
    }

    /// Wires a stepper motor to a step generator; returns the index of the axis.
    pub fn wire_stepper(&mut self, wiring: StepperWiring) -> usize {
        self.settle();
        let axis = self.plant.add_stepper(wiring, &self.firmware, &self.io);
        self.pins_changed();
        axis
    }

    /// The stepper motor of an axis, up to date.
    pub fn stepper(&mut self, axis: usize) -> Option<&mut Stepper> {
        self.settle();
        self.plant.stepper_mut(axis)
    }

    /// The servo motor of an axis, up to date.
    pub fn motor(&mut self, axis: usize) -> Option<&mut Motor> {
        self.settle();
        self.plant.motor_mut(axis)
    }

    /// The present signal to the drive of an axis, and its enable.
    pub fn drive_signal(&mut self, axis: usize) -> Option<DriveSignal> {
        self.settle();
        let signal = match self.plant.source(axis)? {
            DriveSource::Nothing => DriveSignal::default(),
            DriveSource::Pwm { unit } => self.analog_output(unit),
            DriveSource::Module { gtag, output } => {
                let (foreign, now) = (&self.foreign, self.now);
                foreign.drive_signal(gtag, now, output, &self.io)
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

    /// The first encoder module, up to date.
    pub fn encoders(&mut self) -> Option<&mut EncoderBank> {
        self.settle();
        self.plant.banks.first_mut()
    }

    /// The step generators, up to date.
    pub fn stepgen(&mut self) -> Option<&SimStepgen> {
        self.settle();
        self.plant.stepgen.as_ref()
    }

    /// The PWM generators.
    pub fn pwm(&self) -> Option<&SimPwm> {
        self.pwm.as_ref()
    }

    /// The signal of an analog output of a 7I97 to its drive.
    pub fn analog_output(&self, output: usize) -> DriveSignal {
        self.pwm
            .as_ref()
            .map_or(DriveSignal::default(), |pwm| DriveSignal {
                volts: pwm.volts(output, &self.io, self.now),
                enabled: pwm.drive_enabled(output, &self.io),
            })
    }

    /// The isolated inputs.
    pub fn inputs(&self) -> Option<&Inputs> {
        self.in_mux.as_ref().or(self.in_m.as_ref())
    }

    /// Switches the current into an isolated input on or off.
    pub fn set_input(&mut self, input: usize, on: bool) {
        let now = self.now;
        if let Some(inputs) = self.in_mux.as_mut().or(self.in_m.as_mut()) {
            inputs.set_terminal(now, input, on);
        }
    }

    /// True if an isolated output conducts.
    pub fn isolated_output(&self, output: usize) -> bool {
        let outputs = self.ssr.as_ref().or(self.out_m.as_ref());
        outputs.is_some_and(|outputs| outputs.is_on(output, &self.io))
    }

    /// The plain output module.
    pub fn out_m(&self) -> Option<&SimOutputs> {
        self.out_m.as_ref()
    }

    /// The solid-state relay module.
    pub fn ssr(&self) -> Option<&SimOutputs> {
        self.ssr.as_ref()
    }

    /// The LEDs.
    pub fn leds(&self) -> SimLeds {
        self.leds
    }

    /// The phase-locked loop.
    pub fn dpll(&self) -> Option<&SimDpll> {
        self.dpll.as_ref()
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
