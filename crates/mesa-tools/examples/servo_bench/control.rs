//! Six position loops and a walking pattern on the field outputs.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use mesa_hal::boards::{I7i72, I7i77Field};
use mesa_hal::driver::{CycleError, Driver};
use mesa_hal::hal::{Counter, PinError, Pins};
use mesa_hal::runner::Cycle;

use crate::args::Args;
use crate::drives::Drives;
use crate::machine::{AXES, World};
use crate::timed::Timed;
use crate::{Failure, advised};

/// Number of cycles without a new position after which an axis stops: more than an attempt to
/// restart another card of the port takes.
const DEBOUNCE: u64 = 25;
/// Encoder counts for a unit of position, and units per second at full scale: the motors' data.
const COUNTS_PER_UNIT: f64 = 1000.0;
const FULL_SPEED: f64 = 100.0;
const FULL_SCALE: f64 = 10.0;
/// Position gain in 1/s.
const GAIN: f64 = 40.0;
/// The loops are judged after this time, when they have caught up.
const SETTLED: f64 = 0.25;
/// Number of cycles for which a field output keeps its level.
const STEP: u64 = 20;
/// Number of consecutive failed reads after which the board is considered lost.
const GONE: u32 = 50;

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

/// Results of the field I/O of a 7I77, after the start.
#[derive(Clone, Copy, Debug, Default)]
pub struct FieldIo {
    /// Cycles that count.
    pub cycles: u64,
    /// Counted cycles in which every input was valid.
    pub valid: u64,
    /// Cycles since the last one with every input valid.
    pub since_valid: u64,
    /// Cycles in which outputs were wired back to inputs.
    pub loop_backs: u64,
    pub loop_back_errors: u64,
}

/// The host's time in the cycles so far.
#[derive(Clone, Copy, Debug)]
struct HostTime {
    /// Start of the first cycle on the clocks of the host and of the board, and the time spent in
    /// the bus before it.
    begun: Instant,
    board: mesa_hal::bus::Instant,
    below: Duration,
    /// Time spent on the progress bar.
    aside: Duration,
}

/// The host's time in a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Time in driver and loops.
    pub above: Duration,
    /// Time in the bus, and in waiting for the next period.
    pub below: Duration,
}

#[derive(Debug)]
pub struct Control {
    pub axes: [Axis; AXES],
    pub drives: Drives,
    field: Option<I7i77Field>,
    outputs: Option<I7i72>,
    /// The last commands to the field outputs, newest first.
    pattern: [u16; 3],
    pub field_io: FieldIo,
    /// Cycles with a failure.
    pub bad_cycles: u64,
    /// Smallest rest of a period, where the board paces.
    pub least_slack: Option<Duration>,
    /// The reason for ending the run early.
    pub failure: Option<Failure>,
    pub spent: Spent,
    host_time: Option<HostTime>,
    progress: ProgressBar,
}

impl Control {
    pub fn new<B: World>(driver: &mut Driver<Timed<B>>, args: &Args) -> Result<Self, Failure> {
        let mut control = Self {
            axes: [Axis::default(); AXES],
            drives: Drives::find(driver)?,
            // A 7I97 needs no remotes; those present are used.
            field: driver.attach((0, 0)).ok(),
            outputs: driver.attach((0, 2)).ok(),
            pattern: [0; 3],
            field_io: FieldIo::default(),
            bad_cycles: 0,
            least_slack: None,
            failure: None,
            spent: Spent::default(),
            host_time: None,
            progress: progress_bar(args.cycles()),
        };
        let name = driver.name().to_owned();
        let found = control.find_encoders(driver.pins_mut(), &name);
        found.map_err(|error| advised(&error))?;
        Ok(control)
    }

    fn find_encoders(&mut self, pins: &mut Pins, name: &str) -> Result<(), PinError> {
        for (n, axis) in self.axes.iter_mut().enumerate() {
            axis.encoder = Counter::find(pins, &format!("{name}.encoder.{n:02}"))?;
            pins.set_param(axis.encoder.scale, COUNTS_PER_UNIT)?;
        }
        Ok(())
    }

    /// One cycle, between its read and its write; the one after the last ends the run.
    pub fn cycle<B: World>(
        &mut self,
        cycle: &mut Cycle<'_, Timed<B>>,
        args: &Args,
    ) -> ControlFlow<()> {
        let time = self.measure(cycle);
        if cycle.number == args.cycles() {
            self.progress.finish_and_clear();
            return ControlFlow::Break(());
        }
        // The run survives lost packets, but not the loss of the board.
        let is_read = match &cycle.read {
            Ok(report) => {
                let least = self.least_slack.into_iter().chain(report.slack).min();
                self.least_slack = least;
                report.is_good()
            }
            Err(CycleError::Read { consecutive, .. }) if *consecutive < GONE => false,
            Err(error) => {
                self.failure = Some(advised(error));
                return ControlFlow::Break(());
            }
        };
        let is_good = is_read && cycle.write.is_ok();
        self.bad_cycles += u64::from(!is_good);
        if cycle.driver.bus_mut().loop_back() {
            self.field_io.loop_backs += 1;
        }
        let number = cycle.number;
        self.close_loops(cycle.pins_mut(), time);
        self.check_field_io(cycle.pins(), number, time);
        self.walk(cycle.pins_mut(), number);
        ControlFlow::Continue(())
    }

    /// Records the time of the earlier cycles. Returns the time since the start of the first, in
    /// seconds.
    fn measure<B: World>(&mut self, cycle: &Cycle<'_, Timed<B>>) -> f64 {
        let below = cycle.driver.bus().spent();
        let host = self.host_time.get_or_insert_with(|| HostTime {
            begun: Instant::now(),
            board: cycle.begun,
            below,
            aside: Duration::ZERO,
        });
        let below = below.saturating_sub(host.below);
        let all = host.begun.elapsed().saturating_sub(host.aside);
        let above = all.saturating_sub(below);
        self.spent = Spent { above, below };
        let drawn = Instant::now();
        self.progress.set_position(cycle.number);
        host.aside += drawn.elapsed();
        cycle.begun.since(host.board).as_secs_f64()
    }

    fn close_loops(&mut self, pins: &mut Pins, time: f64) {
        let mut all_known = true;
        for (n, (axis, drive)) in self.axes.iter_mut().zip(self.drives.outputs).enumerate() {
            let (target, velocity) = trajectory(n, time);
            let position = axis.encoder.read(pins);
            // Neither a lost reply nor the restart of another card stops the axes.
            let is_known = position.within(DEBOUNCE).is_some();
            all_known &= is_known;
            let error = target - position.value;
            if time >= SETTLED {
                axis.worst = axis.worst.max(error.abs());
                axis.sum_of_squares += error * error;
                axis.samples += 1;
            }
            let speed = velocity + GAIN * error;
            let volts = if is_known {
                speed / FULL_SPEED * FULL_SCALE
            } else {
                0.0
            };
            let volts = volts.clamp(-FULL_SCALE, FULL_SCALE);
            drive.set(pins, volts);
        }
        for drive in self.drives.outputs {
            drive.enable(pins, all_known);
        }
    }

    /// A light that walks over the field outputs of the 7I77, and another over those of the 7I72.
    fn walk(&mut self, pins: &mut Pins, cycle: u64) {
        let step = cycle / STEP;
        let word = 1u16 << (step % 16);
        let [newest, older, _] = self.pattern;
        self.pattern = [word, newest, older];
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
    fn check_field_io(&mut self, pins: &Pins, cycle: u64, time: f64) {
        let Some(field) = &self.field else { return };
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

    /// True if the field I/O of a 7I77 is present.
    pub fn has_field(&self) -> bool {
        self.field.is_some()
    }
}

/// Target position and velocity of axis `n` at `time`: each oscillates at its own frequency, and
/// starts without a jerk.
fn trajectory(n: usize, time: f64) -> (f64, f64) {
    let omega = core::f64::consts::TAU * (0.4 + 0.1 * n as f64);
    let amplitude = 6.0 - 0.5 * n as f64;
    let position = amplitude * (1.0 - (omega * time).cos());
    (position, amplitude * omega * (omega * time).sin())
}

/// Hidden by the library where standard error is not a terminal.
fn progress_bar(cycles: u64) -> ProgressBar {
    let bar = ProgressBar::new(cycles);
    let template = "{bar:40} {pos}/{len} cycles, {per_sec}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}
