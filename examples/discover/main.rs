//! The inventory of a board: identity, firmware, modules, pins, serial ports, and their remotes
//! with modes, process data and parameters.
//!
//! ```sh
//! cargo run --release --example discover -- --sim
//! cargo run --release --example discover -- --addr 10.10.10.10 --json
//! ```

mod json;
mod report;
#[path = "../support/mod.rs"]
mod support;
mod terminals;
mod text;

use std::error::Error;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::process::ExitCode;

use mesa_hal::bus::{BusError, BusErrorKind};
use mesa_hal::ethernet::EthernetBoard;
use mesa_hal::lbp16;
use mesa_hal::sim::devices::{Analog, FieldIo, Outputs48};
use mesa_hal::sim::machines;
use mesa_hal::transport::udp::{UdpBus, UdpConfig, UdpError};
use report::{Modes, Report};
use support::{Stop, complain, say};

const USAGE: &str = "\
Prints the inventory of a Mesa board: identity, firmware, modules, pins, serial ports and remotes.

Usage: discover (--addr IP[:PORT] | --sim) [--mode PORT.CHANNEL=MODE]... [--json]

  --addr IP[:PORT]          an Ethernet board; the port is 27181 unless given
  --sim                     the embedded simulated machine: a 7I92 with a 7I77, and a 7I72
  --mode PORT.CHANNEL=MODE  start this remote in a software mode other than 0
  --json                    for programs
  --help                    this text

It stops the serial ports and turns all pins into inputs: not for a machine that is running. A board
that another program drives is left alone. SIGINT (Ctrl-C) and SIGTERM end it between two ports, and
leave the ports stopped.

Exits with 0 if all was found as asked for, 1 if not, 2 for bad arguments, 130 after SIGINT, 143
after SIGTERM.";

fn main() -> ExitCode {
    let options = match Options::parse(lexopt::Parser::from_env()) {
        Ok(Some(options)) => options,
        Ok(None) => {
            say(format_args!("{USAGE}\n"));
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            complain(format_args!("discover: {error}\n\n{USAGE}"));
            return ExitCode::from(2);
        }
    };
    match run(&options) {
        Ok(code) => code,
        Err(error) => {
            complain(format_args!("discover: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<ExitCode, Box<dyn Error>> {
    let stop = Stop::on_signals()?;
    let report = take(options, &stop)?;
    say(if options.json {
        format!("{:#}\n", json::of(&report))
    } else {
        text::of(&report)?
    });
    if let Some(signal) = stop.signal() {
        complain(format_args!(
            "discover: ended by {signal}; the inventory is not complete"
        ));
        return Ok(signal.exit_code());
    }
    report.check_modes(&options.modes)?;
    Ok(ExitCode::SUCCESS)
}

fn take(options: &Options, stop: &Stop) -> Result<Report, Box<dyn Error>> {
    match options.board {
        Source::Simulated => {
            let mut fpga = machines::i7i92_7i77();
            fpga.plug(0, 0, Some(Box::new(FieldIo::i7i77()?)));
            fpga.plug(0, 1, Some(Box::new(Analog::i7i77()?)));
            fpga.plug(0, 2, Some(Box::new(Outputs48::i7i72()?)));
            report::take(&mut fpga, None, &options.modes, stop)
        }
        Source::Ethernet(address) => {
            let taken = take_from(address, &options.modes, stop);
            taken.map_err(|error| format!("{address}: {error}").into())
        }
    }
}

fn take_from(address: SocketAddrV4, modes: &Modes, stop: &Stop) -> Result<Report, Box<dyn Error>> {
    let config = UdpConfig::default();
    let tries = config.setup_tries;
    let mut bus = UdpBus::connect(address, config).map_err(|error| match error.kind() {
        _ if matches!(error, UdpError::Foreign { .. }) => {
            format!("asked {tries} times, and no board answers, but somebody: {error}")
        }
        BusErrorKind::Lost => format!("no board answers, asked {tries} times: {error}"),
        _ => error.to_string(),
    })?;
    let identity = EthernetBoard::new(&mut bus).identity()?;
    report::take(&mut bus, Some(identity), modes, stop)
}

struct Options {
    board: Source,
    modes: Modes,
    json: bool,
}

enum Source {
    Simulated,
    Ethernet(SocketAddrV4),
}

impl Options {
    /// `None` if help is wanted.
    fn parse(mut arguments: lexopt::Parser) -> Result<Option<Self>, lexopt::Error> {
        use lexopt::prelude::*;
        let mut boards = Vec::new();
        let mut modes = Modes::new();
        let mut json = false;
        while let Some(argument) = arguments.next()? {
            match argument {
                Long("addr") => {
                    let address = arguments.value()?.parse_with(parse_address)?;
                    boards.push(Source::Ethernet(address));
                }
                Long("sim") => boards.push(Source::Simulated),
                Long("mode") => modes.push(arguments.value()?.parse_with(parse_mode)?),
                Long("json") => json = true,
                Long("help") | Short('h') => return Ok(None),
                _ => return Err(argument.unexpected()),
            }
        }
        let board = boards.pop().ok_or("say which board: --addr IP or --sim")?;
        if !boards.is_empty() {
            return Err("say one board only: --addr IP or --sim".into());
        }
        Ok(Some(Self { board, modes, json }))
    }
}

fn parse_address(text: &str) -> Result<SocketAddrV4, String> {
    let with_port = || text.parse().ok();
    let without = || {
        Some(SocketAddrV4::new(
            text.parse::<Ipv4Addr>().ok()?,
            lbp16::PORT,
        ))
    };
    without().or_else(with_port).ok_or_else(|| {
        format!("'{text}' is no IPv4 address; give it as 10.10.10.10 or 10.10.10.10:27181")
    })
}

fn parse_mode(text: &str) -> Result<(u8, u8, u8), String> {
    let parse = || {
        let (place, mode) = text.split_once('=')?;
        let (port, channel) = place.split_once('.')?;
        Some((
            port.parse().ok()?,
            channel.parse().ok()?,
            mode.parse().ok()?,
        ))
    };
    parse().ok_or_else(|| format!("'{text}' is no PORT.CHANNEL=MODE, for example 0.1=2"))
}
