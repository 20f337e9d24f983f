//! Report of a flash command.

use std::fmt::{self, Display};
use std::path::Path;

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::{Area, Bitfile, FlashDifference};
use serde::Serialize;

/// Report of a flash command.
#[derive(Debug, Serialize)]
pub struct FlashReport {
    pub action: &'static str,
    pub board: &'static str,
    pub file: String,
    /// True if the whole memory was read or compared.
    pub whole: bool,
    pub bitfile: Option<About>,
    /// Sectors that were written or compared.
    pub areas: Vec<Written>,
    /// True if nothing was done.
    pub dry_run: bool,
    #[serde(skip)]
    pub size: u32,
}

/// Header of a bitfile.
#[derive(Debug, Serialize)]
pub struct About {
    design: String,
    part: String,
    date: String,
    time: String,
    bytes: usize,
}

/// A range of whole sectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Written {
    pub area: Option<Name>,
    pub start: u32,
    pub end: u32,
}

/// Name of an area.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Name {
    BootBlock,
    Fallback,
    User,
    Application,
    Whole,
}

impl FlashReport {
    pub fn new(action: &'static str, layout: &FlashLayout, file: &Path) -> Self {
        Self {
            action,
            board: layout.board,
            file: file.display().to_string(),
            whole: false,
            bitfile: None,
            areas: Vec::new(),
            dry_run: false,
            size: layout.size,
        }
    }
}

impl About {
    pub fn of(bitfile: &Bitfile<'_>) -> Self {
        Self {
            design: bitfile.design.to_owned(),
            part: bitfile.part.to_owned(),
            date: bitfile.date.to_owned(),
            time: bitfile.time.to_owned(),
            bytes: bitfile.configuration.len(),
        }
    }
}

impl Written {
    pub fn of(difference: &FlashDifference) -> Self {
        Self {
            area: difference.area.map(Name::from),
            start: difference.start,
            end: difference.end,
        }
    }

    pub fn len(&self) -> u64 {
        u64::from(self.end - self.start)
    }
}

impl From<Area> for Name {
    fn from(area: Area) -> Self {
        match area {
            Area::BootBlock => Self::BootBlock,
            Area::Fallback => Self::Fallback,
            Area::User => Self::User,
            Area::Application => Self::Application,
            Area::Whole => Self::Whole,
        }
    }
}

impl Display for FlashReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            board, file, size, ..
        } = self;
        if let Some(bitfile) = &self.bitfile {
            writeln!(f, "{file}: {bitfile}")?;
        }
        let areas: Vec<String> = self.areas.iter().map(Written::to_string).collect();
        let areas = areas.join(", ");
        match (self.action, self.dry_run) {
            ("backup", _) => writeln!(f, "{board}: {size} bytes of flash memory are in {file}"),
            ("verify", _) if self.whole => {
                writeln!(
                    f,
                    "{board}: all {size} bytes of the flash memory are those of {file}"
                )
            }
            ("verify", _) => writeln!(f, "{board}: {areas} holds this configuration"),
            (_, _) if areas.is_empty() => {
                writeln!(
                    f,
                    "{board}: the flash memory is as {file} already; nothing is written"
                )
            }
            (_, true) => writeln!(
                f,
                "{board}: would erase and write {areas}; nothing was done"
            ),
            (_, false) => {
                writeln!(f, "{board}: {areas} written and verified")?;
                writeln!(f, "`mesa reload` makes the FPGA load it")
            }
        }
    }
}

impl Display for About {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            design,
            part,
            date,
            time,
            bytes,
        } = self;
        write!(
            f,
            "{design} for a {part}, built {date} {time}, {bytes} bytes"
        )
    }
}

impl Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.area {
            Some(Name::BootBlock) => "the boot block",
            Some(Name::Fallback) => "the fallback area",
            Some(Name::User) => "the user area",
            Some(Name::Application) => "the application area",
            Some(Name::Whole) => "the whole memory",
            None => "what no area uses",
        };
        write!(f, "{name} (0x{:06X} to 0x{:06X})", self.start, self.end)
    }
}
