//! Simulated remotes: the LBP protocol of a device around its application.
//!
//! A [`SimRemote`] implements [`RemoteEnd`](super::wire::RemoteEnd); the part behind the protocol
//! is its [`Application`]. [`SimRemote::model`] is the remote of the gateware transcripts.

mod application;
mod buffers;
mod config;
mod device;
mod execute;
mod faults;
mod line;
mod memory;
mod model;
mod parser;
mod program;
mod rpc;

pub use application::{Application, FixedData};
pub use buffers::RemoteEvent;
pub use config::{MAX_MODES, ParameterPlace, ReplyFaults, SimRemoteConfig, WorkingCopy};
pub use device::SimRemote;
pub use faults::{Cable, CableCounts, Toward, WireFault};
pub use memory::{SimEeprom, SimFlash, SimMemory};
pub use model::ModelError;
pub use program::firmware_file;

pub(super) use line::receive as sample;
