//! `mesa flash`: flash memory with the FPGA's configurations.

mod progress;
mod report;
mod restore;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::{Area, Bitfile, EthernetBoard, Flash as Chip};
use mesa_hal::lbp16::registers::flash::SECTOR;

use crate::consent::Plan;
use crate::context::{Context, Ending, Failure, told};
use crate::files;
use crate::link::Bus;
use crate::output::complain;
use crate::target::{ChangedTarget, Found, Target};
use progress::{Bar, Progress};
use report::{About, Name, Report, Written};
use restore::Restore;

const AFTER_HELP: &str = "\
The FPGA keeps running the configuration that it has loaded; `mesa reload` makes it load the one in
the flash memory, and so does switching the board on. If the user configuration is damaged or
missing, the fallback is loaded. File formats and memory layout are those of mesaflash.

Example:
  mesa flash backup before.bin --addr 10.10.10.10
  mesa flash write 7i97_7i77.bit --addr 10.10.10.10";

/// Limit for the size of a file: more than any bitfile or backup has.
const LONGEST: u64 = 32 << 20;

/// Back up, write, verify and restore the FPGA's configurations in flash memory
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Flash {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Backup(Backup),
    Write(Write),
    Verify(Verify),
    Restore(Restore),
}

/// Target board of a command that writes to its flash memory.
#[derive(Debug, Args)]
struct Change {
    #[command(flatten)]
    target: ChangedTarget,
    /// Allow the user area to be written without a fallback. If that is cut off, only a JTAG
    /// programmer helps
    #[arg(long)]
    without_fallback: bool,
}

/// Read the whole memory into a file
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa flash backup before.bin --addr 10.10.10.10")]
struct Backup {
    #[command(flatten)]
    target: Target,
    /// File for the backup: as many bytes as the memory has
    file: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    overwrite: bool,
}

/// Write a configuration and verify it
///
/// Refused before anything is erased: a file for another board or FPGA, as far as its header shows,
/// a damaged file, a memory without a boot block, the user area if there is no fallback to start
/// from, and the fallback if there is no user configuration. Ctrl-C does not interrupt the write.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa flash write 7i97_7i77.bit --addr 10.10.10.10 --dry-run")]
struct Write {
    #[command(flatten)]
    change: Change,
    /// Bitfile (.bit) of the board's firmware
    file: PathBuf,
    /// Write the fallback, which the FPGA loads if the user configuration is damaged, instead of
    /// the user configuration
    #[arg(long)]
    fallback: bool,
}

/// Compare the memory with a bitfile, or with a backup of the whole
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa flash verify 7i97_7i77.bit --addr 10.10.10.10")]
struct Verify {
    #[command(flatten)]
    target: Target,
    /// Bitfile or backup
    file: PathBuf,
    /// Compare the bitfile with the fallback instead of the user configuration
    #[arg(long)]
    fallback: bool,
}

impl Flash {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        match &self.command {
            Command::Backup(backup) => backup.run(context),
            Command::Write(write) => write.run(context),
            Command::Verify(verify) => verify.run(context),
            Command::Restore(restore) => restore.run(context),
        }
    }
}

impl Backup {
    fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let path = &self.file;
        if path.exists() && !self.overwrite {
            return Err(Failure::usage(format_args!(
                "{} already exists; --overwrite replaces it",
                path.display()
            )));
        }
        files::check(path)?;
        let found = self.target.find()?;
        let mut bus = found.open()?;
        let mut flash = open(&mut bus, &found)?;
        let layout = *flash.layout();
        let progress = Bar::new("read", u64::from(layout.size));
        let bytes = flash.backup(|done| {
            progress.at(done as u64);
            context.stop.signal().is_none()
        })?;
        progress.end();
        let Some(bytes) = bytes else {
            complain("mesa: ended by a signal; no file was written, and the board is as it was");
            return Ok(context.ending());
        };
        files::write(path, &bytes)?;
        context.print(&Report {
            whole: true,
            ..Report::new("backup", &layout, path)
        })?;
        Ok(context.ending())
    }
}

impl Write {
    fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let bytes = files::read(&self.file, LONGEST)?;
        let bitfile = parse(&self.file, &bytes)?;
        let found = self.change.target.find()?;
        let mut bus = found.open()?;
        let mut flash = self.change.open(&mut bus, &found)?;
        let layout = *flash.layout();
        let dry_run = self.change.target.dry_run;
        let area = area(self.fallback);
        flash.check_program(&bitfile, area)?;
        let written = written(&layout, area, &bitfile);
        let report = Report {
            bitfile: Some(About::of(&bitfile)),
            areas: vec![written],
            dry_run,
            ..Report::new("write", &layout, &self.file)
        };
        if !dry_run {
            let is_alone = is_alone(&mut flash, &report.areas)?;
            let (about, risk) = (About::of(&bitfile), risk(is_alone));
            let plan = Plan::at(
                found.address,
                format_args!("erase and write {written} of the flash memory: {about}{risk}"),
            );
            self.change
                .target
                .asks
                .consent(context, &plan, Some(&found))?;
            let mut progress = Progress::of_write(context, written, is_alone);
            let done = flash.program(&bitfile, area, |step, bytes| progress.step(step, bytes));
            progress.ended(done)?;
        }
        context.print(&report)?;
        Ok(context.ending())
    }
}

impl Verify {
    fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let bytes = files::read(&self.file, LONGEST)?;
        let found = self.target.find()?;
        let mut bus = found.open()?;
        let mut flash = open(&mut bus, &found)?;
        let layout = *flash.layout();
        let report = if bytes.len() == layout.size as usize && !self.fallback {
            let progress = Bar::new("verify", u64::from(layout.size));
            let differences = flash.differences(&bytes, |done| {
                progress.at(done as u64);
                context.stop.signal().is_none()
            })?;
            progress.end();
            let Some(differences) = differences else {
                complain("mesa: ended by a signal, before all was compared");
                return Ok(context.ending());
            };
            if !differences.is_empty() {
                let places: Vec<String> = differences
                    .iter()
                    .map(|one| Written::of(one).to_string())
                    .collect();
                return Err(Failure::refused(format_args!(
                    "the memory differs from {}: {}; `mesa flash restore` writes it back",
                    self.file.display(),
                    places.join(", ")
                )));
            }
            Report {
                whole: true,
                ..Report::new("verify", &layout, &self.file)
            }
        } else {
            let bitfile = parse(&self.file, &bytes)?;
            let area = area(self.fallback);
            let progress = Bar::new("verify", bitfile.configuration.len() as u64);
            flash.verify(&bitfile, area, |_, done| progress.at(done as u64))?;
            progress.end();
            Report {
                bitfile: Some(About::of(&bitfile)),
                areas: vec![written(&layout, area, &bitfile)],
                ..Report::new("verify", &layout, &self.file)
            }
        };
        context.print(&report)?;
        Ok(context.ending())
    }
}

impl Change {
    fn open<'a>(&self, bus: &'a mut Bus, found: &Found) -> Result<Chip<'a, Bus>, Failure> {
        let mut flash = open(bus, found)?;
        if self.without_fallback {
            flash.without_fallback();
        }
        Ok(flash)
    }
}

/// True if the user area is to be erased, and there is nothing else to start from.
fn is_alone(flash: &mut Chip<'_, Bus>, areas: &[Written]) -> Result<bool, Failure> {
    let is_user = areas.iter().any(|part| part.area == Some(Name::User));
    Ok(is_user && !flash.begins(Area::Fallback)?)
}

/// Warning if there is nothing else to start from.
fn risk(is_alone: bool) -> &'static str {
    if is_alone {
        ". There is no fallback: if this is cut off, only a JTAG programmer helps"
    } else {
        ""
    }
}

/// Opens the flash memory of a board; fails if its layout is not known.
fn open<'a>(bus: &'a mut Bus, found: &Found) -> Result<Chip<'a, Bus>, Failure> {
    let mut board = EthernetBoard::new(bus);
    let card = board.identity()?.card;
    let layout = FlashLayout::for_card(&card).ok_or_else(|| {
        Failure::refused(format_args!(
            "{}: this is a {card}, whose flash memory has no known layout, so nothing is read or \
             written: use mesaflash",
            found.address
        ))
    })?;
    Ok(board.into_flash(*layout)?)
}

fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Result<Bitfile<'a>, Failure> {
    Bitfile::parse(bytes)
        .map_err(|error| Failure::refused(format_args!("{}: {}", path.display(), told(&error))))
}

fn area(fallback: bool) -> Area {
    if fallback { Area::Fallback } else { Area::User }
}

/// Part of an area that a bitfile takes, in whole sectors.
fn written(layout: &FlashLayout, area: Area, bitfile: &Bitfile<'_>) -> Written {
    let start = layout.addresses(area).start;
    let sectors = bitfile.configuration.len().div_ceil(SECTOR) * SECTOR;
    Written {
        area: Some(area.into()),
        start,
        end: start + sectors as u32,
    }
}
