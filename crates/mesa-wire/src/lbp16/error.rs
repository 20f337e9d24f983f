//! Errors of building and decoding LBP16 bytes.

use super::Space;

/// An invalid command, packet, or description of a space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Lbp16Error {
    /// A command for no element, or for more than its count field holds.
    #[error("a command for {count} elements; 1 to 127 are possible, use several commands")]
    Count {
        /// Number requested.
        count: u8,
    },
    /// The data does not have the length that the command announces.
    #[error(
        "{found} bytes of data for a command that writes {expected}; give its count times the \
         size of its elements"
    )]
    DataLength {
        /// Bytes that the command announces.
        expected: usize,
        /// Bytes given.
        found: usize,
    },
    /// The request ends within a command.
    #[error(
        "byte {offset}: {found} byte{} left of the {expected} of {what}; was the packet cut off, or \
         is the count of this command too large, or that of the one before too small?",
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
    #[error(
        "byte {offset}: command 0x{word:04X} is for 0 elements; ask for 1 to 127, or leave it out"
    )]
    BadCommand {
        /// Offset of the command in the request.
        offset: usize,
        /// The command word.
        word: u16,
    },
    /// The space has no info area.
    #[error(
        "info area of space {space} with cookie 0x{found:04X}, expected 0x{expected:04X}; \
         this firmware does not have the space, or this is no Mesa board"
    )]
    Cookie {
        /// The space.
        space: Space,
        /// The expected cookie.
        expected: u16,
        /// The cookie found.
        found: u16,
    },
}

impl crate::MesaError for Lbp16Error {}
