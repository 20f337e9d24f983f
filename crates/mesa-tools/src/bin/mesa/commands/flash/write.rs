//! `mesa flash write`: a configuration, and the boot block where it is not valid.

use std::path::PathBuf;

use clap::Args;
use mesa_hal::ethernet::{Area, EthernetError, Flash as Chip};

use super::access::{Change, LONGEST, area, is_alone, parse, risk, written};
use super::chip::BoardChip;
use super::progress::Progress;
use super::report::{About, FlashReport, Name, Written};
use crate::board::consent::Plan;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;

/// Write a configuration and verify it
///
/// Refused before anything is erased: a file for another board or FPGA, as far as its header shows,
/// a damaged or a multiboot file, a memory whose boot block is not valid, the user area if there is
/// no fallback to start from, and the fallback if there is no user configuration. Ctrl-C does not
/// interrupt the write.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa flash write 7i97_7i77.bit --addr 10.10.10.10 --dry-run")]
pub struct Write {
    #[command(flatten)]
    change: Change,
    /// Bitfile (.bit) of the board's firmware
    file: PathBuf,
    /// Write the fallback, which the FPGA loads if the user configuration is damaged, instead of
    /// the user configuration
    #[arg(long)]
    fallback: bool,
    /// Write the boot block first if it is erased or not the one that mesaflash writes. If that is
    /// cut off, only a JTAG programmer helps
    #[arg(long)]
    fix_boot_block: bool,
}

impl Write {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let bytes = files::read(&self.file, LONGEST)?;
        let found = self.change.target.find(context)?;
        let mut bus = found.open()?;
        let mut flash = self.change.open(&mut bus, &found)?;
        // After the board: a .bin file is right for a T board, and no file of it is written yet.
        let bitfile = parse(&self.file, &bytes)?;
        let layout = *flash.layout();
        let dry_run = self.change.target.dry_run;
        let area = area(self.fallback);
        if self.fix_boot_block {
            flash.check_configuration(&bitfile, area)?;
        } else {
            flash.check_program(&bitfile, area)?;
        }
        let boot_block = self.boot_block(&mut flash)?;
        let written = written(&layout, area, &bitfile);
        let report = FlashReport {
            bitfile: Some(About::of(&bitfile)),
            areas: boot_block.into_iter().chain([written]).collect(),
            dry_run,
            ..FlashReport::new("write", &layout, &self.file)
        };
        if !dry_run {
            let is_alone = is_alone(&mut flash, &report.areas)?;
            let first = boot_block.map_or_else(String::new, |boot_block| {
                format!(
                    "{boot_block} first (if that is cut off, only a JTAG programmer helps), then "
                )
            });
            let (about, risk) = (About::of(&bitfile), risk(is_alone));
            let plan = Plan::at(
                found.address,
                format_args!("erase and write {first}{written} of the flash memory: {about}{risk}"),
            );
            let asks = &self.change.target.asks;
            asks.consent_to_change(context, &plan, Some(&found))?;
            if let Some(boot_block) = boot_block {
                let mut progress = Progress::of_write(context, boot_block, is_alone);
                let done = flash.write_boot_block(|step, bytes| progress.step(step, bytes));
                progress.ended(done)?;
            }
            let mut progress = Progress::of_write(context, written, is_alone);
            let done = flash.program(&bitfile, area, |step, bytes| progress.step(step, bytes));
            progress.ended(done)?;
        }
        context.print(&report)?;
        Ok(context.ending())
    }

    /// The boot block, if it is to be written. Fails if it is not valid and may not be written.
    fn boot_block(&self, flash: &mut Chip<BoardChip<'_>>) -> Result<Option<Written>, Failure> {
        match flash.check_boot_block() {
            Ok(()) => Ok(None),
            Err(EthernetError::NoBootBlock { .. } | EthernetError::OtherBootBlock { .. })
                if self.fix_boot_block =>
            {
                let addresses = flash.layout().addresses(Area::BootBlock);
                Ok(Some(Written {
                    area: Some(Name::BootBlock),
                    start: addresses.start,
                    end: addresses.end,
                }))
            }
            Err(error) => Err(error.into()),
        }
    }
}
