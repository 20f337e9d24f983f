//! Errors of queries and changes of a board.

use alloc::string::String;
use core::time::Duration;

use super::{Area, BitfileError};
use crate::advice::{self, Advice, MesaError};
use crate::bus::BusError;
use crate::lbp16::{Lbp16Error, Space};

/// An error of a board, apart from its registers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EthernetError {
    /// The board did not answer.
    #[error(transparent)]
    Bus(BusError),
    /// The commands do not fit into a packet, or the answer is not that of a known board.
    #[error(transparent)]
    Lbp16(#[from] Lbp16Error),
    /// The firmware does not support the operation.
    #[error("this needs firmware version {needed}, the board has {found}")]
    Firmware {
        /// The first version that does.
        needed: u16,
        /// The version on the board.
        found: u16,
    },
    /// A written word reads back differently.
    #[error(
        "address 0x{address:02X} of space {space} reads 0x{found:04X} after writing \
         0x{expected:04X}"
    )]
    NotKept {
        /// The space.
        space: Space,
        /// Address of the word.
        address: u16,
        /// The word written.
        expected: u16,
        /// The word read back.
        found: u16,
    },
    /// The board has not restarted.
    #[error("the board has not restarted: it counted {before} packets before and {after} now")]
    NotRestarted {
        /// UDP packets before the command.
        before: u16,
        /// UDP packets now.
        after: u16,
    },
    /// The register does not exist, or cannot be written.
    #[error("0x{address:04X} of space {space}: {reason}")]
    NoRegister {
        /// The space.
        space: Space,
        /// Address of the first register.
        address: u16,
        /// The reason.
        reason: &'static str,
    },
    /// The file is not for this board.
    #[error(transparent)]
    Bitfile(#[from] BitfileError),
    /// The board or its flash chip is not the one that the layout is for.
    #[error("the board is {found}, the layout is that of {expected}")]
    WrongBoard {
        /// Name or flash id of the board that answers.
        found: String,
        /// Name or flash id of the layout.
        expected: String,
    },
    /// The boot block is erased, so the FPGA would load the fallback whatever is written.
    #[error(
        "the boot block at 0x{address:06X} is erased: the FPGA would not load the configuration"
    )]
    NoBootBlock {
        /// Expected address of the boot block.
        address: u32,
    },
    /// The boot block is not the one for this memory. mesaflash refuses to write or verify then.
    #[error(
        "the boot block is not the one for this memory: 0x{address:06X} reads 0x{found:02X}, expected \
         0x{expected:02X}; the FPGA may not load the configuration"
    )]
    OtherBootBlock {
        /// Address of the first byte that differs.
        address: u32,
        /// The expected byte.
        expected: u8,
        /// The byte in the memory.
        found: u8,
    },
    /// No fallback is present, so that the user configuration is all that the FPGA can load.
    #[error(
        "no fallback at 0x{address:06X}: if writing the user configuration fails now, only a \
         JTAG programmer helps"
    )]
    NoFallback {
        /// Expected address of the fallback.
        address: u32,
    },
    /// No user configuration is present, so that the fallback is all that the FPGA can load.
    #[error(
        "no user configuration at 0x{address:06X}: if writing the fallback fails now, only a \
         JTAG programmer helps"
    )]
    NoUserConfiguration {
        /// Expected address of the user configuration.
        address: u32,
    },
    /// The area is not for configurations.
    #[error("{area} is no place for a configuration")]
    NotForConfigurations {
        /// The area.
        area: Area,
    },
    /// The data do not fit into their area, or do not start at the beginning of a sector, so that
    /// erasing the sector would destroy the bytes before them.
    #[error("{bytes} bytes at 0x{address:06X} do not fit into {area}, which takes {expected}")]
    OutsideArea {
        /// Start address of the data.
        address: u32,
        /// Number of bytes.
        bytes: usize,
        /// The area.
        area: Area,
        /// Data that the area accepts.
        expected: String,
    },
    /// The registers of the flash memory do not complete a byte.
    #[error(
        "the flash memory does not answer: its control register reads {control:08X} all the time"
    )]
    ChipSilent {
        /// The last value of the control register.
        control: u32,
    },
    /// The chip has not finished a change.
    #[error("the flash memory is still busy after {waited:?}")]
    ChipBusy {
        /// Time waited.
        waited: Duration,
    },
    /// A byte read back is not as expected.
    #[error("0x{address:06X} reads 0x{found:02X}, expected 0x{expected:02X}")]
    Differs {
        /// Address of the byte.
        address: u32,
        /// The expected byte.
        expected: u8,
        /// The byte read back.
        found: u8,
    },
}

impl MesaError for EthernetError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::Bus(error) => return error.advice(),
            Self::Lbp16(error) => return error.advice(),
            Self::Firmware { .. } => advice::UPDATE_BOARD,
            Self::NotKept { .. } | Self::ChipSilent { .. } => advice::TRY_AGAIN_THEN_UPDATE,
            Self::NotRestarted { .. } | Self::ChipBusy { .. } => advice::TRY_AGAIN,
            Self::NoRegister { .. } => advice::SEE_BOARD_MANUAL,
            Self::Bitfile(error) => return error.advice(),
            Self::WrongBoard { .. } => advice::USE_LAYOUT_OF_BOARD,
            Self::NoBootBlock { .. } | Self::OtherBootBlock { .. } => advice::WRITE_BOOT_BLOCK,
            Self::NoFallback { .. } => advice::WRITE_FALLBACK,
            Self::NoUserConfiguration { .. } => advice::WRITE_USER_CONFIGURATION,
            Self::NotForConfigurations { .. } => advice::CHOOSE_CONFIGURATION_AREA,
            Self::OutsideArea { .. } => advice::CHECK_AREA,
            Self::Differs { .. } => advice::WRITE_AGAIN,
        })
    }
}
