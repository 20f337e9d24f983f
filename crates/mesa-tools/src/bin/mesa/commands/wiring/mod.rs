//! `mesa wiring`: a guided check of the wires of a cabinet.

mod head;
mod machine;
mod report;
mod session;

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use mesa_hal::driver::{Remark, RemarkKind};
use mesa_hal::ethernet::EthernetBoard;
use mesa_hal::hal::{GroupId, PinInfo};
use mesa_hal::{Board, Configured, Driver, Rounded, Settings};
use mesa_tools::diagnosis::wiring::{self, WiringCheck};

use super::set;
use crate::board::bus::Bus;
use crate::board::consent::{Asks, Plan};
use crate::board::hazard::{Hazard, hazard};
use crate::board::modes::Modes;
use crate::board::pattern::Pattern;
use crate::board::place;
use crate::board::running;
use crate::board::slow_watchdog::SlowWatchdog;
use crate::board::target::{Found, Target};
use crate::machine::embedded::Passage;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output::complain;
use head::Head;
use machine::Machine;
use mesa_tools::Counted;
use mesa_tools::advice::told;
use report::{Input, Item, Missing, Outcome, What, WiringResult};
use session::{Dialog, Lines, Session, Terminals};

const AFTER_HELP: &str = "\
Names one terminal after the other, and waits until the input there has changed and returned; for
an encoder, until it has counted and stopped; for an index, until the encoder was turned past it and
the index was latched, as in homing. If another input changes instead, it is named, and the wait
continues. Inputs that change by themselves or are not valid do not count. Keys: Enter skips a
terminal, b and Enter goes back, q and Enter ends with the report; so does Ctrl-C.

PATTERN is a part of a pin's name, terminal or signal; with * or ?, a pattern of the whole.

Starts the machine with all outputs off and drives nothing. With --outputs the digital outputs
follow: each is on for a while, all others off, and the question is whether it came on. Drive
enables and analog outputs are never driven, nor are the board's own I/O pins. A board that another
program drives is left alone.

Exits with 1 if a terminal is not in order or was not checked.

Examples:
  mesa wiring TB8 --addr 10.10.10.10 --report cabinet.txt
  mesa wiring output --outputs --sim 7i92-7i77
  mesa wiring '*.input-0?' --sim 7i92-7i77 --timeout 2 --json < /dev/null";

/// Guide a check of the wiring, terminal by terminal
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Wiring {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Pattern that selects terminals; all unless given
    pattern: Option<Pattern>,
    /// File for the report, updated after each terminal: JSON if its name ends in .json, else text.
    /// An existing file is replaced after a question
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Time to wait at each terminal, in seconds, 0.5 to 3600. Default: no limit; required if
    /// standard input is not a terminal
    #[arg(long, value_name = "S", value_parser = seconds::<500, 3_600_000>)]
    timeout: Option<Duration>,
    /// Check the digital outputs as well, one at a time
    #[arg(long)]
    outputs: bool,
    /// Time for which an output is on, in seconds, 0.1 to 10
    #[arg(
        long = "for",
        value_name = "S",
        default_value = "2",
        requires = "outputs"
    )]
    #[arg(value_parser = seconds::<100, 10_000>)]
    time: Duration,
    #[command(flatten)]
    slow_watchdog: SlowWatchdog,
    #[command(flatten)]
    asks: Asks,
}

/// Parses a time in seconds, between limits in milliseconds.
fn seconds<const LEAST: u64, const MOST: u64>(text: &str) -> Result<Duration, String> {
    let (least, most) = (LEAST as f64 / 1e3, MOST as f64 / 1e3);
    let seconds = text.parse().ok();
    let seconds = seconds.filter(|seconds| (least..=most).contains(seconds));
    let seconds = seconds.map(Duration::from_secs_f64);
    seconds.ok_or_else(|| format!("`{text}` is no number of seconds from {least} to {most}"))
}

impl Wiring {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let is_terminal = io::stdin().is_terminal();
        if !is_terminal && self.timeout.is_none() {
            return Err(Failure::usage(
                "standard input is not a terminal: give --timeout S, the time to wait at each terminal",
            ));
        }
        if let Some(path) = &self.report {
            self.asks.replaces(context, path)?;
        }
        let found = self.target.find(context)?.pass_time(Passage::Paced);
        let mut bus = found.open_with(set::unhurried())?;
        let settings = found.with_patience(self.settings());
        let identity = bus
            .is_on_ethernet()
            .then(|| EthernetBoard::new(&mut bus).identity());
        let identity = identity.transpose()?;
        let board = Board::identify(bus, settings)?;
        // All outputs are off, and no remote runs before the consent.
        let board = board.discover()?;
        let terminals = self.terminals(&board)?;
        let driver = self.start(context, &found, board, &terminals.items)?;
        let name = driver.name().to_owned();
        let reporter = Reporter {
            head: Head::new(&found.address, identity.as_ref(), &driver),
            missing: self.missing(&driver),
            path: self.report.as_deref(),
        };
        let machine = Machine::start(driver, context, self.time);
        let dialog = Dialog {
            lines: Lines::of_standard_input(is_terminal),
            timeout: self.timeout,
            is_agreed: self.asks.yes,
        };
        let session = Session::new(context, &machine, terminals, dialog, name);
        let (report, kept) = reporter.run(session)?;
        let stopped = machine.end();
        if let (Ok(()), Some(signal)) = (&stopped, context.stop.signal()) {
            complain(format_args!("mesa: ended by {signal}"));
        }
        if stopped.is_ok() {
            complain(if self.outputs {
                "mesa: all outputs are off, and the ports are stopped"
            } else {
                "mesa: outputs were never on; the ports are stopped"
            });
        }
        context.print(&report)?;
        kept?;
        stopped?;
        Ok(match context.ending() {
            Ending::Done if !report.ok => Ending::Refused,
            ending => ending,
        })
    }

    /// Starts the machine after the consent and the proof of the watchdogs that its outputs need.
    fn start(
        &self,
        context: &Context,
        found: &Found,
        board: Configured<Bus>,
        items: &[Item],
    ) -> Result<Driver<Bus>, Failure> {
        let outputs = items.iter().filter(|item| item.is_output());
        let groups: Vec<GroupId> = outputs.map(|item| item.info.group).collect();
        let watchdogs = self.slow_watchdog.check(&board, &groups)?;
        self.consent(context, found, items, &watchdogs)?;
        let mut driver = running::go(board)?;
        self.slow_watchdog.prove(&mut driver, &groups)?;
        Ok(driver)
    }

    fn missing(&self, driver: &Driver<Bus>) -> Missing {
        // Nothing has to be on a channel.
        let missing = driver.missing().iter().filter(|one| !one.is_silent());
        Missing {
            remotes: missing.clone().map(|one| told(one)).collect(),
            is_incomplete: self.pattern.is_none() && missing.clone().any(is_there),
        }
    }

    fn settings(&self) -> Settings {
        let mut settings = set::settings();
        if !self.outputs {
            settings.watchdog = Some(running::WATCHDOG);
        }
        self.modes.put(&mut settings);
        settings
    }

    /// Terminals to check; fails if there are none.
    fn terminals(&self, board: &Configured<Bus>) -> Result<Terminals, Failure> {
        let all = Pattern::default();
        let pattern = self.pattern.as_ref().unwrap_or(&all);
        let fits = |info: &PinInfo| pattern.fits(info);
        let pins = board.pins();
        let remotes = board.remotes().map(|(_, remote)| remote.pins.group);
        let remotes: Vec<GroupId> = remotes.collect();
        let points = wiring::points(pins, &remotes, fits);
        let asked = points
            .iter()
            .enumerate()
            .filter(|(_, point)| point.is_asked);
        let mut items: Vec<Item> = asked
            .map(|(number, point)| {
                let input = Input {
                    point: number,
                    kind: point.kind,
                };
                Item::new(point.info.clone(), What::Input(input))
            })
            .collect();
        if self.outputs {
            let harmless = |info: &PinInfo| hazard(info) == Hazard::None && fits(info);
            let outputs = wiring::outputs(pins, &remotes, harmless).into_iter();
            items.extend(outputs.map(|(pin, info)| Item::new(info, What::Output(pin))));
        }
        if items.is_empty() {
            let missing = board.missing().iter().filter(|one| is_there(one));
            let missing: Vec<String> = missing
                .map(|one| format!("; missing: {}", told(one)))
                .collect();
            let why = if self.pattern.is_some() {
                "no terminal fits that could be checked; `mesa pins` lists all pins, and a pattern with * \
                 or ? has to match a whole name"
            } else {
                "no input of this board is at a terminal that is known; `mesa watch` shows all inputs by name"
            };
            return Err(Failure::refused(format_args!("{why}{}", missing.concat())));
        }
        Ok(Terminals {
            check: WiringCheck::new(points),
            items,
        })
    }

    /// Asks for consent to drive the outputs, if there are any.
    fn consent(
        &self,
        context: &Context,
        found: &Found,
        items: &[Item],
        watchdogs: &str,
    ) -> Result<(), Failure> {
        let outputs = items.iter().filter(|item| item.is_output());
        let count = outputs.clone().count();
        if count == 0 {
            return Ok(());
        }
        let plan = Plan::at(
            found.address,
            format_args!(
                "drive {}{} for {} with all others off, no drive enables and no analog outputs: \
                 {}{watchdogs}",
                Counted::of(count, "digital output"),
                if count == 1 {
                    ""
                } else {
                    " one after the other, each"
                },
                Rounded(&self.time),
                place::on_cards(outputs.map(|item| &item.info))
            ),
        );
        self.asks.consent(context, &plan, Some(found))
    }
}

/// Makes the report of a check, and keeps it in a file if there is one.
struct Reporter<'a> {
    head: Head,
    missing: Missing,
    path: Option<&'a Path>,
}

impl Reporter<'_> {
    /// Runs a check to its end. Returns its report, and the result of writing it to the file.
    fn run(
        &self,
        mut session: Session<'_>,
    ) -> Result<(WiringResult, Result<(), Failure>), Failure> {
        // Fails before the check begins if the file cannot be written.
        self.keep(&session, Outcome::Unfinished)?;
        let outcome = session.run(|session| {
            if let Err(failure) = self.keep(session, Outcome::Unfinished) {
                complain(format_args!("mesa: the report is not written: {failure}"));
            }
        });
        Ok((self.report(&session, outcome), self.keep(&session, outcome)))
    }

    fn report(&self, session: &Session<'_>, outcome: Outcome) -> WiringResult {
        let (head, names) = (self.head.clone(), session.names());
        WiringResult::new(head, &session.items, &names, outcome, &self.missing)
    }

    fn keep(&self, session: &Session<'_>, outcome: Outcome) -> Result<(), Failure> {
        match self.path {
            Some(path) => self.report(session, outcome).write(path),
            None => Ok(()),
        }
    }
}

/// True if a missing remote answers without taking part, for example because of its field power.
fn is_there(remark: &Remark) -> bool {
    match &remark.kind {
        RemarkKind::NoSuchChannel { .. } => false,
        RemarkKind::DidNotStart(failure) => !failure.cs.remote_faults().is_empty(),
        _ => true,
    }
}
