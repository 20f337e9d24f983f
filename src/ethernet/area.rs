//! Areas of the flash memory of a board.

use core::fmt;
use core::ops::Range;

use crate::boards::FlashLayout;

/// Area to be written; every write names one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Area {
    /// The boot block: an error here can only be repaired with a JTAG programmer.
    BootBlock,
    /// The fallback configuration: loaded when the user configuration is damaged.
    Fallback,
    /// The user configuration: the place of new firmware.
    User,
    /// The last two sectors, which configurations never use.
    Application,
    /// The whole chip, to restore a backup.
    Whole,
}

impl fmt::Display for Area {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BootBlock => "the boot block",
            Self::Fallback => "the area of the fallback",
            Self::User => "the area of the user configuration",
            Self::Application => "the area of applications",
            Self::Whole => "the whole chip",
        })
    }
}

impl FlashLayout {
    /// The addresses of an area.
    pub fn addresses(&self, area: Area) -> Range<u32> {
        let (start, end) = match area {
            Area::BootBlock => self.boot_block,
            Area::Fallback => self.fallback,
            Area::User => self.user,
            Area::Application => self.application,
            Area::Whole => (0, self.size),
        };
        start..end
    }
}
