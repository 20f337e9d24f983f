//! Why LBP16 bytes could not be built or taken apart.

use super::access::area;
use super::{ElementSize, Space};

/// What is wrong with a command, a packet, or what a board says of its spaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Lbp16Error {
    /// No element.
    #[error("a command for 0 elements; ask for 1 to 127, or leave it out")]
    CountZero,
    /// More elements than the count field holds.
    #[error("a command for {count} elements; 1 to 127 are possible, use several commands")]
    CountTooLarge {
        /// The number asked for.
        count: u8,
    },
    /// The buffer is full.
    #[error("the command needs {needed} bytes, the buffer has {free} left; send the request first")]
    NoRoom {
        /// Bytes of the command.
        needed: usize,
        /// Bytes left.
        free: usize,
    },
    /// The data is not what the command announces.
    #[error(
        "{actual} bytes of data for a command that writes {expected}; give its count times the \
         size of its elements"
    )]
    DataLength {
        /// Bytes that the command announces.
        expected: usize,
        /// Bytes given.
        actual: usize,
    },
    /// A single byte is left where a command should begin.
    #[error(
        "byte {offset}: {actual} byte left of a command word of 2; was the packet cut off, or is \
         the count of the command before too small?"
    )]
    ShortCommand {
        /// Where in the request the command begins.
        offset: usize,
        /// Bytes left.
        actual: usize,
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
    /// The address is not there.
    #[error(
        "byte {offset}: {actual} bytes left of the 2 of an address in space {space:?}; \
         was the packet cut off, or should the address bit be clear?"
    )]
    ShortAddress {
        /// Where in the request the command begins.
        offset: usize,
        /// The space.
        space: Space,
        /// Bytes left.
        actual: usize,
    },
    /// The data to be written is not all there.
    #[error(
        "byte {offset}: {actual} bytes left of the {expected} to be written to space {space:?}; \
         was the packet cut off, or is the count too large?"
    )]
    ShortData {
        /// Where in the request the command begins.
        offset: usize,
        /// The space.
        space: Space,
        /// Bytes that the command announces.
        expected: usize,
        /// Bytes left.
        actual: usize,
    },
    /// Another number of bytes than the request reads.
    #[error(
        "a reply of {actual} bytes to a request that reads {expected}; is it the reply to another one?"
    )]
    ReplyLength {
        /// Bytes that the request reads.
        expected: usize,
        /// Bytes of the reply.
        actual: usize,
    },
    /// A range that is not in the reply.
    #[error("bytes {start}..{end} of a reply of {len}; does the range belong to another request?")]
    Outside {
        /// First byte asked for.
        start: usize,
        /// One past the last byte asked for.
        end: usize,
        /// Bytes of the reply.
        len: usize,
    },
    /// The cookie is wrong.
    #[error(
        "info area with cookie 0x{actual:04X}, expected 0x{expected:04X}; \
         this firmware does not have the space, do without it"
    )]
    Cookie {
        /// What it should be.
        expected: u16,
        /// What it is.
        actual: u16,
    },
    /// The firmware does not have the space.
    #[error(
        "space {space:?} does not exist in this firmware; \
         the cookies of the info areas say which spaces it has"
    )]
    NoSpace {
        /// The space.
        space: Space,
    },
    /// Elements of this size are not allowed there.
    #[error(
        "space {space:?}{} does not take elements of {} bytes; {}",
        area(*info),
        size.bytes(),
        if *info { "use 2 bytes" } else { "use the size that its MEMSIZES word names" }
    )]
    Size {
        /// The space.
        space: Space,
        /// Its info area was meant.
        info: bool,
        /// The size.
        size: ElementSize,
    },
    /// It can not be written.
    #[error(
        "space {space:?}{} is read only; clear the write bit, or check the number of the space",
        area(*info)
    )]
    ReadOnly {
        /// The space.
        space: Space,
        /// Its info area was meant.
        info: bool,
    },
}
