//! `mesa flash restore`: a backup of the whole memory, written back where it differs.

use std::path::PathBuf;

use clap::Args;

use super::access::{Change, LONGEST, is_alone, risk};
use super::progress::{Bar, Progress};
use super::report::{FlashReport, Name, Written};
use crate::board::consent::Plan;
use crate::board::target::Found;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Write a backup of the whole memory back, where it differs
///
/// The user area is written first, the boot block last. Ctrl-C ends the command between two areas.
/// A backup has no header, so that its kind of board cannot be checked.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa flash restore before.bin --addr 10.10.10.10 --dry-run")]
pub struct Restore {
    #[command(flatten)]
    change: Change,
    /// Backup: as many bytes as the memory has
    file: PathBuf,
    /// Write the fallback too, where it differs
    #[arg(long)]
    fallback: bool,
    /// Write the boot block too, where it differs. If that is cut off, only a JTAG programmer helps
    #[arg(long)]
    boot_block: bool,
}

impl Restore {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let backup = files::read(&self.file, LONGEST)?;
        let found = self.change.target.find(context)?;
        let mut bus = found.open()?;
        let mut flash = self.change.open(&mut bus, &found)?;
        let layout = *flash.layout();
        flash.check_backup(&backup).map_err(|error| {
            let error = told(&error);
            Failure::refused(format_args!(
                "{}: not a backup that a board can start from: {error}",
                self.file.display()
            ))
        })?;
        let progress = Bar::new("compare", u64::from(layout.size));
        let differences = flash.differences(&backup, |done| {
            progress.at(done as u64);
            context.stop.signal().is_none()
        })?;
        progress.end();
        let Some(differences) = differences else {
            complain("mesa: ended by a signal; nothing was written");
            return Ok(context.ending());
        };
        let areas: Vec<Written> = differences.iter().map(Written::of).collect();
        self.check_flags(&areas)?;
        if areas
            .iter()
            .any(|written| written.area == Some(Name::BootBlock))
        {
            flash.check_backup_boot_block(&backup)?;
        }
        if let Some(first) = differences.first() {
            flash.check_restore(&backup, first)?;
        }
        let dry_run = self.change.target.dry_run;
        let mut report = FlashReport {
            areas,
            dry_run,
            ..FlashReport::new("restore", &layout, &self.file)
        };
        if !dry_run && !differences.is_empty() {
            let is_alone = is_alone(&mut flash, &report.areas)?;
            self.consent(context, &found, &report.areas, is_alone)?;
            let mut done = 0;
            for (difference, &written) in differences.iter().zip(&report.areas) {
                if is_ended(context, &report.areas[done..]) {
                    break;
                }
                let mut progress = Progress::of_write(context, written, is_alone);
                let restored = flash.restore(&backup, difference, |step, bytes| {
                    progress.step(step, bytes);
                });
                progress.ended(restored)?;
                done += 1;
            }
            report.areas.truncate(done);
        }
        context.print(&report)?;
        Ok(context.ending())
    }

    fn consent(
        &self,
        context: &Context,
        found: &Found,
        areas: &[Written],
        is_alone: bool,
    ) -> Result<(), Failure> {
        let (places, risk) = (places(areas), risk(is_alone));
        let plan = Plan::at(
            found.address,
            format_args!("erase and write {places} of the flash memory{risk}"),
        );
        let asks = &self.change.target.asks;
        asks.consent_to_change(context, &plan, Some(found))
    }

    /// Fails if an area that the board may need to start differs and its flag was not given.
    fn check_flags(&self, areas: &[Written]) -> Result<(), Failure> {
        let flags = [
            (Name::Fallback, self.fallback, "--fallback"),
            (Name::BootBlock, self.boot_block, "--boot-block"),
        ];
        for (name, is_given, flag) in flags {
            let differs = areas.iter().find(|written| written.area == Some(name));
            if let Some(written) = differs.filter(|_| !is_given) {
                return Err(Failure::refused(format_args!(
                    "{written} differs from {}; the board may need it to start: give {flag} to \
                     write it too; nothing was written",
                    self.file.display()
                )));
            }
        }
        Ok(())
    }
}

/// True after a signal, which is reported with the areas that are left.
fn is_ended(context: &Context, left: &[Written]) -> bool {
    let Some(signal) = context.stop.signal() else {
        return false;
    };
    complain(format_args!(
        "mesa: {signal}: ended; still as before: {}. Run it again for the rest",
        places(left)
    ));
    true
}

/// Areas as text.
fn places(areas: &[Written]) -> String {
    let places: Vec<String> = areas.iter().map(Written::to_string).collect();
    places.join(", ")
}
