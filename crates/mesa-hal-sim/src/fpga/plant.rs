//! The plant around the FPGA, besides the remotes: drives, motors and their encoders.

use super::firmware::{SimFirmware, gtag};
use super::slots::Modules;
use crate::devices::find_mut;
use crate::modules::{EncoderBank, OutputChange, SimIoPorts, SimStepgen, Source, is_high};
use crate::wire::{Nanos, RemoteEnd};
use crate::world::{Change, Installation, Motor, Segment, SimTerminal, Stepper};

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
    /// An output of a module that was added: the result of its
    /// [`drive_signal`](crate::SimModule::drive_signal). Without the module the drive has no
    /// signal.
    Module {
        /// The GTAG of the module.
        gtag: u8,
        /// The output, in the module's own numbering.
        output: u8,
    },
}

impl DriveSource {
    /// The module whose output is the source: its GTAG and the output.
    pub(super) fn module(self) -> Option<(u8, u8)> {
        match self {
            Self::Pwm { unit } => Some((gtag::PWM, u8::try_from(unit).unwrap_or(u8::MAX))),
            Self::Module { gtag, output } => Some((gtag, output)),
            Self::Nothing | Self::Remote { .. } => None,
        }
    }

    fn is_added_module(&self) -> bool {
        matches!(self, Self::Module { .. })
    }
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

/// Wiring of a stepper motor to the step and direction pins of a generator, by their descriptors.
/// The drive gets the levels of the I/O pins: a pin that is not driven is pulled up, and a signal
/// that its port inverts is inverted.
#[derive(Clone, Copy, Debug)]
pub struct StepperWiring {
    /// The step generator.
    pub generator: usize,
    /// Encoder on the motor, if any: instance of the first encoder module.
    pub encoder: Option<usize>,
    /// The motor.
    pub motor: Stepper,
}

/// Secondary pins of step and direction.
const STEP_PIN: u8 = 0x81;
const DIR_PIN: u8 = 0x82;

#[derive(Debug)]
struct Axis {
    mover: Mover,
    encoder: Option<usize>,
}

/// The motor of an axis.
#[derive(Debug)]
enum Mover {
    Servo { motor: Motor, source: DriveSource },
    Stepper { motor: Stepper, inputs: StepInputs },
}

/// The signals at the inputs of a stepper drive.
#[derive(Clone, Copy, Debug)]
struct StepInputs {
    generator: usize,
    /// The I/O pins of step and direction, if the firmware has them, and what drives them.
    pins: [Option<usize>; 2],
    sources: [Source; 2],
    /// The generator's outputs.
    outputs: u8,
}

impl StepInputs {
    /// The levels of step and direction.
    fn levels(&self) -> [bool; 2] {
        let level = |source, pin| match source {
            Source::Undriven => true,
            Source::Level(level) => level,
            Source::Module { inverted } => is_high(self.outputs, pin) != inverted,
        };
        let [step, dir] = self.sources;
        [level(step, STEP_PIN), level(dir, DIR_PIN)]
    }
}

/// Drives, motors, and what is wired to them.
#[derive(Debug, Default)]
pub(crate) struct Plant {
    now: Nanos,
    axes: Vec<Axis>,
    pub(super) installation: Installation,
}

impl Plant {
    /// The time up to which the motors have moved.
    pub(super) fn now(&self) -> Nanos {
        self.now
    }

    /// Adds a servo motor, which turns an encoder of the bank.
    pub(super) fn add(&mut self, wiring: AxisWiring, bank: Option<&mut EncoderBank>) -> usize {
        let AxisWiring {
            motor,
            encoder,
            source,
        } = wiring;
        let per_revolution = motor.config().counts_per_revolution;
        place(bank, encoder, motor.counts(), per_revolution);
        self.axes.push(Axis {
            mover: Mover::Servo { motor, source },
            encoder: Some(encoder),
        });
        self.axes.len() - 1
    }

    /// Adds a stepper motor at the pins of a generator.
    pub(super) fn add_stepper(
        &mut self,
        wiring: StepperWiring,
        firmware: &SimFirmware,
        io: &SimIoPorts,
        modules: &mut Modules,
    ) -> usize {
        let StepperWiring {
            generator,
            encoder,
            mut motor,
        } = wiring;
        let unit = u8::try_from(generator).unwrap_or(u8::MAX);
        let pin = |pin| firmware.pin(gtag::STEPGEN, unit, pin);
        let pins = [pin(STEP_PIN), pin(DIR_PIN)];
        let stepgen = modules.first::<SimStepgen>();
        let inputs = StepInputs {
            generator,
            pins,
            sources: pins.map(|pin| io.source(pin)),
            outputs: stepgen.map_or(0, |steps| steps.outputs(generator)),
        };
        let [step, dir] = inputs.levels();
        motor.wire(self.now, step, dir);
        if let Some(encoder) = encoder {
            let per_revolution = motor.config().counts_per_revolution;
            place(modules.first_mut(), encoder, motor.counts(), per_revolution);
        }
        self.axes.push(Axis {
            mover: Mover::Stepper { motor, inputs },
            encoder,
        });
        self.axes.len() - 1
    }

    pub(super) fn len(&self) -> usize {
        self.axes.len()
    }

    /// Takes over the outputs of the step generators of a new configuration.
    pub(super) fn stepgen_reloaded(&mut self, stepgen: Option<&SimStepgen>) {
        for axis in &mut self.axes {
            if let Mover::Stepper { inputs, .. } = &mut axis.mover {
                inputs.outputs = stepgen.map_or(0, |steps| steps.outputs(inputs.generator));
            }
        }
    }

    pub(super) fn motor_mut(&mut self, axis: usize) -> Option<&mut Motor> {
        match &mut self.axes.get_mut(axis)?.mover {
            Mover::Servo { motor, .. } => Some(motor),
            Mover::Stepper { .. } => None,
        }
    }

    pub(super) fn stepper_mut(&mut self, axis: usize) -> Option<&mut Stepper> {
        match &mut self.axes.get_mut(axis)?.mover {
            Mover::Stepper { motor, .. } => Some(motor),
            Mover::Servo { .. } => None,
        }
    }

    /// The position of an axis in units.
    pub(super) fn position(&self, axis: usize) -> Option<f64> {
        Some(match &self.axes.get(axis)?.mover {
            Mover::Servo { motor, .. } => motor.position(),
            Mover::Stepper { motor, .. } => motor.position(),
        })
    }

    /// Source of the signal to the drive of an axis.
    pub(super) fn source(&self, axis: usize) -> Option<DriveSource> {
        match self.axes.get(axis)?.mover {
            Mover::Servo { source, .. } => Some(source),
            Mover::Stepper { .. } => None,
        }
    }

    /// The servo motors with the sources of their signals.
    fn servos(&mut self) -> impl Iterator<Item = (&mut Motor, DriveSource)> {
        let axes = self.axes.iter_mut();
        axes.filter_map(|axis| match &mut axis.mover {
            Mover::Servo { motor, source } => Some((motor, *source)),
            Mover::Stepper { .. } => None,
        })
    }

    fn sources(&self) -> impl Iterator<Item = DriveSource> {
        (0..self.axes.len()).filter_map(|axis| self.source(axis))
    }

    /// Time of the next regular step.
    pub(super) fn due(&self) -> Nanos {
        self.now.saturating_add(GRAIN)
    }

    /// Moves all motors, and the encoders of the bank that they turn.
    pub(super) fn advance(&mut self, to: Nanos, bank: Option<&mut EncoderBank>) {
        self.now = to;
        let (axes, mut world) = self.split(bank);
        for (number, axis) in axes.iter_mut().enumerate() {
            let mut moved = world.mover(number, axis.encoder);
            match &mut axis.mover {
                Mover::Servo { motor, .. } => motor.advance(to, moved),
                Mover::Stepper { motor, .. } => motor.advance(to, &mut moved),
            }
        }
        world.installation.advance(to);
    }

    /// Applies a change of a generator's outputs to the drives that are wired to it.
    pub(super) fn outputs_changed(&mut self, change: OutputChange, bank: Option<&mut EncoderBank>) {
        let (axes, mut world) = self.split(bank);
        for (number, axis) in axes.iter_mut().enumerate() {
            if let Mover::Stepper { motor, inputs } = &mut axis.mover
                && inputs.generator == change.unit
            {
                inputs.outputs = change.outputs;
                let [step, dir] = inputs.levels();
                let mut moved = world.mover(number, axis.encoder);
                motor.set_inputs(change.at, step, dir, &mut moved);
            }
        }
    }

    /// The axes, and what follows the motion of an axis.
    fn split<'a>(&'a mut self, bank: Option<&'a mut EncoderBank>) -> (&'a mut [Axis], World<'a>) {
        let installation = &mut self.installation;
        (&mut self.axes, World { bank, installation })
    }

    /// Switches the power of all drives.
    pub(super) fn power_drives(&mut self, powered: bool) {
        for axis in &mut self.axes {
            match &mut axis.mover {
                Mover::Servo { motor, .. } => motor.set_power(powered),
                Mover::Stepper { motor, .. } => motor.set_power(powered),
            }
        }
    }

    /// Applies the set-up of the pins to the inputs of stepper drives.
    pub(super) fn pins_changed(&mut self, io: &SimIoPorts, bank: Option<&mut EncoderBank>) {
        let now = self.now;
        let (axes, mut world) = self.split(bank);
        for (number, axis) in axes.iter_mut().enumerate() {
            if let Mover::Stepper { motor, inputs } = &mut axis.mover {
                inputs.sources = inputs.pins.map(|pin| io.source(pin));
                let [step, dir] = inputs.levels();
                let mut moved = world.mover(number, axis.encoder);
                motor.set_inputs(now, step, dir, &mut moved);
            }
        }
    }

    /// Applies the outputs of all modules to the drives.
    pub(super) fn take_all(&mut self, modules: &Modules, io: &SimIoPorts) {
        self.take(modules, io, |_| true);
    }

    /// Applies the outputs of the module in a slot.
    pub(super) fn take_from(&mut self, slot: usize, modules: &Modules, io: &SimIoPorts) {
        let gtag = modules.gtag(slot);
        self.take(modules, io, |source| {
            source.module().map(|(from, _)| from) == gtag
        });
    }

    /// Applies the outputs of modules that were added, which may change at any time.
    pub(super) fn take_from_modules(&mut self, modules: &Modules, io: &SimIoPorts) {
        self.take(modules, io, DriveSource::is_added_module);
    }

    fn take(&mut self, modules: &Modules, io: &SimIoPorts, which: impl Fn(&DriveSource) -> bool) {
        let now = self.now;
        for (motor, source) in self.servos() {
            if which(&source)
                && let Some((gtag, output)) = source.module()
            {
                let signal = modules.drive_signal(gtag, now, output, io);
                motor.command(signal.volts, signal.enabled);
            }
        }
    }

    /// True if a module that was added drives an axis.
    pub(super) fn is_driven_by_modules(&self) -> bool {
        self.sources().any(|source| source.is_added_module())
    }

    /// Applies the outputs of a remote.
    pub(super) fn remote_changed(
        &mut self,
        [port, channel]: [usize; 2],
        remote: Option<&dyn RemoteEnd>,
    ) {
        for (motor, source) in self.servos() {
            if let DriveSource::Remote {
                port: from_port,
                channel: from_channel,
                output,
                readout,
            } = source
                && (from_port, from_channel) == (port, channel)
            {
                let signal = remote.map_or(DriveSignal::default(), |end| readout(end, output));
                motor.command(signal.volts, signal.enabled);
            }
        }
    }

    pub(super) fn is_driven_by(&self, port: usize, channel: usize) -> bool {
        self.sources().any(|source| {
            matches!(source, DriveSource::Remote { port: p, channel: c, .. }
                if (p, c) == (port, channel))
        })
    }

    /// Applies the changes of switches and wheels up to `now` to the inputs of a remote.
    pub(super) fn put_on_remote(
        &mut self,
        now: Nanos,
        [port, channel]: [usize; 2],
        remote: &mut dyn RemoteEnd,
    ) {
        while let Some(change) = self.installation.take_for(now, port, channel) {
            put_on(remote, &change);
        }
    }
}

/// Sets the position of an encoder when its motor is wired.
fn place(bank: Option<&mut EncoderBank>, encoder: usize, counts: f64, per_revolution: u32) {
    if let Some(bank) = bank {
        bank.place(encoder, libm::floor(counts) as i64, per_revolution);
    }
}

/// The parts of the plant that follow the motion of an axis.
struct World<'a> {
    bank: Option<&'a mut EncoderBank>,
    installation: &'a mut Installation,
}

impl World<'_> {
    /// Receiver of the movements of an axis.
    fn mover(&mut self, axis: usize, encoder: Option<usize>) -> impl FnMut(&Segment, [f64; 2]) {
        move |segment, positions| {
            if let Some(encoder) = encoder
                && let Some(bank) = &mut self.bank
            {
                bank.turn(encoder, segment);
            }
            let times = [segment.start, segment.end];
            self.installation.moved(axis, times, positions);
        }
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
