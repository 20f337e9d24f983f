//! The SSLBP gateware: an interface processor with its firmware, host registers and UARTs.

mod config;
mod lines;
mod port;
mod registers;

pub use config::{InterfaceRegisters, MAX_CHANNELS, MAX_INTERFACE_REGISTERS, PortConfig};
pub use lines::{Lines, NoLines};
pub use port::SslbpPort;
pub use registers::Register;
