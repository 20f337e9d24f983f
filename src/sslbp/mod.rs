//! One SSLBP port: COMMAND, DATA, CS and interface registers.
//!
//! Source: manual 7I77, "SSLBP"; FACTS 2 to 6, which win over the manual.

mod access;
mod channels;
mod command;
mod doit_time;
mod error;
mod layout;
mod machine;
mod parameters;
mod port;
mod started;
mod status;

pub use crate::lbp::{AccessSize, LocalLocation, NonvolatileMemory, RemoteAccess, RemoteFaults};
pub use channels::{Channel, ChannelMask, MAX_CHANNELS};
pub use command::{Command, LocalAddress};
pub use doit_time::{DEFAULT_BAUD_RATE, DoitTime, Exchange, Processor, USUAL_REMOTE_LATENCY};
pub use error::{Needed, PortError, PortState, Registers, WaitError, WaitingFor};
pub use layout::{ChannelRegisters, Layout, LayoutError, MAX_INTERFACE_REGISTERS, SslbpModule};
pub use machine::{
    Complete, Event, Failure, FailureCounts, Link, Machine, Observed, Operation, StartMode, Times,
    Verdict, software_mode_word,
};
pub use parameters::{ChannelVariable, PortParameters};
pub use port::{ChannelStart, ChannelWords, Port, PortResult, PortWords, Transfer};
pub use started::{
    FailedRegisters, ProcessDataSizes, ReplyFormat, StartFailure, StartFailureReason, StartReport,
    StartedRemote,
};
pub use status::{ComState, CsStatus, DataStatus, LinkStatus, LocalFaults};
