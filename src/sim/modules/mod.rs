//! The HostMot2 modules of the simulated FPGA, one file for each.
//!
//! Registers and bit fields are those of FACTS 9.4 and REGISTERS.

mod io_ports;
mod smart_serial;
mod watchdog;

pub use io_ports::IoPorts;
pub use smart_serial::SmartSerial;
pub(crate) use smart_serial::Watcher;
pub use watchdog::Watchdog;
