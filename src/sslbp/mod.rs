//! One SSLBP port: COMMAND, DATA, CS and interface registers.
//!
//! Source: manual 7I77, "SSLBP"; FACTS 2 to 6, which win over the manual.

mod channels;
mod command;
mod layout;
mod status;

pub use channels::{Channel, ChannelMask, MAX_CHANNELS};
pub use command::{Command, LocalAddress};
pub use layout::{ChannelRegisters, Layout, LayoutError, MAX_INTERFACE_REGISTERS, SslbpModule};
pub use status::{ComState, CsStatus, DataStatus, LinkStatus, LocalFaults, RemoteFaults};
