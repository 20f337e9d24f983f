//! Why something could not be asked of a board, or done with it.

use alloc::string::String;

use super::{Area, BitfileError};
use crate::lbp16::{Lbp16Error, Space};

/// What went wrong with a board, beside its registers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EthernetError<E> {
    /// The board did not answer.
    #[error(transparent)]
    Bus(E),
    /// The commands do not fit into a packet, or what answers is no board as it is known.
    #[error(transparent)]
    Lbp16(#[from] Lbp16Error),
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
        "address 0x{address:02X} of space {space} reads 0x{found:04X} after writing \
         0x{expected:04X}; try again; if it stays so, update the board's firmware"
    )]
    NotKept {
        /// The space.
        space: Space,
        /// Address of the word.
        address: u16,
        /// What was written.
        expected: u16,
        /// What is there.
        found: u16,
    },
    /// It goes on as before.
    #[error(
        "the board has not restarted: it counted {before} packets before and {after} now; the command \
         was lost on its way: try again"
    )]
    NotRestarted {
        /// UDP packets before the command.
        before: u16,
        /// Now.
        after: u16,
    },
    /// There is no such register, or it can not be written.
    #[error(
        "0x{address:04X} of space {space}: {reason}; the manual of the board has the registers of \
         each space"
    )]
    NoRegister {
        /// The space.
        space: Space,
        /// Address of the first.
        address: u16,
        /// Why not.
        reason: &'static str,
    },
    /// The file is not for this board.
    #[error(transparent)]
    Bitfile(#[from] BitfileError),
    /// Another board, or another flash chip, than the layout is for.
    #[error(
        "this is {found}, and the layout is that of {expected}; use that of the board that answers \
         (`FlashLayout::for_card`)"
    )]
    WrongBoard {
        /// Name or flash id of what answers.
        found: String,
        /// That of the layout.
        expected: String,
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
    /// There is no fallback, so that the user configuration is all that the FPGA can load.
    #[error(
        "there is no fallback at 0x{address:06X}: if writing the user configuration fails now, only a \
         JTAG programmer helps; write the fallback first, or, if there is no user configuration \
         either, allow this (`--without-fallback`, `Flash::without_fallback`)"
    )]
    NoFallback {
        /// Where it should be.
        address: u32,
    },
    /// There is no user configuration, so that the fallback is all that the FPGA can load.
    #[error(
        "there is no user configuration at 0x{address:06X}: if writing the fallback fails now, only a \
         JTAG programmer helps; write the user configuration first, reload the FPGA from it, then the fallback"
    )]
    NoUserConfiguration {
        /// Where it should be.
        address: u32,
    },
    /// The area is not for configurations.
    #[error(
        "{area} is no place for a configuration; write the user configuration, or the fallback"
    )]
    NotForConfigurations {
        /// The area.
        area: Area,
    },
    /// The data do not fit into their area, or do not begin where a sector does, so that erasing it
    /// would take what is before them.
    #[error(
        "{bytes} bytes at 0x{address:06X} do not fit into {area}, which takes {expected}; check the \
         address and the area, and that they are for this board"
    )]
    OutsideArea {
        /// Where they should begin.
        address: u32,
        /// How many there are.
        bytes: usize,
        /// The area.
        area: Area,
        /// What it takes.
        expected: String,
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
