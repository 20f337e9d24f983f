//! `mesa param save` and `mesa param restore`.

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use mesa_hal::ethernet::Identity;
use mesa_hal::hal::AnyValue;
use mesa_tools::Counted;
use mesa_tools::setup::{
    CabinetDifference, Comparison, RemoteMatch, RemotePlace, SavedCabinet, SavedOrigin,
};
use serde::Serialize;

use super::cabinet::OpenCabinet;
use super::{Where, warning};
use crate::board::consent::{Asks, Plan};
use crate::board::target::Found;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use crate::ui::stamp;
use mesa_tools::advice::told;

/// Limit for the size of a file: more than any cabinet needs.
const MAX_BYTES: u64 = 4 << 20;

/// Save the non-volatile parameters of all remotes to a file
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa param save cabinet.toml --addr 10.10.10.10")]
pub struct Save {
    /// File to write: TOML if its name ends in .toml, else JSON
    file: PathBuf,
    #[command(flatten)]
    asks: Asks,
    #[command(flatten)]
    at: Where,
}

/// Restore the parameters of a file that differ, and read them back
///
/// A file for other cards is refused.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa param restore cabinet.toml --dry-run --addr 10.10.10.10")]
pub struct Restore {
    /// File of `mesa param save`
    file: PathBuf,
    /// Print the differences, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Match the remotes of the file by name and place, not by unit number: for a card that was
    /// replaced by another of its kind
    #[arg(long)]
    by_place: bool,
    #[command(flatten)]
    asks: Asks,
    #[command(flatten)]
    at: Where,
}

#[derive(Debug, Serialize)]
struct Saved {
    file: PathBuf,
    remotes: usize,
    parameters: usize,
}

#[derive(Debug, Serialize)]
struct Restored {
    file: PathBuf,
    dry_run: bool,
    compared: usize,
    differences: Vec<CabinetDifference>,
    written: usize,
    not_in_file: Vec<RemotePlace>,
}

impl Save {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let path = &self.file;
        self.asks.replaces(context, path)?;
        let mut cabinet = self.at.cabinet.open(context)?;
        let mut saved = SavedCabinet::take(&mut cabinet)?;
        saved.origin = Some(self.origin(&cabinet, &saved));
        let text = if is_toml(path) {
            toml::to_string_pretty(&saved).map_err(Failure::refused)?
        } else {
            serde_json::to_string_pretty(&saved).map_err(Failure::refused)? + "\n"
        };
        files::write(path, text.as_bytes())?;
        let parameters = saved.remotes.iter().map(|remote| remote.parameters.len());
        context.print(&Saved {
            file: path.clone(),
            remotes: saved.remotes.len(),
            parameters: parameters.sum(),
        })?;
        Ok(context.ending())
    }
}

impl Save {
    /// Head of the file: date, board, firmware and unit numbers.
    fn origin(&self, cabinet: &OpenCabinet, saved: &SavedCabinet) -> SavedOrigin {
        let (board, firmware) = match cabinet {
            OpenCabinet::Board(board) => of_board(&board.found, &board.firmware().idrom.board_name),
            OpenCabinet::Serial(_) => {
                let device = self.at.cabinet.line.serial.clone();
                (device.unwrap_or_default(), String::new())
            }
        };
        SavedOrigin {
            date: stamp::utc(SystemTime::now()),
            board,
            firmware,
            unit_numbers: saved.unit_numbers(),
        }
    }
}

/// A board and its firmware in words; `name` is the board's name in the IDROM.
fn of_board(found: &Found, name: &str) -> (String, String) {
    let address = found.address;
    found.identity().map_or_else(
        || (address.to_string(), name.to_owned()),
        |identity| {
            let Identity {
                card,
                mac,
                firmware_version,
                ..
            } = identity;
            (
                format!("{card}, {mac}, at {address}"),
                format!("{name}, version {firmware_version}"),
            )
        },
    )
}

fn is_toml(path: &Path) -> bool {
    let extension = path.extension();
    extension.is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

impl Restore {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let path = self.file.display();
        let saved = self.read().map_err(|why| {
            let why = why.to_string();
            let why = why.trim_end();
            Failure::usage(format_args!(
                "{path}: {why}; give a file of `mesa param save`"
            ))
        })?;
        let mut cabinet = self.at.cabinet.open(context)?;
        let by = if self.by_place {
            RemoteMatch::Place
        } else {
            RemoteMatch::UnitNumber
        };
        let found = saved.compare(&mut cabinet, by);
        let found = found.map_err(|error| {
            let hint = if self.by_place { "" } else { " (--by-place)" };
            let error = told(&error);
            Failure::refused(format_args!("{path}: {error}{hint}"))
        })?;
        let is_written = !self.dry_run && !found.differences.is_empty();
        if is_written {
            self.consent(context, &cabinet, &found.differences)?;
        }
        let Comparison {
            differences,
            compared,
            not_in_file,
        } = found;
        let written = if is_written {
            write(context, &mut cabinet, &differences)?
        } else {
            0
        };
        context.print(&Restored {
            file: self.file.clone(),
            dry_run: self.dry_run,
            compared,
            differences,
            written,
            not_in_file,
        })?;
        Ok(context.ending())
    }

    /// Prints the differences, and asks whether the parameters may be written.
    fn consent(
        &self,
        context: &Context,
        cabinet: &OpenCabinet,
        differences: &[CabinetDifference],
    ) -> Result<(), Failure> {
        for difference in differences {
            complain(difference);
        }
        let warnings = differences.iter().map(|difference| {
            let value = AnyValue::from(difference.saved).bits;
            match warning(&difference.name, value) {
                text if text.is_empty() => text,
                text => format!(". {}.{}{text}", difference.place, difference.name),
            }
        });
        let warnings: String = warnings.collect();
        let count = Counted::of(differences.len(), "parameter");
        let plan = Plan::new(format_args!(
            "write {count} in the non-volatile memory of remotes, to be used from the next power-up \
             on{warnings}"
        ));
        self.asks.consent_to_change(context, &plan, cabinet.found())
    }

    fn read(&self) -> Result<SavedCabinet, Box<dyn std::error::Error>> {
        let path = &self.file;
        let bytes = files::bounded(path, MAX_BYTES)?;
        let text = str::from_utf8(&bytes)?;
        // Byte order mark, as some editors write it.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        Ok(if is_toml(path) {
            toml::from_str(text)?
        } else {
            serde_json::from_str(text)?
        })
    }
}

/// Writes the file's values until a signal comes; returns the number of written parameters.
fn write(
    context: &Context,
    cabinet: &mut OpenCabinet,
    differences: &[CabinetDifference],
) -> Result<usize, Failure> {
    let count = differences.len();
    let mut written = 0;
    for difference in differences {
        if context.stop.signal().is_some() {
            break;
        }
        difference.restore(cabinet).map_err(|error| {
            let error = told(&error);
            Failure::refused(format_args!("{error}; {written} of {count} were written"))
        })?;
        written += 1;
    }
    Ok(written)
}

impl Display for Saved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            file,
            remotes,
            parameters,
        } = self;
        let file = file.display();
        let parameters = Counted::of(*parameters, "parameter");
        let remotes = Counted::of(*remotes, "remote");
        writeln!(f, "{file}: {parameters} of {remotes}")
    }
}

impl Display for Restored {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for difference in &self.differences {
            writeln!(f, "{difference}")?;
        }
        for place in &self.not_in_file {
            writeln!(f, "{place}  is not in the file, and was left alone")?;
        }
        let (compared, differ) = (self.compared, self.differences.len());
        if self.dry_run {
            writeln!(
                f,
                "{compared} compared, {differ} differ, nothing was written"
            )
        } else {
            writeln!(
                f,
                "{compared} compared, {differ} differed, {} written and read back",
                self.written
            )
        }
    }
}
