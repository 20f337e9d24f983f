//! Access to the flash memory of a board, and the files that are for it.

use std::path::Path;

use clap::Args;
use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::{Area, Bitfile, BitfileError, Flash as Chip};
use mesa_hal::lbp16::registers::flash::SECTOR;
use mesa_tools::advice::told;

use super::chip::BoardChip;
use super::layout;
use super::report::{Name, Written};
use crate::board::bus::Bus;
use crate::board::changed::ChangedTarget;
use crate::board::target::Found;
use crate::ui::context::Failure;

/// Limit for the size of a file: more than any bitfile or backup has.
pub const LONGEST: u64 = 32 << 20;

/// Target board of a command that writes to its flash memory.
#[derive(Debug, Args)]
pub struct Change {
    #[command(flatten)]
    pub target: ChangedTarget,
    /// Allow the user area to be written without a fallback. If that is cut off, only a JTAG
    /// programmer helps
    #[arg(long)]
    without_fallback: bool,
}

impl Change {
    pub fn open<'a>(
        &self,
        bus: &'a mut Bus,
        found: &Found,
    ) -> Result<Chip<BoardChip<'a>>, Failure> {
        let mut flash = open(bus, found)?;
        if self.without_fallback {
            flash.without_fallback();
        }
        Ok(flash)
    }
}

/// True if the user area is to be erased, and there is nothing else to start from.
pub fn is_alone(flash: &mut Chip<BoardChip<'_>>, areas: &[Written]) -> Result<bool, Failure> {
    let is_user = areas.iter().any(|part| part.area == Some(Name::User));
    Ok(is_user && !flash.begins(Area::Fallback)?)
}

/// Warning if there is nothing else to start from.
pub fn risk(is_alone: bool) -> &'static str {
    if is_alone {
        ". There is no fallback: if this is cut off, only a JTAG programmer helps"
    } else {
        ""
    }
}

/// Opens the flash memory of a board; fails if its layout is not known.
pub fn open<'a>(bus: &'a mut Bus, found: &Found) -> Result<Chip<BoardChip<'a>>, Failure> {
    let layout = layout::of_board(bus).map_err(|why| {
        Failure::refused(format_args!(
            "{}: {why}; nothing is read or written",
            found.address
        ))
    })?;
    Ok(Chip::open(BoardChip::of(bus), *layout)?)
}

/// Parses a bitfile. A backup of a whole memory is named as such.
pub fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Result<Bitfile<'a>, Failure> {
    Bitfile::parse(bytes).map_err(|error| {
        let (path, len) = (path.display(), bytes.len());
        let is_image = matches!(
            error,
            BitfileError::NoMark | BitfileError::Multiboot { .. }
        );
        if is_image && layout::is_whole(len) {
            return Failure::refused(format_args!(
                "{path}: not a bitfile: its {len} bytes are a backup of a whole memory; `mesa flash \
                 restore` writes it back, `mesa flash verify` without --fallback compares it"
            ));
        }
        Failure::refused(format_args!("{path}: {}", told(&error)))
    })
}

pub fn area(fallback: bool) -> Area {
    if fallback { Area::Fallback } else { Area::User }
}

/// Part of an area that a bitfile takes, in whole sectors.
pub fn written(layout: &FlashLayout, area: Area, bitfile: &Bitfile<'_>) -> Written {
    let start = layout.addresses(area).start;
    let sectors = bitfile.configuration.len().div_ceil(SECTOR) * SECTOR;
    Written {
        area: Some(area.into()),
        start,
        end: start + sectors as u32,
    }
}
