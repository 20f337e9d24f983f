//! Five stepper axes on a 7I76: the sister of `servo_loop`, on the embedded simulated FPGA.
//!
//! The board is a simulated 7I92 with a motor at each step generator, on virtual time. Each axis
//! follows a path of its own, with speed and acceleration as real machines have them, and the
//! motors, which lose steps when they are asked for too much, are compared with what the driver
//! reports.

use std::error::Error;
use std::fmt::Write;
use std::io::{self, Write as _};
use std::ops::ControlFlow::{Break, Continue};
use std::process::ExitCode;

use mesa_hal::driver::{Driver, Settings};
use mesa_hal::hal::Pins;
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::runner::{Runner, Stop};
use mesa_hal_sim::{SimFpga, Stepper, StepperConfig, StepperWiring, machines};

const AXES: usize = 5;
/// Steps for a millimetre: 200 steps and 8 microsteps each for a turn, and a pitch of 5 mm.
const SCALE: f64 = 320.0;
/// The greatest speed in mm/s and acceleration in mm/s², of which the paths use less.
const SPEED: f64 = 120.0;
const ACCELERATION: f64 = 600.0;
/// Periods of 1 ms in motion, and until the axes have come to rest.
const MOVING: u64 = 10_000;
const RESTING: u64 = 200;

type Failure = Box<dyn Error>;

fn main() -> ExitCode {
    run().unwrap_or_else(|error| {
        eprintln!("step_loop: {error}");
        ExitCode::FAILURE
    })
}

/// A 7I92 with a 7I76 and five motors.
fn machine() -> Result<SimFpga, Failure> {
    let mut fpga = machines::i7i92_7i76();
    for generator in 0..AXES {
        fpga.wire_stepper(StepperWiring {
            generator,
            encoder: None,
            motor: Stepper::new(StepperConfig {
                steps_per_unit: SCALE,
                counts_per_unit: SCALE,
                max_acceleration: 1_000.0,
                max_speed: 200.0,
                start_speed: 2.0,
                ..StepperConfig::default()
            })?,
        });
    }
    Ok(fpga)
}

/// Sets a generator up for its drive.
fn set_up(pins: &mut Pins, axis: &StepgenPins) -> Result<(), Failure> {
    pins.set_param(axis.position_scale, SCALE)?;
    pins.set_param(axis.maxvel, SPEED)?;
    pins.set_param(axis.maxaccel, ACCELERATION)?;
    let times = [axis.steplen, axis.stepspace, axis.dirsetup, axis.dirhold];
    for time in times {
        pins.set_param(time, 2_500)?; // ns
    }
    Ok(())
}

/// The position of an axis in mm: to and fro, each axis at its own pace, from rest to rest.
fn path(axis: usize, cycle: u64) -> f64 {
    let part = cycle.min(MOVING) as f64 / MOVING as f64;
    let turns = (axis + 2) as f64;
    let reach = [60.0, 30.0, 15.0, 10.0, 8.0][axis];
    // Begins and ends gently.
    let smooth = part * part * (3.0 - 2.0 * part);
    reach * (1.0 - (std::f64::consts::TAU * turns * smooth).cos())
}

fn run() -> Result<ExitCode, Failure> {
    let mut driver = Driver::start(machine()?, Settings::default())?; // 1 ms
    let module = driver.modules::<Stepgens>().next();
    let axes: Vec<StepgenPins> = module.map_or_else(Vec::new, |module| module.pins().collect());
    for axis in &axes {
        set_up(driver.pins_mut(), axis)?;
    }
    let mut worst = [0.0_f64; AXES];
    let mut motors = [Stepper::default(); AXES];
    let ended = Runner::new(driver)
        .stop_on(Stop::on_signals()?)
        .run(|cycle| {
            let number = cycle.number;
            let pins = cycle.pins_mut();
            for (n, axis) in axes.iter().enumerate() {
                // The feedback follows the command of the period before.
                let lag = pins.read(axis.position_lag).value;
                worst[n] = worst[n].max(lag.abs());
                pins.set(axis.enable, true);
                pins.set(axis.position_cmd, path(n, number));
            }
            let is_over = number >= MOVING + RESTING;
            for (n, motor) in motors.iter_mut().enumerate() {
                let present = cycle.driver.bus_mut().stepper(n);
                *motor = present.copied().unwrap_or_default();
            }
            if is_over { Break(()) } else { Continue(()) }
        });
    if let Some(signal) = ended.signal {
        ended.stopped?;
        return Ok(signal.exit_code());
    }
    let mut text = String::new();
    let mut all_held = axes.len() == AXES;
    for (n, axis) in axes.iter().enumerate() {
        let shown = ended.driver.pins().read(axis.position_fb).value;
        let motor = motors[n];
        let lost = motor.lost() + motor.overshot();
        let holds = lost == 0 && (motor.position() - shown).abs() <= 1.0 / SCALE && worst[n] < 0.01;
        all_held &= holds;
        writeln!(
            text,
            "axis {n}: worst following error {:.4} mm, motor at {:.4} mm ({shown:.4} mm reported), {lost} steps lost{}",
            worst[n],
            motor.position(),
            if holds { "" } else { ": NOT HELD" }
        )?;
    }
    let _ = io::stdout().write_all(text.as_bytes()); // perhaps nobody reads
    ended.stopped?; // rates 0, outputs off
    Ok(ExitCode::from(u8::from(!all_held)))
}
