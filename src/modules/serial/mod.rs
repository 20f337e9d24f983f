//! Smart-serial ports in the cycle: their registers, their pins, and the recovery of their remotes.
//!
//! [`PortMachine`](crate::sslbp::PortMachine) implements the commands of a port and their replies.
//! The layers above it are the `life` of each remote (whether it runs, why not, and when it is
//! tried again), the `remotes` of a port, and its `schedule`, which decides on the next operation.
//! A [`SerialPort`] does one step of all of them for each read and each write.

mod cost;
mod failures;
mod fault_pins;
mod life;
mod outcome;
mod parameter_writer;
mod part;
mod pins;
mod port;
mod remote;
mod remotes;
mod schedule;
mod slot;
mod statistics;
mod status;
mod watchdog;

pub use crate::sslbp::{Failure, FailureCounts};
pub use life::RemoteState;
pub use part::RemotePart;
pub use port::SerialPort;
pub(crate) use port::StartedPort;
pub use statistics::{PortStatistics, TimeHistogram};
pub use status::RemoteStatus;
pub use watchdog::{RemoteWatchdog, WATCHDOG_PARAMETER};
