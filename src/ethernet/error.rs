//! Why something could not be asked of a board, or done with it.

use super::{Area, BitfileError, CardName};
use crate::lbp16::Lbp16Error;

/// What went wrong with a board, beside its registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EthernetError<E> {
    /// The board did not answer.
    #[error(transparent)]
    Bus(E),
    /// The commands do not fit into a packet.
    #[error(transparent)]
    Request(#[from] Lbp16Error),
    /// What answers is no LBP16 board, or not in the way it is known.
    #[error(
        "space {space}: cookie 0x{found:04X}, expected 0x{expected:04X}; is this a Mesa board?"
    )]
    Cookie {
        /// The space.
        space: u8,
        /// The cookie read.
        found: u16,
        /// What it should be.
        expected: u16,
    },
    /// The firmware can not do this.
    #[error("this needs firmware version {needed}, the board has {found}; update its firmware")]
    Firmware {
        /// The first version that can.
        needed: u16,
        /// The version on the board.
        found: u16,
    },
    /// What was written reads back differently.
    #[error(
        "EEPROM address 0x{address:02X} reads 0x{found:04X} after writing 0x{expected:04X}; try again"
    )]
    NotWritten {
        /// Address of the word.
        address: u16,
        /// What was written.
        expected: u16,
        /// What is there.
        found: u16,
    },
    /// A register of the board's network side does not keep what was written.
    #[error(
        "register 0x{address:02X} of space 6 reads 0x{found:04X} after writing 0x{expected:04X}; \
         this firmware may not have it: update it"
    )]
    NotTaken {
        /// Address of the register.
        address: u16,
        /// What was written.
        expected: u16,
        /// What is there.
        found: u16,
    },
    /// The file is not for this board.
    #[error(transparent)]
    Bitfile(#[from] BitfileError),
    /// Another board than the layout is for.
    #[error(
        "this is a {found}, and the layout is that of a {expected}; use that of the board that \
         answers (`FlashLayout::for_card`)"
    )]
    WrongBoard {
        /// The board that answers.
        found: CardName,
        /// The board of the layout.
        expected: &'static str,
    },
    /// Another chip than the layout is for.
    #[error(
        "flash id 0x{found:08X}, expected 0x{expected:08X}: this layout is not for this board; \
         use the one for the board that answers"
    )]
    WrongChip {
        /// The id read.
        found: u32,
        /// The id of the layout.
        expected: u32,
    },
    /// There is no boot block, so the FPGA would load the fallback whatever is written.
    #[error(
        "the boot block at 0x{address:06X} is erased: the FPGA would not load what is written; \
         write the boot block first"
    )]
    NoBootBlock {
        /// Where it should be.
        address: u32,
    },
    /// There is no user configuration, so that the fallback is all that the FPGA can load.
    #[error(
        "there is no user configuration at 0x{address:06X}: if writing the fallback fails now, only a \
         JTAG programmer helps; program User first, reload the FPGA from it, then the fallback"
    )]
    NoUserConfiguration {
        /// Where it should be.
        address: u32,
    },
    /// The area is not for configurations.
    #[error("{area:?} is no place for a configuration; program User, or Fallback")]
    NotForConfigurations {
        /// The area.
        area: Area,
    },
    /// The whole chip was named for a part of it.
    #[error(
        "{bytes} bytes at 0x{address:06X} are not the whole chip, which is {size} bytes at 0; \
         name the area that they are for"
    )]
    NotWhole {
        /// Where they should begin.
        address: u32,
        /// How many there are.
        bytes: usize,
        /// Size of the chip.
        size: u32,
    },
    /// The data do not begin where a sector does, and erasing it would take what is before them.
    #[error("0x{address:06X} is within a sector; begin at 0x{sector:06X}")]
    NotASector {
        /// Where the data should begin.
        address: u32,
        /// Where the sector does.
        sector: u32,
    },
    /// The data do not fit into their area.
    #[error(
        "{bytes} bytes at 0x{address:06X} do not fit into {area:?}, 0x{start:06X} to 0x{end:06X}; \
         check the address, and that they are for this board"
    )]
    OutsideArea {
        /// Where they should begin.
        address: u32,
        /// How many there are.
        bytes: usize,
        /// The area.
        area: Area,
        /// Where it begins.
        start: u32,
        /// Where it ends.
        end: u32,
    },
    /// A byte read back is not what it should be.
    #[error(
        "at 0x{address:06X} is 0x{found:02X}, expected 0x{expected:02X}; write again, and do not restart the board before it verifies"
    )]
    Differs {
        /// Where.
        address: u32,
        /// What should be there.
        expected: u8,
        /// What is there.
        found: u8,
    },
}
