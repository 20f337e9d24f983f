//! Six servo axes on a 7I77, with a 7I72 on its expansion port: the main job of the crate.
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
#[path = "../support/mod.rs"]
mod support;
mod timed;

use std::process::ExitCode;

use args::{Args, Parsed};
use mesa_hal::driver::{Driver, Settings};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use support::{Stop, complain, say};

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let args = match Args::parse() {
        Ok(Parsed::Run(args)) => args,
        Ok(Parsed::Help) => {
            say(format_args!("{}\n", args::HELP));
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            complain(format_args!("servo_loop: {error}\nTry --help."));
            return ExitCode::from(2);
        }
    };
    match Stop::on_signals()
        .map_err(Failure::from)
        .and_then(|stop| run(&args, &stop))
    {
        Ok(code) => code,
        Err(error) => {
            complain(format_args!("servo_loop: {error}"));
            ExitCode::FAILURE
        }
    }
}

/// Runs the loops: 0 if all of them held, 1 if not, and what a signal that came asks for.
fn run(args: &Args, stop: &Stop) -> Result<ExitCode, Failure> {
    match args.address {
        None => run_on(machine::simulated(args)?, args, stop),
        Some(address) => run_on(UdpBus::connect(address, UdpConfig::default())?, args, stop),
    }
}

fn run_on<B: machine::World>(bus: B, args: &Args, stop: &Stop) -> Result<ExitCode, Failure> {
    let settings = Settings {
        period: args.period(),
        pace: args.pace,
        watchdog: args.watchdog,
        ..Settings::default()
    };
    let driver = Driver::start(timed::Timed::new(bus), settings)?;
    say(found::list(&driver, args.pins));
    let mut control = control::Control::new(driver)?;
    let ended = control.run(args, stop);
    // Whatever ended it: the outputs first, then the words.
    let summary = result::Summary::of(&control, args, stop.signal());
    let stopped = control.stop();
    say(&summary.text);
    let result = ended.and(stopped);
    if let Some(signal) = stop.signal() {
        if let Err(error) = result {
            complain(format_args!("servo_loop: {error}"));
        }
        return Ok(signal.exit_code());
    }
    result?;
    Ok(ExitCode::from(u8::from(!summary.all_held)))
}
