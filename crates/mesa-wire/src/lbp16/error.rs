//! Why LBP16 bytes could not be built or taken apart.

use super::Space;

/// What is wrong with a command, a packet, or what a board says of its spaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Lbp16Error {
    /// A command for no element, or for more than its count field holds.
    #[error("a command for {count} elements; 1 to 127 are possible, use several commands")]
    Count {
        /// The number asked for.
        count: u8,
    },
    /// The data is not what the command announces.
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
        "byte {offset}: {found} bytes left of the {expected} of {what}; was the packet cut off, or \
         is the count of this command too large, or that of the one before too small?"
    )]
    CutOff {
        /// Where in the request the command begins.
        offset: usize,
        /// What should follow: a command word, an address, data.
        what: &'static str,
        /// Bytes of it.
        expected: usize,
        /// Bytes left.
        found: usize,
    },
    /// The command word is none.
    #[error(
        "byte {offset}: command 0x{word:04X} is for 0 elements; ask for 1 to 127, or leave it out"
    )]
    BadCommand {
        /// Where in the request the command begins.
        offset: usize,
        /// The command word.
        word: u16,
    },
    /// The info area of a space is not there.
    #[error(
        "info area of space {space} with cookie 0x{found:04X}, expected 0x{expected:04X}; \
         this firmware does not have the space, or this is no Mesa board"
    )]
    Cookie {
        /// The space.
        space: Space,
        /// What its cookie should be.
        expected: u16,
        /// What it is.
        found: u16,
    },
}
