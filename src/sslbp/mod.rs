//! An SSLBP port: COMMAND, DATA, CS and interface registers.
//!
//! Source: manual 7I77, "SSLBP"; FACTS 2 to 6, which take precedence over the manual.

mod channels;
mod doit_time;
mod error;
mod label;
mod layout;
mod line;
mod machine;
mod operation;
mod parameters;
mod port;
mod started;
mod status;

pub use crate::lbp::{AccessSize, LocalLocation, NonvolatileMemory, RemoteAccess, RemoteFaults};
pub use channels::{Channel, ChannelMask, MAX_CHANNELS, PerChannel};
pub use doit_time::{ChannelExchange, DoitTime};
pub use error::PortError;
pub use label::RemoteLabel;
pub use layout::{MAX_INTERFACE_REGISTERS, PortLayout, PortPlace};
pub use line::DEFAULT_BAUD_RATE;
pub use machine::{
    ChannelLink, CompletedOperation, Failure, FailureCounts, PortEvent, PortImage, PortMachine,
    PortState, TransferResult,
};
pub use operation::{COMMAND_IGNORED, PortAccess, PortOperation, StartMode, software_mode_word};
pub use parameters::{ChannelVariable, PortParameters};
pub use port::{Port, PortLink, SetupPort};
pub(crate) use started::StartProblem;
pub use started::{
    ProcessDataSizes, RemoteIdentity, RemoteName, StartFailure, StartFailureReason, StartedRemote,
};
pub use status::{ComState, CsStatus, LocalFaults};

pub(crate) use label::in_hal;
pub(crate) use layout::{ChannelRegisters, MAX_PORTS};
pub(crate) use port::PortResult;
