//! Six servo axes on a 7I77, with a 7I72 on its expansion port, and a summary of everything that
//! was counted. `tests/mesa/interop_servo_loop` runs it on simulated boards, with real sockets and
//! clocks; it measures a real board as well.
//!
//! Without `--addr` the board is a simulated 7I92 with motors on virtual time; with it, a real (or
//! simulated) Ethernet board: one with the same remotes, or a 7I97, which has analog outputs of its
//! own and needs no remotes.

mod args;
mod control;
mod drives;
mod found;
mod machine;
mod result;
mod timed;

use std::fmt::Display;
use std::io::{self, Write};
use std::net::SocketAddrV4;
use std::process::ExitCode;
use std::time::Duration;

use args::{Args, Parsed};
use mesa_hal::driver::{Driver, Settings};
use mesa_hal::runner::{Runner, Stop};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal::{MesaError, WithAdvice};

/// Limit of the wait for a transfer. The wait only measures the transfer: a cycle itself need not
/// wait.
const TRANSFER_LIMIT: Duration = Duration::from_micros(500);

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let args = match Args::parse() {
        Ok(Parsed::Run(args)) => args,
        Ok(Parsed::Help) => {
            print(format_args!("{}\n", args::HELP));
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            print_error(format_args!("servo_bench: {error}\nTry --help."));
            return ExitCode::from(2);
        }
    };
    match Stop::on_signals()
        .map_err(Failure::from)
        .and_then(|stop| run(&args, &stop))
    {
        Ok(code) => code,
        Err(error) => {
            print_error(format_args!("servo_bench: {error}"));
            ExitCode::FAILURE
        }
    }
}

/// Runs the loops. Returns 0 if all of them held and 1 if not, or the exit code of a signal.
fn run(args: &Args, stop: &Stop) -> Result<ExitCode, Failure> {
    match args.address {
        None => run_on(machine::simulated(args)?, args, stop),
        Some(address) => run_on(connect(address)?, args, stop),
    }
}

fn connect(address: SocketAddrV4) -> Result<UdpBus, Failure> {
    let bus = UdpBus::connect(address, UdpConfig::default());
    bus.map_err(|error| advised(&error))
}

/// A failure with the facts of an error and its advice.
fn advised(error: &dyn MesaError) -> Failure {
    WithAdvice::of(error).to_string().into()
}

fn run_on<B: machine::World>(bus: B, args: &Args, stop: &Stop) -> Result<ExitCode, Failure> {
    let settings = Settings {
        period: args.period(),
        pace: args.pace,
        watchdog: args.watchdog,
        ..Settings::default()
    };
    let driver = Driver::start(timed::Timed::new(bus), settings);
    let mut driver = driver.map_err(|error| advised(&error))?;
    print(found::list(&driver, args.pins));
    let mut control = control::Control::new(&mut driver, args)?;
    let ended = Runner::new(driver)
        .stop_on(stop.clone())
        .waiting_for_transfers(TRANSFER_LIMIT)
        .run(|cycle| control.cycle(cycle, args));
    // The outputs are off by now, whatever ended the run; the summary follows.
    let summary = result::Summary::of(&control, &ended, args);
    print(&summary.text);
    let stopped = ended.stopped;
    let stopped = stopped.map_err(|error| advised(&error));
    let result = control.failure.map_or(Ok(()), Err).and(stopped);
    if let Some(signal) = ended.signal {
        if let Err(error) = result {
            print_error(format_args!("servo_bench: {error}"));
        }
        return Ok(signal.exit_code());
    }
    result?;
    Ok(ExitCode::from(u8::from(!summary.all_held)))
}

/// Prints text, if somebody reads it: the board is driven on without an output.
fn print(text: impl Display) {
    let mut out = io::stdout().lock();
    let _ = write!(out, "{text}").and_then(|()| out.flush());
}

fn print_error(text: impl Display) {
    let _ = writeln!(io::stderr(), "{text}");
}
