//! The serial Little Binary Protocol as bytes: commands, CRC-8, RPCs, framing. Pure, no I/O.

mod crc;

pub use crc::crc8;
