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
mod timed;

use std::process::ExitCode;

use args::{Args, Parsed};
use mesa_hal::driver::Driver;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let args = match Args::parse() {
        Ok(Parsed::Run(args)) => args,
        Ok(Parsed::Help) => {
            println!("{}", args::HELP);
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("servo_loop: {error}\nTry --help.");
            return ExitCode::from(2);
        }
    };
    match run(&args) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("servo_loop: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Runs the loops; whether all of them held.
fn run(args: &Args) -> Result<bool, Failure> {
    match args.address {
        None => run_on(machine::simulated(args)?, args),
        Some(address) => run_on(UdpBus::connect(address, UdpConfig::default())?, args),
    }
}

fn run_on<B: machine::World>(bus: B, args: &Args) -> Result<bool, Failure> {
    let driver = Driver::builder(timed::Timed::new(bus))
        .period(args.period())
        .pace(args.pace)
        .watchdog(args.watchdog)
        .build()?;
    found::print(&driver, args.pins);
    let mut control = control::Control::new(driver, args)?;
    control.run(args)?;
    let held = result::print(&control, args);
    control.stop()?;
    Ok(held)
}
