//! `mesa set`: jog of one output.

mod announcer;
pub mod jog;
pub mod plan;
mod report;

use std::fmt::Display;
use std::time::Duration;

use clap::Args;
use mesa_hal::hal::PinInfo;
use mesa_hal::transport::udp::UdpConfig;
use mesa_hal::{Board, Rounded, Settings};

use crate::board::consent::{Asks, Plan};
use crate::board::hazard::{Hazard, hazard};
use crate::board::modes::Modes;
use crate::board::named::{self, with_place};
use crate::board::running;
use crate::board::slow_watchdog::SlowWatchdog;
use crate::board::target::Target;
use crate::machine::embedded::Passage;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::number;
use crate::ui::output::complain;
use announcer::Announcer;
use jog::Jog;
use mesa_tools::advice::told;
use plan::{JogPlan, Step};

/// Long, because nothing here is fast and the thread has no priority. Short enough to feed remotes,
/// whose watchdogs have 50 ms.
const PERIOD: Duration = Duration::from_millis(8);
/// Timeout of a reply.
const DEADLINE: Duration = Duration::from_millis(20);
/// Time of the board's watchdog: a program that stalls for longer loses its outputs.
const WATCHDOG: Duration = Duration::from_millis(100);

const AFTER_HELP: &str = "\
PIN is a name, or its end if no other name has that end: 7i77.0.0.output-03; or the terminal or the
signal of an output: TB8-20, OUTPUT3, or 'TB8-20 of 7i77.0.0' if several cards have it. All other
outputs are off meanwhile. Standard error shows when the output is on, the seconds that are left,
and when it is off again. The output is made safe again after the time, after SIGINT (Ctrl-C) and
SIGTERM, and after any failure: then the exit code is 1, and the reason is printed. A board that
another program drives is left alone.

A drive moves with a voltage on its input and its enable: --analog allows an analog output to be
set, --drive-enable a drive enable. An analog output has 0 V unless it is enabled, so it needs both
flags and is enabled for the time. So is every drive with the same enable, at 0 V: the question
names them.

An I/O pin is made an output for the time; nothing else may drive it.

Before an output of a remote is driven, the remote gets no data until its own watchdog bites, with
everything off, because a remote uses a new NVWatchDogTimeout only after it was switched off and on.

The output is read back if possible: if it never had its value, this is reported, and the exit code
is 1. A remote that cannot be reached at the end is named: its own watchdog switches its outputs
off.

Examples:
  mesa set 7i77.0.0.output-03 on --for 2s --addr 10.10.10.10
  mesa set TB8-20 on --for 2s --addr 10.10.10.10
  mesa set 7i77.0.1.analogout0 0.5 --for 1s --analog --drive-enable --sim 7i92-7i77 --yes";

/// Set one output for a time, then make it safe again
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Set {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Output to set, by its name, terminal or signal; parameters and inversions are refused
    pin: String,
    /// Value to set: on or off, or a number within the range of the output
    #[arg(allow_negative_numbers = true)]
    value: String,
    /// Time for which the output is set: 0.1 s to 60 s, as 2s, 1.5s or 500ms
    #[arg(long = "for", value_name = "TIME", value_parser = parse_time)]
    time: Duration,
    /// Allow an analog output to be set
    #[arg(long)]
    analog: bool,
    /// Allow a drive to be enabled
    #[arg(long)]
    drive_enable: bool,
    #[command(flatten)]
    slow_watchdog: SlowWatchdog,
    #[command(flatten)]
    asks: Asks,
}

impl Set {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?.pass_time(Passage::Paced);
        let bus = found.open_with(unhurried())?;
        let mut settings = found.with_patience(settings());
        self.modes.put(&mut settings);
        let board = Board::identify(bus, settings)?;
        // All outputs are off, and no remote runs before the consent.
        let board = board.discover()?;
        let pins = board.pins();
        let pin = named::find_output(pins, board.missing(), &self.pin)?;
        let info = pins
            .info_of(pin)
            .ok_or_else(|| Failure::refused("the pin is gone"))?
            .clone();
        let value = named::value(&info, &self.value)?;
        info.check_settable(value)
            .map_err(|error| Failure::usage(told(&error)))?;
        let enables = pins.enables(pin).filter_map(|pin| pins.info_of(pin));
        let infos: Vec<_> = enables.collect();
        self.allow(&info, &infos)?;
        let group = [info.group];
        let watchdog = self.slow_watchdog.check(&board, &group)?;
        let output = Step {
            pin,
            value,
            safe: pins.read_any(pin).value,
        };
        let action = self.action(&info, output, &infos) + &watchdog;
        let plan = Plan::at(found.address, action);
        self.asks.consent(context, &plan, Some(&found))?;
        if let Some(signal) = context.stop.signal() {
            complain(format_args!("mesa: ended by {signal}; nothing was set"));
            return Ok(Ending::Stopped(signal));
        }
        let mut driver = running::go(board)?;
        named::present(driver.missing(), &info.name)?;
        named::running(driver.remarks(), &info.name)?;
        self.slow_watchdog.prove(&mut driver, &group)?;
        let plan = JogPlan {
            output,
            time: self.time,
            patience: jog::PATIENCE,
        };
        let announcer = Announcer::start(&info, &plan);
        let jog = Jog::new(&driver, plan);
        let report = jog.run(driver, context, &info, announcer)?;
        context.print(&report)?;
        match report.failure() {
            Some(reason) if context.stop.signal().is_none() || !report.not_reached.is_empty() => {
                Err(Failure::refused(reason))
            }
            _ => Ok(context.ending()),
        }
    }

    /// Checks that an output that may move a machine was allowed by its flag, and reaches its
    /// terminal.
    fn allow(&self, info: &PinInfo, enables: &[&PinInfo]) -> Result<(), Failure> {
        check_kind(info, enables)?;
        let flag = |hazard| match hazard {
            Hazard::Analog if !self.analog => Some("--analog"),
            Hazard::DriveEnable if !self.drive_enable => Some("--drive-enable"),
            _ => None,
        };
        let what = match hazard(info) {
            Hazard::DriveEnable => "can enable a drive",
            Hazard::Analog => "is an analog output",
            _ => "",
        };
        let own = flag(hazard(info));
        let drive = enables.iter().find(|by| hazard(by) == Hazard::DriveEnable);
        let other = drive.and_then(|by| flag(hazard(by)));
        match (own, other) {
            (None, None) => Ok(()),
            (Some(own), None) => Err(refused(
                info,
                format_args!("{what}: a machine may move. Give {own} to allow it"),
            )),
            (own, Some(other)) => {
                let flags: Vec<_> = own.into_iter().chain([other]).collect();
                let by: Vec<_> = enables.iter().map(|by| with_place(by)).collect();
                Err(refused(
                    info,
                    format_args!(
                        "{what}, with 0 V at its terminal while it is not enabled by {}: a machine \
                         may move. Give {} to allow it",
                        by.join(" and "),
                        flags.join(" ")
                    ),
                ))
            }
        }
    }

    /// Planned action as text.
    fn action(&self, info: &PinInfo, output: Step, enables: &[&PinInfo]) -> String {
        let with = enables.iter().filter_map(|by| match hazard(by) {
            // An enable that is enabled by another pin has no terminal of its own.
            Hazard::DriveEnable if by.enabled_by.is_some() => None,
            Hazard::DriveEnable => Some(format!(", enable EVERY drive on {}", with_place(by))),
            _ => Some(format!(
                ", make it an output ({}): nothing else may drive it",
                by.name
            )),
        });
        let is_enable = hazard(info) == Hazard::DriveEnable && !info.role.is_param();
        let own = if is_enable {
            ", which enables EVERY drive there"
        } else {
            ""
        };
        format!(
            "set {} to {} for {}{own}{}, with all other outputs off, then back to {}",
            with_place(info),
            named::with_unit(info, output.value),
            Rounded(&self.time),
            with.collect::<String>(),
            named::with_unit(info, output.safe)
        )
    }
}

/// Fails for pins that are never set by hand.
fn check_kind(info: &PinInfo, enables: &[&PinInfo]) -> Result<(), Failure> {
    match (hazard(info), enables) {
        (Hazard::Watchdog, _) => Err(refused(
            info,
            "belongs to the watchdog that makes the board safe; it is not set by hand",
        )),
        (Hazard::Making, _) => Err(refused(
            info,
            "configures how the board makes its outputs, or counts, and drives none by itself: an \
             inversion or a limit would switch outputs that were not named. Set the output, or let a \
             program set this",
        )),
        (Hazard::DriveEnable, [.., by]) => Err(refused(
            info,
            format_args!(
                "reaches no terminal: its drive is switched by {}; set that",
                with_place(by)
            ),
        )),
        _ => Ok(()),
    }
}

fn refused(info: &PinInfo, what: impl Display) -> Failure {
    Failure::usage(format_args!("{} {what}", info.name))
}

/// Bus configuration for outputs that a person drives.
pub fn unhurried() -> UdpConfig {
    UdpConfig {
        cycle_deadline: DEADLINE,
        ..UdpConfig::default()
    }
}

/// Driver settings for outputs that a person drives.
pub fn settings() -> Settings {
    Settings {
        period: PERIOD,
        watchdog: Some(WATCHDOG),
        ..Settings::default()
    }
}

fn parse_time(text: &str) -> Result<Duration, String> {
    number::time(text, 0.1..=60.0)
}
