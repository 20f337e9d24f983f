//! Why LBP bytes could not be built, checked or executed.

use super::MAX_FRAME;

/// What is wrong with a request, a reply, or a list of the RPC table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LbpError {
    /// The data does not fit the command.
    #[error(
        "command {command:02X} takes {expected} data bytes, {actual} were given; pass exactly as many as its data size says"
    )]
    RequestLength {
        /// The command byte.
        command: u8,
        /// Bytes the command takes.
        expected: usize,
        /// Bytes given.
        actual: usize,
    },
    /// More data than a frame holds.
    #[error(
        "RPC {command:02X} with {actual} data bytes is longer than a frame of {MAX_FRAME}; split the process data"
    )]
    TooLong {
        /// The command byte.
        command: u8,
        /// Bytes given.
        actual: usize,
    },
    /// The access form has no address, or needs one.
    #[error(
        "command {command:02X} and its address do not go together; give an address exactly when its address-size bit is set"
    )]
    Address {
        /// The command byte.
        command: u8,
    },
    /// The reply is shorter or longer than the command's answer.
    #[error(
        "reply to command {command:02X} has {actual} bytes, expected {expected}; check wiring, and that the size in the discovery answer is that of the current mode"
    )]
    ReplyLength {
        /// The command byte.
        command: u8,
        /// Bytes expected, CRC included.
        expected: usize,
        /// Bytes received.
        actual: usize,
    },
    /// The reply's CRC is wrong.
    #[error(
        "reply to command {command:02X} has CRC {actual:02X}, its data gives {expected:02X}; check cable, termination and shield"
    )]
    ReplyCrc {
        /// The command byte.
        command: u8,
        /// CRC of the data received.
        expected: u8,
        /// CRC received.
        actual: u8,
    },
    /// A byte in the list is no read or write command.
    #[error(
        "{byte:02X} at {address:04X} of the RPC table is no read or write command; end the list with 00"
    )]
    NotAnAccess {
        /// Where in the table.
        address: u16,
        /// What stands there.
        byte: u8,
    },
    /// An entry runs over the end of the table.
    #[error("RPC list entry at {address:04X} runs over the end of the table; move the list down")]
    EndOfTable {
        /// Where the entry begins.
        address: u16,
    },
    /// The request carries fewer or more bytes than the list takes.
    #[error("RPC list takes {expected} bytes from the stream, {actual} came")]
    StreamLength {
        /// Bytes the list's writes take.
        expected: usize,
        /// Bytes that came with the request.
        actual: usize,
    },
    /// The list's reads give more than a frame holds.
    #[error("RPC list reads more than a frame of {MAX_FRAME} bytes holds; split it")]
    ReplyTooLong,
    /// A memory access was refused.
    #[error(
        "address {address:04X} is not there or is write-protected; check it against the device's map"
    )]
    Memory {
        /// The address.
        address: u16,
    },
}
