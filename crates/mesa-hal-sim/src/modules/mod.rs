//! The HostMot2 modules of the simulated FPGA, one file for each.
//!
//! Registers and bit fields are those of FACTS 9.4 and 13.

mod dpll;
mod encoder;
mod foreign;
mod inputs;
mod io_ports;
mod outputs;
mod pwm;
mod smart_serial;
mod watchdog;

pub use dpll::Dpll;
pub use encoder::EncoderBank;
pub(crate) use encoder::SelectLine;
pub use foreign::ForeignModule;
pub(crate) use foreign::ForeignModules;
pub use inputs::Inputs;
pub use io_ports::{IoPorts, Source};
pub use outputs::{Leds, Outputs};
pub use pwm::Pwm;
pub use smart_serial::SmartSerial;
pub(crate) use smart_serial::Watcher;
pub use watchdog::Watchdog;
