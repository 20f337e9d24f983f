//! The plant around the FPGA, besides the remotes: drives, motors and their encoders.

use super::firmware::{SimFirmware, gtag};
use crate::devices::find_mut;
use crate::modules::{EncoderBank, ForeignModules, SelectLine, SimIoPorts, SimPwm, Watcher};
use crate::wire::{Nanos, RemoteEnd};
use crate::world::{Change, Installation, Motor, SimTerminal};

/// Longest step of the motors' simulation.
const GRAIN: Nanos = 1_000_000;

/// The present command to a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveSignal {
    /// The analog signal in volts.
    pub volts: f64,
    /// True if the drive is enabled.
    pub enabled: bool,
}

/// Function that reads an analog output of a remote, with its enable, as a drive sees them.
pub type Readout = fn(remote: &dyn RemoteEnd, output: u8) -> DriveSignal;

/// Source of a drive's signal.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum DriveSource {
    /// None; the motor can be turned by hand.
    Nothing,
    /// An analog output of a remote.
    Remote {
        /// Smart serial port.
        port: usize,
        /// Channel of the port.
        channel: usize,
        /// Output of the remote.
        output: u8,
        /// Function that reads the output.
        readout: Readout,
    },
    /// A PWM generator with an analog output behind it, as on the 7I97.
    Pwm {
        /// The generator.
        unit: usize,
    },
    /// An output of a foreign module: the result of its
    /// [`drive_signal`](crate::ForeignModule::drive_signal). Without the module the drive has no
    /// signal.
    Module {
        /// The GTAG of the module.
        gtag: u8,
        /// The output, in the module's own numbering.
        output: u8,
    },
}

/// Wiring of a motor: the source of its drive's signal, and the encoder that it turns.
#[derive(Clone, Copy, Debug)]
pub struct AxisWiring {
    /// Source of the drive's signal.
    pub source: DriveSource,
    /// Encoder on the motor: instance of the first encoder module.
    pub encoder: usize,
    /// The motor.
    pub motor: Motor,
}

#[derive(Debug)]
struct Axis {
    motor: Motor,
    encoder: usize,
    source: DriveSource,
}

/// Drives, motors and encoders.
#[derive(Debug)]
pub(crate) struct Plant {
    now: Nanos,
    /// In the order of the firmware's modules.
    pub(super) banks: Vec<EncoderBank>,
    axes: Vec<Axis>,
    pub(super) installation: Installation,
}

impl Plant {
    pub(crate) fn new(firmware: &SimFirmware) -> Self {
        let modules = firmware.modules.iter();
        let banks = modules
            .filter(|module| matches!(module.gtag, gtag::ENCODER | gtag::MUXED_ENCODER))
            .map(|module| EncoderBank::new(firmware, module));
        Self {
            now: 0,
            banks: banks.collect(),
            axes: Vec::new(),
            installation: Installation::default(),
        }
    }

    pub(super) fn add(&mut self, wiring: AxisWiring, io: &SimIoPorts) -> usize {
        let motor = wiring.motor;
        let per_revolution = motor.config().counts_per_revolution;
        let counts = libm::floor(motor.counts()) as i64;
        self.axes.push(Axis {
            motor,
            encoder: wiring.encoder,
            source: wiring.source,
        });
        self.pins_changed(io);
        if let Some(bank) = self.banks.first_mut() {
            bank.place(wiring.encoder, counts, per_revolution);
        }
        self.axes.len() - 1
    }

    pub(super) fn len(&self) -> usize {
        self.axes.len()
    }

    pub(super) fn read_encoder(&mut self, bank: usize, now: Nanos, register: u8, n: u8) -> u32 {
        let bank = self.banks.get_mut(bank);
        bank.map_or(0, |bank| bank.read(now, register, n))
    }

    pub(super) fn write_encoder(
        &mut self,
        bank: usize,
        now: Nanos,
        register: u8,
        n: u8,
        value: u32,
    ) {
        if let Some(bank) = self.banks.get_mut(bank) {
            bank.write(now, register, n, value);
        }
    }

    pub(super) fn now(&self) -> Nanos {
        self.now
    }

    pub(super) fn motor_mut(&mut self, axis: usize) -> Option<&mut Motor> {
        self.axes.get_mut(axis).map(|axis| &mut axis.motor)
    }

    /// Source of the signal to the drive of an axis.
    pub(super) fn source(&self, axis: usize) -> Option<DriveSource> {
        self.axes.get(axis).map(|axis| axis.source)
    }

    /// Time of the next regular step.
    pub(super) fn due(&self) -> Nanos {
        self.now.saturating_add(GRAIN)
    }

    /// Moves all motors and their encoders.
    pub(super) fn advance(&mut self, to: Nanos) {
        if to <= self.now {
            return;
        }
        self.now = to;
        let Self {
            banks,
            axes,
            installation,
            ..
        } = self;
        for (number, axis) in axes.iter_mut().enumerate() {
            let encoder = axis.encoder;
            axis.motor.advance(to, |segment, positions| {
                if let Some(bank) = banks.first_mut() {
                    bank.turn(encoder, segment);
                }
                installation.moved(number, [segment.start, segment.end], positions);
            });
        }
        installation.advance(to);
    }

    /// Switches the power of all drives.
    pub(super) fn power_drives(&mut self, powered: bool) {
        for axis in &mut self.axes {
            axis.motor.set_power(powered);
        }
    }

    /// Determines the encoder that each counter sees: without its select line, a multiplexer stays
    /// at one encoder of each pair (the odd one, because the line is pulled up), and both counters
    /// see that one.
    pub(super) fn pins_changed(&mut self, io: &SimIoPorts) {
        for bank in self.banks.iter_mut().filter(|bank| bank.is_multiplexed()) {
            for encoder in 0..bank.encoders() {
                let Some(pin) = bank.select_pin(encoder) else {
                    continue;
                };
                let line = match io.module_pin(Some(pin)) {
                    Some(inverted) => SelectLine::Driven { inverted },
                    None => SelectLine::Stuck(io.level(pin, &|_| false)),
                };
                bank.set_select(self.now, encoder, line);
            }
        }
    }

    /// Applies the outputs of the PWM generators.
    pub(super) fn pwm_changed(&mut self, pwm: &SimPwm, io: &SimIoPorts) {
        for axis in &mut self.axes {
            if let DriveSource::Pwm { unit } = axis.source {
                let enabled = pwm.drive_enabled(unit, io);
                axis.motor.command(pwm.volts(unit, io, self.now), enabled);
            }
        }
    }

    /// Applies the outputs of foreign modules.
    pub(super) fn modules_changed(&mut self, modules: &ForeignModules, io: &SimIoPorts) {
        for axis in &mut self.axes {
            if let DriveSource::Module { gtag, output } = axis.source {
                let signal = modules.drive_signal(gtag, self.now, output, io);
                axis.motor.command(signal.volts, signal.enabled);
            }
        }
    }

    /// True if a foreign module drives an axis.
    pub(super) fn is_driven_by_modules(&self) -> bool {
        let mut axes = self.axes.iter();
        axes.any(|axis| matches!(axis.source, DriveSource::Module { .. }))
    }

    /// Applies the outputs of a remote.
    fn remote_changed(&mut self, port: usize, channel: usize, remote: Option<&dyn RemoteEnd>) {
        for axis in &mut self.axes {
            if let DriveSource::Remote {
                port: from_port,
                channel: from_channel,
                output,
                readout,
            } = axis.source
                && (from_port, from_channel) == (port, channel)
            {
                let signal = remote.map_or(DriveSignal::default(), |end| readout(end, output));
                axis.motor.command(signal.volts, signal.enabled);
            }
        }
    }

    fn is_driven_by(&self, port: usize, channel: usize) -> bool {
        self.axes.iter().any(|axis| {
            matches!(axis.source, DriveSource::Remote { port: p, channel: c, .. }
                if (p, c) == (port, channel))
        })
    }
}

/// Observer that keeps the motors in step with the commands of the remotes.
pub(super) struct PortWatcher<'a> {
    plant: &'a mut Plant,
    port: usize,
}

impl<'a> PortWatcher<'a> {
    pub(super) fn new(plant: &'a mut Plant, port: usize) -> Self {
        Self { plant, port }
    }
}

impl Watcher for PortWatcher<'_> {
    fn before(&mut self, channel: usize, now: Nanos, remote: &mut dyn RemoteEnd) {
        let is_wired = self.plant.installation.is_wired_to(self.port, channel);
        if is_wired || self.plant.is_driven_by(self.port, channel) {
            self.plant.advance(now);
        }
        if is_wired {
            let installation = &mut self.plant.installation;
            while let Some(change) = installation.take_for(now, self.port, channel) {
                put_on(remote, &change);
            }
        }
    }

    fn after(&mut self, channel: usize, remote: Option<&dyn RemoteEnd>) {
        self.plant.remote_changed(self.port, channel, remote);
    }
}

/// Applies a signal to the input of a remote.
fn put_on(remote: &mut dyn RemoteEnd, change: &Change) {
    if let SimTerminal::Remote { input, .. } = change.terminal
        && let Some(device) = find_mut(remote)
    {
        // A wire to an input that the card does not have has no effect.
        let _ = device.set_input(input, change.on);
    }
}
