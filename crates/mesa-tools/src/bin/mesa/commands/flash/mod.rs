//! `mesa flash`: flash memory with the FPGA's configurations.

mod access;
mod chip;
mod layout;
mod progress;
mod report;
mod restore;
mod write;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use mesa_hal::ethernet::{Area, Bitfile, EthernetError, Flash as Chip};
use mesa_hal::lbp16::registers::flash::PAGE;

use crate::board::consent::Asks;
use crate::board::target::Target;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use access::{LONGEST, area, open, parse, written};
use chip::BoardChip;
use progress::Bar;
use report::{About, FlashReport, Written};
use restore::Restore;
use write::Write;

pub use layout::of_board as layout_of_board;

const AFTER_HELP: &str = "\
The FPGA keeps running the configuration that it has loaded; `mesa reload` makes it load the one in
the flash memory, and so does switching the board on. If the user configuration is damaged or
missing, the fallback is loaded. File formats and memory layout are those of mesaflash.

Example:
  mesa flash backup before.bin --addr 10.10.10.10
  mesa flash write 7i97_7i77.bit --addr 10.10.10.10";

/// A memory of which at least one page in this number differs holds another configuration; one with
/// fewer is damaged.
const DAMAGED: usize = 4;

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

/// Read the whole memory into a file
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa flash backup before.bin --addr 10.10.10.10")]
struct Backup {
    #[command(flatten)]
    target: Target,
    /// File for the backup: as many bytes as the memory has
    file: PathBuf,
    #[command(flatten)]
    asks: Asks,
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
        self.asks.replaces(context, path)?;
        let found = self.target.find(context)?;
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
        context.print(&FlashReport {
            whole: true,
            ..FlashReport::new("backup", &layout, path)
        })?;
        Ok(context.ending())
    }
}

impl Verify {
    fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let bytes = files::read(&self.file, LONGEST)?;
        let found = self.target.find(context)?;
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
            FlashReport {
                whole: true,
                ..FlashReport::new("verify", &layout, &self.file)
            }
        } else {
            let bitfile = parse(&self.file, &bytes)?;
            let area = area(self.fallback);
            // As by mesaflash: without a valid boot block the FPGA loads neither configuration.
            flash.check_boot_block()?;
            let progress = Bar::new("verify", bitfile.configuration.len() as u64);
            let compared = flash.verify(&bitfile, area, |_, done| progress.at(done as u64));
            progress.end();
            if let Err(error @ EthernetError::Differs { .. }) = compared {
                return Err(self.difference(&mut flash, (area, &bitfile), error));
            }
            compared?;
            FlashReport {
                bitfile: Some(About::of(&bitfile)),
                areas: vec![written(&layout, area, &bitfile)],
                ..FlashReport::new("verify", &layout, &self.file)
            }
        };
        context.print(&report)?;
        Ok(context.ending())
    }
}

impl Verify {
    /// The failure of a comparison, with what is in the area instead: another configuration,
    /// nothing, or this one with damage.
    fn difference(
        &self,
        flash: &mut Chip<BoardChip<'_>>,
        (area, bitfile): (Area, &Bitfile<'_>),
        error: EthernetError,
    ) -> Failure {
        let data = bitfile.configuration;
        let mut bytes = vec![0; data.len()];
        let start = flash.layout().addresses(area).start;
        if flash.read(start, &mut bytes).is_err() {
            return error.into();
        }
        let is_sound = flash.begins(area).unwrap_or_default();
        let file = self.file.display();
        let part = written(flash.layout(), area, bitfile);
        let pages = bytes.chunks(PAGE).zip(data.chunks(PAGE));
        let differing = pages.filter(|(found, expected)| found != expected).count();
        let what = if bytes.iter().all(|&byte| byte == 0xFF) {
            format!("{part} is erased; `mesa flash write {file}` writes this configuration")
        } else if differing * DAMAGED >= data.len().div_ceil(PAGE) && is_sound {
            format!(
                "{part} holds another configuration than {file}; `mesa flash write {file}` writes this one, \
                 and `mesa info` shows which one the FPGA runs"
            )
        } else {
            return error.into();
        };
        Failure::refused(what)
    }
}
