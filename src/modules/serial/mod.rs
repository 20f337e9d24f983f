//! Smart-serial ports in the cycle: their registers, their pins, and the recovery of their remotes.
//!
//! [`PortMachine`](crate::sslbp::PortMachine) implements the commands of a port and their replies.
//! The layer above it is `recovery`, which decides which remotes take part, which are offline, and
//! when those are tried again. A [`SerialPort`] does one step of both for each read and each write.

mod cost;
mod health;
mod offline;
mod parameter_writer;
mod pins;
mod policy;
mod port;
mod recovery;
mod remote;
mod statistics;
mod status;
mod watchdog;

pub use crate::sslbp::{Failure, FailureCounts};
pub use health::RemoteState;
pub use offline::OfflineReason;
pub use policy::FaultPolicy;
pub use port::SerialPort;
pub(crate) use port::StartedPort;
pub use remote::{FoundRemote, WATCHDOG_PARAMETER};
pub use statistics::{PortStatistics, TimeHistogram};
pub use status::RemoteStatus;
pub use watchdog::RemoteWatchdog;
