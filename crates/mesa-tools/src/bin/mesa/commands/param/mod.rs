//! `mesa param`: parameters of remotes, read and written by name, and saved for a whole cabinet.

mod board;
pub mod cabinet;
mod file;
mod list;
mod one;

use std::time::Duration;

use clap::{Args, Subcommand};
use mesa_hal::RemoteId;
use mesa_hal::discovery::{DataRecord, RemoteDescriptor};
use mesa_hal::driver::RemoteWatchdog;
use mesa_hal::modules::serial::WATCHDOG_PARAMETER;
use mesa_hal::remote::{BAUD_RATE_PARAMETER, operate_baud_rate};
use mesa_hal::sslbp::DEFAULT_BAUD_RATE;
use mesa_tools::setup::{
    Cabinet, CabinetRemote, ManualWord, RemotePlace, SETUP_BAUD_RATE, parameter_named,
};

use crate::ui::context::{Context, Ending, Failure};
use cabinet::{CabinetTarget, OpenCabinet};

const AFTER_HELP: &str = "\
A board stops its serial ports and turns all pins into inputs: do not use this on a running machine.
A board that another program drives is left alone. With --serial the remote is the one card on that
port, with its jumper in the setup position (7I77: W12 for field I/O, W4 for analog, to the right;
7I72: W6 down), at 115200 baud. On a board such cards are found too, and with --baud one whose
NVBaudRate was changed.

NAME is spelled as by the remote, in any case, or as in the manuals for RPD and WPD: also FAULT,
STATUS and OUTPUT, and NVWATCHDOGTIME for NVWatchDogTimeout; with PORT.CHANNEL in front if several
remotes have a parameter of that name. Values are those of LinuxCNC: whole numbers without the scale
of the record.

Examples:
  mesa param list --sim 7i92-7i77
  mesa param get 0.0.NVWatchDogTimeout --addr 10.10.10.10
  mesa param set NVWatchDogTimeout 100 --serial /dev/ttyUSB0
  mesa param save cabinet.toml --addr 10.10.10.10
  mesa param restore cabinet.toml --dry-run --addr 10.10.10.10";

/// Read, write, save and restore the parameters of remotes
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Param {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    List(list::List),
    Get(one::Get),
    Set(one::Set),
    Save(file::Save),
    Restore(file::Restore),
}

impl Param {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        match &self.action {
            Action::List(list) => list.run(context),
            Action::Get(get) => get.run(context),
            Action::Set(set) => set.run(context),
            Action::Save(save) => save.run(context),
            Action::Restore(restore) => restore.run(context),
        }
    }
}

/// Warning about an unexpected effect of a parameter's value; empty if it has no such effect.
fn warning(name: &str, value: u64) -> String {
    if name.eq_ignore_ascii_case(BAUD_RATE_PARAMETER) {
        operate_baud_rate(value).map_or_else(String::new, baud_rate_warning)
    } else if name.eq_ignore_ascii_case("nvunitnumber") {
        ". The unit number identifies the remote: a backup with the old number does not match it any \
         more, and another first byte makes it another part of the card, without terminals and safe \
         values"
            .to_owned()
    } else if !name.eq_ignore_ascii_case(WATCHDOG_PARAMETER) {
        String::new()
    } else if value == 0 {
        ". 0 SWITCHES ITS WATCHDOG OFF: when its cable breaks, outputs that are on stay on"
            .to_owned()
    } else if RemoteWatchdog::Known(Duration::from_millis(value)).is_slow() {
        format!(". LONG: when its cable breaks, outputs that are on stay on for {value} ms")
    } else {
        String::new()
    }
}

/// Effect of a baud rate in operate mode.
fn baud_rate_warning(baud: u32) -> String {
    let operates = format!(". In operate mode it then has {baud} baud");
    if baud == DEFAULT_BAUD_RATE {
        return format!("{operates}, as FPGAs have");
    }
    format!(
        "{operates}: a board, whose serial ports start at {DEFAULT_BAUD_RATE}, does not find it any more. \
         With its jumper in the setup position it has {SETUP_BAUD_RATE} baud whatever this value is"
    )
}

/// Fails if a signal came.
fn go_on(context: &Context) -> Result<(), Failure> {
    match context.stop.signal() {
        Some(signal) => Err(Failure::stopped(signal, format_args!("ended by {signal}"))),
        None => Ok(()),
    }
}

/// A value of a remote.
struct Named {
    remote: CabinetRemote,
    value: NamedValue,
}

/// Where a value is.
enum NamedValue {
    /// A parameter with a record.
    Parameter(DataRecord),
    /// A value that only the manuals name.
    Word(ManualWord),
}

impl NamedValue {
    fn find(descriptor: &RemoteDescriptor, name: &str) -> Option<Self> {
        let record = parameter_named(descriptor, name).cloned();
        let record = record.filter(DataRecord::is_readable);
        let word = || ManualWord::find(descriptor, name).map(Self::Word);
        record.map(Self::Parameter).or_else(word)
    }

    fn name(&self) -> &str {
        match self {
            Self::Parameter(record) => &record.name,
            Self::Word(word) => word.name(),
        }
    }
}

impl Named {
    fn read(&self, cabinet: &mut OpenCabinet) -> Result<u64, Failure> {
        let place = self.remote.place;
        Ok(match &self.value {
            NamedValue::Parameter(record) => cabinet.read(place, &record.name)?,
            NamedValue::Word(word) => word.read(cabinet, place)?,
        })
    }
}

/// Finds the only value that matches `[PORT.CHANNEL.]NAME`.
fn named(cabinet: &OpenCabinet, text: &str) -> Result<Named, Failure> {
    let (place, name) = split(text);
    let mut found = Vec::new();
    for remote in cabinet.remotes() {
        let is_here = place.is_none_or(|place| place == remote.place);
        let value = NamedValue::find(&remote.descriptor, name).filter(|_| is_here);
        found.extend(value.map(|value| Named { remote, value }));
    }
    if found.len() > 1 {
        let places: Vec<_> = found
            .iter()
            .map(|one| one.remote.place.to_string())
            .collect();
        let (places, first) = (places.join(" and "), places.first().cloned());
        let first = first.unwrap_or_default();
        return Err(Failure::usage(format_args!(
            "{places} have a parameter {name}; say which, for example {first}.{name}"
        )));
    }
    found.pop().ok_or_else(|| {
        let place = place.map_or_else(
            || "no remote has".to_owned(),
            |place| format!("no remote on {place} has"),
        );
        let kept = if name.eq_ignore_ascii_case("watchdogtime") {
            ": the working copy of NVWatchDogTimeout is not in its tables"
        } else {
            ""
        };
        Failure::refused(format_args!(
            "{place} a parameter {name}{kept}; `mesa param list` shows those that there are"
        ))
    })
}

/// `PORT.CHANNEL.NAME` or `NAME`.
fn split(text: &str) -> (Option<RemotePlace>, &str) {
    let with_place = || {
        let mut parts = text.splitn(3, '.');
        let (port, channel) = (parts.next()?, parts.next()?);
        let place = RemotePlace::Channel(RemoteId::new(port.parse().ok()?, channel.parse().ok()?));
        Some((Some(place), parts.next()?))
    };
    with_place().unwrap_or((None, text))
}

/// Target of every action.
#[derive(Debug, Args)]
struct Where {
    #[command(flatten)]
    cabinet: CabinetTarget,
}
