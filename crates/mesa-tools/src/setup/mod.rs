//! Access to remotes in setup mode, for their parameters and their firmware: over a serial port of
//! the host, with the card's jumper in its setup position, or through the FPGA.
//!
//! A [`SerialHost`] is an LBP host on any serial port; a channel of the FPGA is a
//! [`PortLink`](mesa_hal::sslbp::PortLink). Both implement [`RemoteLink`], so that discovery,
//! parameters ([`DataRecord::read_parameter`](mesa_hal::discovery::DataRecord::read_parameter)) and
//! a [firmware update](update) work alike over either.
//!
//! # Real time
//! Nothing here is for the cycle. All operations are bounded.

pub mod advice;
mod cabinet;
mod cabinet_error;
mod firmware;
mod serial;
mod serial_error;
pub mod update;
mod words;

pub use cabinet::{
    Cabinet, CabinetDifference, CabinetRemote, Comparison, RemoteMatch, RemotePlace, RestoreError,
    SavedCabinet, SavedOrigin, SavedRemote, SavedValue, SerialCabinet, parse_value,
};
pub use cabinet_error::CabinetError;
pub use firmware::{FirmwareError, FirmwareFile};
pub use mesa_hal::lbp::RemoteLink;
pub use serial::{SETUP_BAUD_RATE, SerialHost, SerialRemote};
pub use serial_error::{SerialError, SerialRequest};
pub use words::{ManualWord, parameter_named};
