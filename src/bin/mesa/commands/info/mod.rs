//! `mesa info`: identity, firmware, modules, pins, serial ports, and their remotes with modes,
//! process data and parameters.

mod json;
mod report;
mod terminals;
mod text;

use clap::Args;
use mesa_hal::ethernet::EthernetBoard;

use crate::context::{Context, Ending, Failure};
use crate::output::{complain, say};
use crate::target::Target;

const AFTER_HELP: &str = "\
It stops the serial ports and turns all pins into inputs: not for a machine that is running. A
board that another program drives is left alone. SIGINT (Ctrl-C) and SIGTERM end it between two
ports, and leave the ports stopped.

Example:
  mesa info --addr 10.10.10.10 --mode 0.0=2";

/// What a board is, and what is plugged into it
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Info {
    #[command(flatten)]
    target: Target,
    /// Start the remote on this serial port and channel in a software mode other than 0; repeat
    /// for more
    #[arg(long = "mode", value_name = "PORT.CHANNEL=MODE", value_parser = parse_mode)]
    modes: Vec<(u8, u8, u8)>,
}

impl Info {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find()?;
        let mut bus = found.open()?;
        let identity = EthernetBoard::new(&mut bus).identity()?;
        let report = report::take(&mut bus, Some(identity), &self.modes, &context.stop)
            .map_err(|error| Failure::refused(format_args!("{}: {error}", found.address)))?;
        say(if context.json {
            format!("{:#}\n", json::of(&report))
        } else {
            text::of(&report)?
        });
        if let Some(signal) = context.stop.signal() {
            complain(format_args!(
                "mesa: ended by {signal}; the inventory is not complete"
            ));
        } else {
            report.check_modes(&self.modes).map_err(Failure::refused)?;
        }
        Ok(context.ending())
    }
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
    parse().ok_or_else(|| format!("`{text}` is no PORT.CHANNEL=MODE, for example 0.1=2"))
}
