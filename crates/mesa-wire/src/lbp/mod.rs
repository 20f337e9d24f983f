//! The serial Little Binary Protocol as bytes: accesses, requests, CRC-8, flag bytes. Pure, no I/O.
//!
//! The module contains the host's parts: a [`RemoteAccess`] goes through an FPGA (`sslbp::Port` of
//! `mesa-hal`), or as a [`Request`] over a serial port.

// An arithmetic overflow would send a wrong packet.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod access;
mod address;
pub mod advice;
mod crc;
mod link;
mod link_error;
mod request;
mod sequence;
mod status;

pub use access::{AccessSize, LocalLocation, NonvolatileMemory, RemoteAccess};
pub use address::MemoryAddress;
pub use crc::crc8;
pub use link::RemoteLink;
pub use link_error::{RemoteLinkError, RemoteLinkErrorKind};
pub use request::{DISCOVERY, DiscoveryReply, LbpError, PROCESS_DATA, Request, UNIT_NUMBER};
pub use sequence::{AccessRetry, ParameterSequence, SequenceOutcome, SequenceStep};
pub use status::{COOKIE, Capabilities, LbpStatus, RemoteFaults, flash, write_flags};
