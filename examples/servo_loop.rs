//! Closes six position loops with the analog outputs and encoders of a 7I77: on a simulated 7I92
//! with motors, or on an Ethernet board with a 7I77 on its first port, or on a 7I97.
//!
//! ```text
//! cargo run --release --example servo_loop -- [--addr IP[:PORT]] [--seconds N]
//! ```

use std::error::Error;
use std::fmt::Write;
use std::io::{self, Write as _};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::ops::ControlFlow::{Break, Continue};
use std::process::ExitCode;

use mesa_hal::bus::DynBus;
use mesa_hal::hal::{Age, AnalogOut, Counter, PinError};
use mesa_hal::runner::{Runner, Stop};
use mesa_hal::{Driver, I7i77Analog, I7i97, MesaError, Settings, UdpBus, UdpConfig};
use mesa_hal_sim::{Motor, machines};

/// Encoder counts for a unit of position, and units per second at 10 V: the data of the motors.
const COUNTS: f64 = 1000.0;
const FULL_SPEED: f64 = 100.0;
/// Gain of the loops in 1/s.
const GAIN: f64 = 40.0;
/// A loop holds if its error stays below this, in units, after the first quarter of a second.
const HOLDS: f64 = 0.25;
const SETTLED: f64 = 0.25;

struct Axis {
    encoder: Counter,
    drive: AnalogOut,
    /// Worst following error so far; NaN before the first one that counts.
    worst: f64,
}

fn main() -> ExitCode {
    run().unwrap_or_else(|error| {
        eprintln!("servo_loop: {error}");
        ExitCode::FAILURE
    })
}

fn run() -> Result<ExitCode, Box<dyn Error>> {
    let (address, seconds) = options()?;
    let bus = match address {
        Some(address) => DynBus::new(connected(address)?),
        None => DynBus::new(machines::six_axes_7i92(Motor::default())),
    };
    let driver = Driver::start(bus, Settings::default()); // 1 ms
    let mut driver = driver.map_err(|error| error.with_advice().to_string())?;
    let mut axes = axes(&mut driver)?;
    let period = driver.period().as_secs_f64();
    let (mut failed, cycles) = (0, u64::from(seconds) * 1000);

    let ended = Runner::new(driver)
        .stop_on(Stop::on_signals()?)
        .run(|cycle| {
            let is_good = cycle.report().is_some_and(|report| report.is_good());
            failed += u64::from(!is_good);
            let (number, pins) = (cycle.number, cycle.pins_mut());
            let time = number as f64 * period;
            let mut all_known = true;
            for (n, axis) in axes.iter_mut().enumerate() {
                // Each axis oscillates at its own frequency, and starts without a jerk.
                let omega = std::f64::consts::TAU * (0.4 + 0.1 * n as f64);
                let target = 5.0 * (1.0 - (omega * time).cos());
                let velocity = 5.0 * omega * (omega * time).sin();
                let position = axis.encoder.read(pins); // value, valid, age
                let error = target - position.value;
                if time >= SETTLED {
                    axis.worst = axis.worst.max(error.abs());
                }
                let is_known = position.within(Age::NEIGHBOUR_RESTART).is_some();
                all_known &= is_known;
                let volts = (velocity + GAIN * error) / FULL_SPEED * 10.0;
                axis.drive.set(pins, if is_known { volts } else { 0.0 });
            }
            for axis in &axes {
                axis.drive.enable(pins, all_known);
            }
            if number < cycles {
                Continue(())
            } else {
                Break(())
            }
        });
    // The outputs are off and the ports stopped by now, whatever ended the run.
    let mut text = format!(
        "{}, {} cycles of 1 ms, {failed} failed\n",
        ended.driver.name(),
        ended.statistics.cycles
    );
    for (n, axis) in axes.iter().enumerate() {
        let verdict = if axis.worst < HOLDS {
            "held"
        } else {
            "NOT HELD"
        };
        writeln!(
            text,
            "axis {n}: worst following error {:.4} units, {verdict}",
            axis.worst
        )?;
    }
    let _ = io::stdout().write_all(text.as_bytes()); // perhaps nobody reads
    ended.stopped?;
    let all_held = axes.iter().all(|axis| axis.worst < HOLDS);
    Ok(match ended.signal {
        Some(signal) => signal.exit_code(),
        None => ExitCode::from(u8::from(!all_held)),
    })
}

fn connected(address: SocketAddrV4) -> Result<UdpBus, String> {
    let bus = UdpBus::connect(address, UdpConfig::default());
    bus.map_err(|error| error.with_advice().to_string())
}

/// The analog outputs of a 7I97, or else of the 7I77 on channel 1, each with an encoder of the
/// board.
fn axes(driver: &mut Driver<DynBus>) -> Result<Vec<Axis>, Box<dyn Error>> {
    let drives = match driver.attach_board::<I7i97>() {
        Ok(board) => board.analog_out,
        Err(_) => driver.attach::<I7i77Analog>((0, 1))?.analog_out,
    };
    let name = driver.name().to_owned();
    let pins = driver.pins_mut();
    let axes = drives.into_iter().enumerate().map(|(n, drive)| {
        let encoder = Counter::find(pins, &format!("{name}.encoder.{n:02}"))?;
        pins.set_param(encoder.scale, COUNTS)?;
        Ok(Axis {
            encoder,
            drive,
            worst: f64::NAN,
        })
    });
    Ok(axes.collect::<Result<_, PinError>>()?)
}

/// The address of the board, and the time in seconds.
fn options() -> Result<(Option<SocketAddrV4>, u32), Box<dyn Error>> {
    let (mut address, mut seconds) = (None, 5);
    let mut arguments = std::env::args().skip(1);
    while let Some(option) = arguments.next() {
        let value = arguments.next().unwrap_or_default();
        let ip = || {
            value
                .parse::<Ipv4Addr>()
                .map(|ip| SocketAddrV4::new(ip, 27_181))
        };
        match &*option {
            "--addr" => address = Some(value.parse().or_else(|_| ip())?),
            "--seconds" => seconds = value.parse()?,
            _ => return Err("expected --addr IP[:PORT] or --seconds N".into()),
        }
    }
    Ok((address, seconds))
}
