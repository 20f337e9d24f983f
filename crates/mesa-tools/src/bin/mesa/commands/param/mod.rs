//! `mesa param`: parameters of remotes, read and written by name, and saved for a whole cabinet.

pub mod cabinet;
mod file;
mod list;
mod one;

use std::time::Duration;

use clap::{Args, Subcommand};
use mesa_hal::RemoteId;
use mesa_hal::discovery::DataRecord;
use mesa_hal::driver::RemoteWatchdog;
use mesa_hal::modules::serial::WATCHDOG_PARAMETER;
use mesa_tools::setup::{Cabinet, CabinetRemote, RemotePlace};

use crate::context::{Context, Ending, Failure};
use cabinet::{CabinetTarget, OpenCabinet};

const AFTER_HELP: &str = "\
A board stops its serial ports and turns all pins into inputs: do not use this on a running machine.
A board that another program drives is left alone. With --serial the remote is the one card on that
port, with its jumper in the setup position (7I77: W12 for field I/O, W4 for analog, to the right;
7I72: W6 down), at 115200 baud.

NAME is spelled as by the remote, or in lower case; with PORT.CHANNEL in front if several remotes
have a parameter of that name. Values are those of LinuxCNC: whole numbers without the scale of the
record.

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
    if name.eq_ignore_ascii_case("nvbaudrate") {
        ". At another baud rate an FPGA reaches it only in setup mode, or not at all".to_owned()
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

/// Fails if a signal came.
fn go_on(context: &Context) -> Result<(), Failure> {
    match context.stop.signal() {
        Some(signal) => Err(Failure::stopped(signal, format_args!("ended by {signal}"))),
        None => Ok(()),
    }
}

/// A parameter of a remote.
struct Named {
    remote: CabinetRemote,
    record: DataRecord,
}

/// Finds the only parameter that matches `[PORT.CHANNEL.]NAME`.
fn named(cabinet: &OpenCabinet, text: &str) -> Result<Named, Failure> {
    let (place, name) = split(text);
    let mut found = Vec::new();
    for remote in cabinet.remotes() {
        let record = remote.descriptor.parameter(name).cloned();
        let is_here = place.is_none_or(|place| place == remote.place);
        if let Some(record) = record.filter(|record| is_here && record.is_readable()) {
            found.push(Named { remote, record });
        }
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
        Failure::refused(format_args!(
            "{place} a parameter {name}; `mesa param list` shows those that there are"
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
