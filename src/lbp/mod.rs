//! The serial Little Binary Protocol as bytes: commands, CRC-8, RPCs, framing. Pure, no I/O.
//!
//! Host side: a [`Request`] is a frame and the check of its answer. Remote side: a [`Parser`]
//! makes requests of the characters that come in, and an [`RpcTable`] holds and runs stored lists.

mod command;
mod crc;
mod error;
mod local;
mod parser;
mod request;
mod rpc;
mod status;

pub use command::{Access, Command, DataSize, RpcNumber};
pub use crc::crc8;
pub use error::LbpError;
pub use local::{LocalRead, LocalWrite};
pub use parser::{Parsed, Parser, ParserCounts, ReceivedRequest, RpcSizes};
pub(crate) use request::MAX_FRAME;
pub use request::{DiscoveryReply, Request};
pub use rpc::{RPC_PITCH, RPC_TABLE_SIZE, RpcMemory, RpcReply, RpcTable};
pub(crate) use status::write_flags;
pub use status::{COOKIE, Capabilities, LbpStatus, Nonvolatile, RemoteFaults, flash};
