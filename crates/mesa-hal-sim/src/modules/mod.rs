//! The HostMot2 modules of the simulated FPGA, one file for each.
//!
//! Each implements [`SimModule`], and has a line in `built_in.rs`. Registers and bit fields are
//! those of FACTS 9.4, 13 and 14.

mod built_in;
mod dpll;
mod encoder;
mod inputs;
mod io_ports;
mod module;
mod outputs;
mod pwm;
mod smart_serial;
mod stepgen;
mod watchdog;

pub(crate) use built_in::{Unsimulated, built_in};
pub use dpll::SimDpll;
pub use encoder::EncoderBank;
pub use inputs::Inputs;
pub use io_ports::{SimIoPorts, Source};
pub use module::{Configuration, Effect, RegisterAddress, Settles, SimModule};
pub use outputs::{SimLeds, SimOutputs};
pub use pwm::SimPwm;
pub use smart_serial::SmartSerial;
pub use stepgen::SimStepgen;
pub(crate) use stepgen::{OutputChange, is_high};
pub use watchdog::SimWatchdog;
