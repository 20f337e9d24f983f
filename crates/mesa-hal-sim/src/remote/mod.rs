//! Simulated remotes: the LBP protocol of a device around its application.
//!
//! A [`Remote`] implements [`RemoteEnd`](super::wire::RemoteEnd); the part behind the protocol is
//! its [`Application`]. [`Remote::model`] is the remote of the gateware transcripts.

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
pub use config::{MAX_MODES, ParameterPlace, RemoteConfig, ReplyFaults, WorkingCopy};
pub use device::Remote;
pub use faults::{Cable, CableCounts, Toward, WireFault};
pub use memory::{Eeprom, Flash, Memory};
pub use model::ModelError;
pub use program::firmware_file;

pub(super) use line::receive as sample;
