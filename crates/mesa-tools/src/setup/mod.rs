//! Remotes in setup mode, where their parameters and their firmware are: over a serial port of the
//! host, with the card's jumper in its setup position, or through the FPGA.
//!
//! A [`SerialHost`] is LBP as host on any serial port; a channel of the FPGA is a
//! [`PortLink`](mesa_hal::sslbp::PortLink). Both are a [`RemoteLink`], so that discovery, parameters
//! ([`DataRecord::read_parameter`](mesa_hal::discovery::DataRecord::read_parameter)) and a
//! [firmware update](update) are the same over either.
//!
//! # Real time
//! Nothing here is for the cycle. Everything is bounded.

mod cabinet;
mod firmware;
mod serial;
mod serial_cabinet;
mod serial_error;
pub mod update;

pub use cabinet::{
    Cabinet, Comparison, Difference, Match, RemotePlace, RestoreError, SavedCabinet, SavedRemote,
    SavedValue, parse_value,
};
pub use firmware::{Firmware, FirmwareError};
pub use mesa_hal::lbp::RemoteLink;
pub use serial::{SETUP_BAUD_RATE, SerialHost, SerialRemote};
pub use serial_cabinet::{SerialCabinet, SerialCabinetError};
pub use serial_error::{Asked, SerialError};
