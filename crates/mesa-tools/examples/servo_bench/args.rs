//! The command line.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use lexopt::prelude::*;
use mesa_hal::driver::Pace;

pub const HELP: &str = "\
Closes six position loops on a 7I77 (with a 7I72 on its expansion port), or on a 7I97.

Usage: servo_bench [OPTIONS]

  --seconds N   how long to run, 0.5 to 3600 (5)
  --rate HZ     cycles per second, 100 to 5000 (1000)
  --realtime    pace the simulated machine by the clock; otherwise it runs as fast as it can
  --addr IP[:PORT]
                run on the Ethernet board there instead of the simulated one
  --pace host|board
                who begins a cycle (host); board needs --addr, and a board with a DPLL
  --watchdog MS the board's outputs go off after so long without a write, 1 to 1000 (5 periods, at least 5)
  --pins        list every pin and parameter that was found
  --help        this text

SIGINT (Ctrl-C) and SIGTERM end it early: outputs off, ports stopped, summary printed.

Exits with 0 if all loops held, 1 if not, 2 for bad arguments, 130 after SIGINT, 143 after SIGTERM.";

/// The port at which boards listen.
const PORT: u16 = 27181;

#[derive(Clone, Copy, Debug)]
pub struct Args {
    pub seconds: f64,
    pub rate: f64,
    pub realtime: bool,
    pub address: Option<SocketAddrV4>,
    pub pins: bool,
    pub pace: Pace,
    pub watchdog: Option<Duration>,
}

#[derive(Clone, Copy, Debug)]
pub enum Parsed {
    Run(Args),
    Help,
}

impl Args {
    pub fn parse() -> Result<Parsed, lexopt::Error> {
        let mut args = Self {
            seconds: 5.0,
            rate: 1000.0,
            realtime: false,
            address: None,
            pins: false,
            pace: Pace::Host,
            watchdog: None,
        };
        let mut parser = lexopt::Parser::from_env();
        while let Some(arg) = parser.next()? {
            match arg {
                Long("seconds") => {
                    args.seconds = within(&parser.value()?, "--seconds", 0.5, 3600.0)?;
                }
                Long("rate") => args.rate = within(&parser.value()?, "--rate", 100.0, 5000.0)?,
                Long("realtime") => args.realtime = true,
                Long("pace") => args.pace = parser.value()?.parse()?,
                Long("watchdog") => {
                    let millis = within(&parser.value()?, "--watchdog", 1.0, 1000.0)?;
                    args.watchdog = Some(Duration::from_secs_f64(millis * 1e-3));
                }
                Long("pins") => args.pins = true,
                Long("addr") => args.address = Some(parser.value()?.parse_with(address)?),
                Short('h') | Long("help") => return Ok(Parsed::Help),
                other => return Err(other.unexpected()),
            }
        }
        Ok(Parsed::Run(args))
    }

    pub fn period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.rate)
    }

    pub fn cycles(&self) -> u64 {
        (self.seconds * self.rate).round() as u64
    }
}

fn within(value: &std::ffi::OsStr, option: &str, min: f64, max: f64) -> Result<f64, lexopt::Error> {
    let text = value.to_string_lossy();
    match text.parse::<f64>() {
        Ok(number) if (min..=max).contains(&number) => Ok(number),
        _ => Err(format!("{option}: '{text}' is not a number from {min} to {max}").into()),
    }
}

fn address(text: &str) -> Result<SocketAddrV4, String> {
    text.parse()
        .or_else(|_| {
            text.parse::<Ipv4Addr>()
                .map(|ip| SocketAddrV4::new(ip, PORT))
        })
        .map_err(|_| format!("'{text}' is not an address such as 10.10.10.10 or 127.0.0.1:27181"))
}
