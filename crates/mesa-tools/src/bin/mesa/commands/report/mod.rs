//! `mesa report`: a page about a machine, for its file.

mod attachment;
mod html;
mod page;
mod wiring;

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use mesa_hal::hal::PinInfo;
use mesa_hal::{Board, Settings};
use serde::Serialize;

use super::info;
use super::latency::{self, Picture};
use crate::board::consent::Asks;
use crate::board::modes::Modes;
use crate::board::target::{Found, Target};
use crate::machine::embedded::Passage;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::stamp;
use mesa_tools::Counted;
use page::Page;
use wiring::WiringReport;

const AFTER_HELP: &str = "\
The page has the date and the host, the board with its firmware and modules, the remotes with their
unit numbers and parameters, and all terminals with their signals and pins; with --wiring the report
of a check by `mesa wiring`, with --latency or --seconds how late cycles begin. It needs no other
file and runs no script: keep it with the machine, or print it to PDF from a browser; it fits A4.

Writes nothing to the board. Stops the serial ports and turns all pins into inputs: do not use this
on a running machine. A board that another program drives is left alone. With --seconds a cycle runs
at 1 kHz for that time, with all outputs off.

Examples:
  mesa report cabinet.html --sim 7i92-7i77
  mesa report cabinet.html --wiring cabinet.json --seconds 10 --addr 10.10.10.10";

/// Write a page about a machine for its file: inventory, terminals, parameters, checks
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Report {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// File for the page. An existing file is replaced after a question
    #[arg(value_name = "FILE.html")]
    file: PathBuf,
    /// Report of a wiring check to include: the file of `mesa wiring --report`, JSON or text
    #[arg(long, value_name = "FILE")]
    wiring: Option<PathBuf>,
    /// Picture to include: the file of `mesa latency --plot`
    #[arg(long, value_name = "FILE.svg", conflicts_with = "seconds")]
    latency: Option<PathBuf>,
    /// Measure how late cycles begin for this time, in seconds, 0.1 to 3600
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    #[command(flatten)]
    asks: Asks,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.1..=3600.0).contains(seconds));
    seconds.ok_or_else(|| format!("`{text}` is no number of seconds from 0.1 to 3600"))
}

/// Result of the command.
#[derive(Debug, Serialize)]
struct Written {
    file: PathBuf,
    board: String,
    remotes: usize,
    terminals: usize,
    findings: usize,
}

impl Report {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        self.asks.replaces(context, &self.file)?;
        // Before a board is asked.
        let wiring = self.wiring.as_deref().map(WiringReport::read).transpose()?;
        let given = self.latency.as_deref().map(read_picture).transpose()?;
        let found = self.target.find(context)?;
        let inventory = info::take(&found, &self.modes, context)?;
        let pins = self.pins(&found)?;
        let (address, found) = (found.address, found.pass_time(Passage::Host));
        let measured = self.seconds.map(|seconds| {
            let bus = found.open()?;
            latency::picture(&self.target, &self.modes, seconds, bus, context)
        });
        let latency = given.or(measured.transpose()?);
        if let Some(signal) = context.stop.signal() {
            let what = format_args!("ended by {signal}; no page was written");
            return Err(Failure::stopped(signal, what));
        }
        let page = Page {
            date: stamp::on_paper(SystemTime::now()),
            address: address.to_string(),
            host: &stamp::computer(),
            inventory: &inventory,
            terminals: page::terminals(&pins),
            wiring: wiring.as_ref(),
            latency: latency.as_ref(),
        };
        files::write(&self.file, page.html().as_bytes())?;
        context.print(&Written {
            file: self.file.clone(),
            board: page.board().to_owned(),
            remotes: inventory.remotes().count(),
            terminals: page.terminals.iter().map(|card| card.rows.len()).sum(),
            findings: inventory.findings.len(),
        })?;
        Ok(context.ending())
    }

    /// All pins of the board and its remotes, which are stopped again.
    fn pins(&self, found: &Found) -> Result<Vec<PinInfo>, Failure> {
        let mut settings = Settings::default();
        self.modes.put(&mut settings);
        let board = Board::identify(found.open()?, settings)?.discover()?;
        Ok(board.pins().infos().to_vec())
    }
}

/// Reads a picture that becomes a part of the page.
fn read_picture(path: &Path) -> Result<Picture, Failure> {
    let svg = attachment::read(path)?;
    let svg = svg.filter(|svg| svg.trim_start().starts_with("<svg"));
    let svg = svg.ok_or_else(|| {
        let advice = "give the file of `mesa latency --plot`";
        let what = format_args!("{}: no SVG picture; {advice}", path.display());
        Failure::usage(what).advising(advice)
    })?;
    Ok(Picture {
        svg,
        text: attachment::written_at(path),
    })
}

impl Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {} with {}, {}, {}",
            self.file.display(),
            self.board,
            Counted::of(self.remotes, "remote"),
            Counted::of(self.terminals, "terminal"),
            Counted::of(self.findings, "finding")
        )
    }
}
