//! LBP16 packets as bytes: command words, eight spaces, info areas. Pure, no I/O.
//!
//! A packet is a sequence of commands, executed in order; everything that it reads returns in one
//! reply, in the same order and without any framing. Both roles are here: a host builds requests
//! with a [`RequestBuilder`], which returns the place of each read in the reply; a board iterates
//! over a request with [`Operations`]; an observer of both sees each command [`Answered`].
//! Everything on the wire is little endian, and every address is a byte address.
//!
//! Source: manual 7I97, "LBP16" to "SPACE 7: LBP READ ONLY AREA", and FACTS 10.

// Runs in the cycle, where an overflow must not panic.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

pub mod advice;
mod answered;
mod builder;
mod command;
mod error;
mod error_register;
mod info;
mod parser;
pub mod registers;

pub use answered::Answered;
pub use builder::RequestBuilder;
pub use command::{Command, ElementSize, MAX_COUNT, Space};
pub use error::Lbp16Error;
pub use error_register::ErrorRegister;
pub use info::{InfoArea, MemoryRanges, MemorySizes, MemoryType, text};
pub use parser::{Operation, Operations, elements};

/// The UDP port of every board. Manual: 7I97, "UDP".
pub const PORT: u16 = 27181;

/// Maximum length of a request or a reply in bytes: an Ethernet frame of 1500 bytes without the IP
/// and UDP headers. Manual: 7I97, "HOST COMMUNICATION": no fragmentation.
pub const MAX_PACKET: usize = 1472;
