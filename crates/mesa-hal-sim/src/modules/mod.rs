//! The HostMot2 modules of the simulated FPGA, one file for each.
//!
//! Registers and bit fields are those of FACTS 9.4, 13 and 14.

mod dpll;
mod encoder;
mod foreign;
mod inputs;
mod io_ports;
mod outputs;
mod pwm;
mod smart_serial;
mod stepgen;
mod watchdog;

pub use dpll::SimDpll;
pub use encoder::EncoderBank;
pub(crate) use encoder::SelectLine;
pub use foreign::ForeignModule;
pub(crate) use foreign::ForeignModules;
pub use inputs::Inputs;
pub use io_ports::{SimIoPorts, Source};
pub use outputs::{SimLeds, SimOutputs};
pub use pwm::SimPwm;
pub use smart_serial::SmartSerial;
pub(crate) use smart_serial::Watcher;
pub use stepgen::SimStepgen;
pub(crate) use stepgen::{OutputChange, is_high};
pub use watchdog::SimWatchdog;
