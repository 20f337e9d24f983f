//! Six position loops and a walking pattern on the field outputs.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use mesa_hal::boards::{I7i72, I7i77Field};
use mesa_hal::driver::{CycleError, Driver, Pace};
use mesa_hal::hal::{Counter, PinError};

use crate::Failure;
use crate::args::Args;
use crate::drives::Drives;
use crate::machine::{AXES, World};
use crate::support::Stop;
use crate::timed::Timed;

/// Encoder counts for a unit of position, and units per second at full scale: the motors' data.
const COUNTS_PER_UNIT: f64 = 1000.0;
const FULL_SPEED: f64 = 100.0;
const FULL_SCALE: f64 = 10.0;
/// Position gain in 1/s.
const GAIN: f64 = 40.0;
/// The loops are judged after this time, when they have caught up.
const SETTLED: f64 = 0.25;
/// A field output keeps its level for so many cycles.
const STEP: u64 = 20;
/// So many failed reads in a row say that the board is gone.
const GONE: u32 = 50;

/// The longest wait for a transfer, which is measured that way.
const TRANSFER_LIMIT: Duration = Duration::from_micros(500);

/// A position loop.
#[derive(Clone, Copy, Debug, Default)]
pub struct Axis {
    encoder: Counter,
    pub worst: f64,
    sum_of_squares: f64,
    pub samples: u64,
}

impl Axis {
    pub fn rms(&self) -> f64 {
        (self.sum_of_squares / self.samples.max(1) as f64).sqrt()
    }
}

/// How the field I/O of a 7I77 did, after the start.
#[derive(Clone, Copy, Debug, Default)]
pub struct FieldIo {
    /// Cycles that count.
    pub cycles: u64,
    /// Of these, those in which every input was valid.
    pub valid: u64,
    /// Cycles since the last one in which they were.
    pub since_valid: u64,
    /// Cycles in which outputs were wired back to inputs.
    pub loop_backs: u64,
    pub loop_back_errors: u64,
}

#[derive(Debug)]
pub struct Control<B: World> {
    pub driver: Driver<Timed<B>>,
    pub axes: [Axis; AXES],
    pub drives: Drives,
    field: Option<I7i77Field>,
    outputs: Option<I7i72>,
    /// What the field outputs were told lately, newest first.
    pattern: [u16; 3],
    pub field_io: FieldIo,
    pub cycles: u64,
    /// Of these, those in which anything failed.
    pub bad_cycles: u64,
    /// The least that was left of a period, where the board paces.
    pub least_slack: Option<Duration>,
    pub host_time: Duration,
}

impl<B: World> Control<B> {
    pub fn new(driver: Driver<Timed<B>>) -> Result<Self, Failure> {
        let drives = Drives::find(&driver)?;
        // A 7I97 needs no remotes; what is there is used.
        let field = driver.attach(0, 0).ok();
        let outputs = driver.attach(0, 2).ok();
        let name = driver.name().to_owned();
        let mut control = Self {
            driver,
            axes: [Axis::default(); AXES],
            drives,
            field,
            outputs,
            pattern: [0; 3],
            field_io: FieldIo::default(),
            cycles: 0,
            bad_cycles: 0,
            least_slack: None,
            host_time: Duration::ZERO,
        };
        control.find_encoders(&name)?;
        Ok(control)
    }

    fn find_encoders(&mut self, name: &str) -> Result<(), PinError> {
        let pins = self.driver.pins_mut();
        for (n, axis) in self.axes.iter_mut().enumerate() {
            axis.encoder = Counter::find(pins, &format!("{name}.encoder.{n:02}"))?;
            pins.set_param(axis.encoder.scale, COUNTS_PER_UNIT)?;
        }
        Ok(())
    }

    /// Runs all cycles, or until it is stopped.
    pub fn run(&mut self, args: &Args, stop: &Stop) -> Result<(), Failure> {
        let progress = progress_bar(args.cycles());
        let period = args.period();
        let mut next = self.driver.bus_mut().now();
        for cycle in 0..args.cycles() {
            if stop.signal().is_some() {
                break;
            }
            let start = Instant::now();
            let below = self.driver.bus().spent();
            self.cycle(cycle, args)?;
            let below = self.driver.bus().spent().saturating_sub(below);
            self.host_time += start.elapsed().saturating_sub(below);
            progress.inc(1);
            if args.pace == Pace::Host {
                next = next.after(period);
                let now = self.driver.bus_mut().now();
                self.driver.bus_mut().wait(next.since(now));
            }
        }
        progress.finish_and_clear();
        Ok(())
    }

    fn cycle(&mut self, cycle: u64, args: &Args) -> Result<(), Failure> {
        self.cycles += 1;
        let read = self.read();
        let time = cycle as f64 / args.rate;
        self.close_loops(time);
        self.check_field_io(cycle, time);
        self.walk(cycle);
        let is_written = self.driver.write().is_ok();
        // Only to measure the transfer: the cycle itself does not need to wait for it.
        let is_measured = self.driver.wait_transfers(TRANSFER_LIMIT).is_ok();
        let is_good = matches!(read, Ok(true)) && is_written && is_measured;
        self.bad_cycles += u64::from(!is_good);
        if self.driver.bus_mut().loop_back() {
            self.field_io.loop_backs += 1;
        }
        read.map(drop)
    }

    /// Whether all that was read is good. Lost packets are survived; that the board is gone is not.
    fn read(&mut self) -> Result<bool, Failure> {
        match self.driver.read() {
            Ok(report) => {
                let least = self.least_slack.into_iter().chain(report.slack).min();
                self.least_slack = least;
                Ok(report.is_good())
            }
            Err(CycleError::Read { consecutive, .. }) if consecutive < GONE => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    fn close_loops(&mut self, time: f64) {
        let pins = self.driver.pins_mut();
        let mut all_valid = true;
        for (n, (axis, drive)) in self.axes.iter_mut().zip(self.drives.outputs).enumerate() {
            let (target, velocity) = trajectory(n, time);
            let position = axis.encoder.read(pins);
            all_valid &= position.valid;
            let error = target - position.value;
            if time >= SETTLED {
                axis.worst = axis.worst.max(error.abs());
                axis.sum_of_squares += error * error;
                axis.samples += 1;
            }
            let speed = velocity + GAIN * error;
            let volts = if position.valid {
                speed / FULL_SPEED * FULL_SCALE
            } else {
                0.0
            };
            let volts = volts.clamp(-FULL_SCALE, FULL_SCALE);
            drive.set(pins, volts);
        }
        for drive in self.drives.outputs {
            drive.enable(pins, all_valid);
        }
    }

    /// A light that walks over the field outputs of the 7I77, and another over those of the 7I72.
    fn walk(&mut self, cycle: u64) {
        let step = cycle / STEP;
        let word = 1u16 << (step % 16);
        let [newest, older, _] = self.pattern;
        self.pattern = [word, newest, older];
        let pins = self.driver.pins_mut();
        let outputs = self.field.iter().flat_map(|field| &field.outputs);
        for (n, output) in outputs.enumerate() {
            output.set(pins, word >> n & 1 != 0);
        }
        let outputs = self.outputs.iter().flat_map(|remote| &remote.outputs);
        for (n, output) in (0u64..).zip(outputs) {
            output.set(pins, n == step % 48);
        }
    }

    /// Counts the cycles with valid inputs. Where they are wired back, inputs follow the outputs of
    /// the same number, two transfers later.
    fn check_field_io(&mut self, cycle: u64, time: f64) {
        let Some(field) = &self.field else { return };
        let pins = self.driver.pins();
        let counted = &mut self.field_io;
        let is_valid = field.inputs.iter().all(|input| input.read(pins).valid);
        counted.since_valid = if is_valid { 0 } else { counted.since_valid + 1 };
        if time >= SETTLED {
            counted.cycles += 1;
            counted.valid += u64::from(is_valid);
        }
        if counted.loop_backs == 0 || cycle % STEP < 4 {
            return;
        }
        let [newest, ..] = self.pattern;
        for (n, input) in field.inputs.iter().take(16).enumerate() {
            let reading = input.read(pins);
            let expected = newest >> n & 1 != 0;
            counted.loop_back_errors += u64::from(!reading.valid || reading.value != expected);
        }
    }

    /// Whether there is a 7I77's field I/O.
    pub fn has_field(&self) -> bool {
        self.field.is_some()
    }

    pub fn stop(self) -> Result<(), Failure> {
        let (_, stopped) = self.driver.shutdown();
        Ok(stopped?)
    }
}

/// Where axis `n` is to be at `time`, and how fast: each swings at its own pace, and sets out
/// without a jerk.
fn trajectory(n: usize, time: f64) -> (f64, f64) {
    let omega = core::f64::consts::TAU * (0.4 + 0.1 * n as f64);
    let amplitude = 6.0 - 0.5 * n as f64;
    let position = amplitude * (1.0 - (omega * time).cos());
    (position, amplitude * omega * (omega * time).sin())
}

/// Hidden by itself where standard error is no terminal.
fn progress_bar(cycles: u64) -> ProgressBar {
    let bar = ProgressBar::new(cycles);
    let template = "{bar:40} {pos}/{len} cycles, {per_sec}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}
