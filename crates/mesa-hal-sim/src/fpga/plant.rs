//! The plant around the FPGA, besides the remotes: drives, motors and their encoders.

use super::firmware::{SimFirmware, gtag};
use crate::devices::find_mut;
use crate::modules::{
    EncoderBank, ForeignModules, OutputChange, SelectLine, SimIoPorts, SimPwm, SimStepgen, Source,
    Watcher, is_high,
};
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

/// Drives, motors and encoders.
#[derive(Debug)]
pub(crate) struct Plant {
    now: Nanos,
    /// In the order of the firmware's modules.
    pub(super) banks: Vec<EncoderBank>,
    pub(super) stepgen: Option<SimStepgen>,
    axes: Vec<Axis>,
    pub(super) installation: Installation,
}

impl Plant {
    pub(crate) fn new(firmware: &SimFirmware, now: Nanos) -> Self {
        let steps = firmware.module(gtag::STEPGEN);
        let modules = firmware.modules.iter();
        let banks = modules
            .filter(|module| matches!(module.gtag, gtag::ENCODER | gtag::MUXED_ENCODER))
            .map(|module| EncoderBank::new(firmware, module));
        Self {
            now: 0,
            banks: banks.collect(),
            stepgen: steps.map(|module| SimStepgen::new(firmware, module, now)),
            axes: Vec::new(),
            installation: Installation::default(),
        }
    }

    pub(super) fn add(&mut self, wiring: AxisWiring, io: &SimIoPorts) -> usize {
        let AxisWiring {
            motor,
            encoder,
            source,
        } = wiring;
        let per_revolution = motor.config().counts_per_revolution;
        self.place(encoder, motor.counts(), per_revolution, io);
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
    ) -> usize {
        let StepperWiring {
            generator,
            encoder,
            mut motor,
        } = wiring;
        let unit = u8::try_from(generator).unwrap_or(u8::MAX);
        let pin = |pin| firmware.pin(gtag::STEPGEN, unit, pin);
        let pins = [pin(STEP_PIN), pin(DIR_PIN)];
        let stepgen = self.stepgen.as_ref();
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
            self.place(encoder, motor.counts(), per_revolution, io);
        }
        self.axes.push(Axis {
            mover: Mover::Stepper { motor, inputs },
            encoder,
        });
        self.axes.len() - 1
    }

    /// Sets the position of an encoder when its motor is wired.
    fn place(&mut self, encoder: usize, counts: f64, per_revolution: u32, io: &SimIoPorts) {
        self.pins_changed(io);
        if let Some(bank) = self.banks.first_mut() {
            bank.place(encoder, libm::floor(counts) as i64, per_revolution);
        }
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

    pub(super) fn write_stepgen(&mut self, now: Nanos, register: u8, n: u8, value: u32) {
        let (stepgen, axes, mut world) = self.split();
        if let Some(stepgen) = stepgen {
            let follow = |change| outputs_changed(axes, change, &mut world);
            stepgen.write(now, register, n, value, follow);
        }
    }

    /// Replaces the step generators by those of a new configuration.
    pub(super) fn reload_stepgen(&mut self, fresh: Option<SimStepgen>) {
        self.stepgen = fresh;
        for axis in &mut self.axes {
            if let Mover::Stepper { inputs, .. } = &mut axis.mover {
                let stepgen = self.stepgen.as_ref();
                inputs.outputs = stepgen.map_or(0, |steps| steps.outputs(inputs.generator));
            }
        }
    }

    /// Latches the registers of all modules whose timer `rises` at `edge`.
    pub(super) fn latch(&mut self, edge: Nanos, rises: impl Fn(u8) -> bool) {
        for bank in &mut self.banks {
            if bank.latching_timer().is_some_and(&rises) {
                bank.latch(edge);
            }
        }
        if let Some(stepgen) = &mut self.stepgen
            && stepgen.sampling_timer().is_some_and(&rises)
        {
            stepgen.sample();
        }
    }

    /// Timers of the modules that a timer latches.
    pub(super) fn latching_timers(&self) -> impl Iterator<Item = u8> {
        let banks = self.banks.iter().filter_map(EncoderBank::latching_timer);
        let steps = self.stepgen.iter().filter_map(SimStepgen::sampling_timer);
        banks.chain(steps)
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

    /// Moves all motors and their encoders.
    pub(super) fn advance(&mut self, to: Nanos) {
        if to <= self.now {
            return;
        }
        self.now = to;
        let (stepgen, axes, mut world) = self.split();
        if let Some(stepgen) = stepgen {
            stepgen.advance(to, |change| outputs_changed(axes, change, &mut world));
        }
        for (number, axis) in axes.iter_mut().enumerate() {
            let mut moved = world.mover(number, axis.encoder);
            match &mut axis.mover {
                Mover::Servo { motor, .. } => motor.advance(to, moved),
                Mover::Stepper { motor, .. } => motor.advance(to, &mut moved),
            }
        }
        world.installation.advance(to);
    }

    /// The step generators, the axes, and what follows the motion of an axis.
    fn split(&mut self) -> (Option<&mut SimStepgen>, &mut [Axis], World<'_>) {
        let world = World {
            banks: &mut self.banks,
            installation: &mut self.installation,
        };
        (self.stepgen.as_mut(), &mut self.axes, world)
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
        self.step_pins_changed(io);
    }

    /// Applies the set-up of the pins to the inputs of stepper drives.
    fn step_pins_changed(&mut self, io: &SimIoPorts) {
        let now = self.now;
        let (_, axes, mut world) = self.split();
        for (number, axis) in axes.iter_mut().enumerate() {
            if let Mover::Stepper { motor, inputs } = &mut axis.mover {
                inputs.sources = inputs.pins.map(|pin| io.source(pin));
                let [step, dir] = inputs.levels();
                let mut moved = world.mover(number, axis.encoder);
                motor.set_inputs(now, step, dir, &mut moved);
            }
        }
    }

    /// Applies the outputs of the PWM generators.
    pub(super) fn pwm_changed(&mut self, pwm: &SimPwm, io: &SimIoPorts) {
        let now = self.now;
        for (motor, source) in self.servos() {
            if let DriveSource::Pwm { unit } = source {
                let enabled = pwm.drive_enabled(unit, io);
                motor.command(pwm.volts(unit, io, now), enabled);
            }
        }
    }

    /// Applies the outputs of foreign modules.
    pub(super) fn modules_changed(&mut self, modules: &ForeignModules, io: &SimIoPorts) {
        let now = self.now;
        for (motor, source) in self.servos() {
            if let DriveSource::Module { gtag, output } = source {
                let signal = modules.drive_signal(gtag, now, output, io);
                motor.command(signal.volts, signal.enabled);
            }
        }
    }

    /// True if a foreign module drives an axis.
    pub(super) fn is_driven_by_modules(&self) -> bool {
        let mut sources = self.sources();
        sources.any(|source| matches!(source, DriveSource::Module { .. }))
    }

    /// Applies the outputs of a remote.
    fn remote_changed(&mut self, port: usize, channel: usize, remote: Option<&dyn RemoteEnd>) {
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

    fn is_driven_by(&self, port: usize, channel: usize) -> bool {
        self.sources().any(|source| {
            matches!(source, DriveSource::Remote { port: p, channel: c, .. }
                if (p, c) == (port, channel))
        })
    }
}

/// The parts of the plant that follow the motion of an axis.
struct World<'a> {
    banks: &'a mut Vec<EncoderBank>,
    installation: &'a mut Installation,
}

impl World<'_> {
    /// Receiver of the movements of an axis.
    fn mover(&mut self, axis: usize, encoder: Option<usize>) -> impl FnMut(&Segment, [f64; 2]) {
        move |segment, positions| {
            if let Some(encoder) = encoder
                && let Some(bank) = self.banks.first_mut()
            {
                bank.turn(encoder, segment);
            }
            let times = [segment.start, segment.end];
            self.installation.moved(axis, times, positions);
        }
    }
}

/// Applies a change of a generator's outputs to the drives that are wired to it.
fn outputs_changed(axes: &mut [Axis], change: OutputChange, world: &mut World<'_>) {
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
