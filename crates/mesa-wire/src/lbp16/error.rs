//! Errors of building and decoding LBP16 bytes.

use super::{Space, advice};
use crate::{Advice, MesaError};

/// An invalid command, packet, or description of a space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Lbp16Error {
    /// A command for no element, or for more than its count field holds.
    #[error("a command for {count} elements, expected 1 to 127")]
    Count {
        /// Number requested.
        count: u8,
    },
    /// The data does not have the length that the command announces.
    #[error("{found} bytes of data for a command that writes {expected}")]
    DataLength {
        /// Bytes that the command announces.
        expected: usize,
        /// Bytes given.
        found: usize,
    },
    /// The request ends within a command.
    #[error(
        "byte {offset}: {found} byte{} left of the {expected} of {what}",
        if *found == 1 { "" } else { "s" }
    )]
    CutOff {
        /// Offset of the command in the request.
        offset: usize,
        /// The missing part: a command word, an address, data.
        what: &'static str,
        /// Its length in bytes.
        expected: usize,
        /// Bytes left.
        found: usize,
    },
    /// The command word is invalid.
    #[error("byte {offset}: command 0x{word:04X} is for 0 elements, expected 1 to 127")]
    BadCommand {
        /// Offset of the command in the request.
        offset: usize,
        /// The command word.
        word: u16,
    },
    /// The space has no info area.
    #[error("info area of space {space} with cookie 0x{found:04X}, expected 0x{expected:04X}")]
    Cookie {
        /// The space.
        space: Space,
        /// The expected cookie.
        expected: u16,
        /// The cookie found.
        found: u16,
    },
}

impl MesaError for Lbp16Error {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::Count { .. } => advice::USE_SEVERAL_COMMANDS,
            Self::DataLength { .. } => advice::GIVE_MATCHING_DATA,
            Self::CutOff { .. } => advice::CHECK_COUNTS,
            Self::BadCommand { .. } => advice::LEAVE_COMMAND_OUT,
            Self::Cookie { .. } => advice::CHECK_SPACE,
        })
    }
}
