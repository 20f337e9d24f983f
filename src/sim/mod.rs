//! A simulated FPGA with its remote bus, on a virtual clock.
//!
//! The simulator shares the pure wire formats ([`crate::lbp`], [`crate::lbp16`]) and register
//! addresses with the driver, and nothing else: its behaviour comes from the manuals, from what
//! the gateware was seen to do and from its recorded transcripts.

mod board;
pub mod devices;
mod fpga;
pub mod machines;
mod modules;
pub mod remote;
pub mod sslbp;
pub mod wire;
mod world;

pub use board::{
    AddressJumpers, BoardConfig, Gateware, Mishaps, SimBoard, StateError, UdpCounters, UdpFace,
};
pub use fpga::{
    AccessCounters, AxisWiring, DEFAULT_ACCESS_COST, DriveSignal, DriveSource, Firmware,
    ModuleDescriptor, OUTPUT_PIN, PinDescriptor, Readout, SimError, SimFpga, gtag,
};
pub use modules::{Dpll, EncoderBank, Inputs, IoPorts, Leds, Outputs, Pwm, SmartSerial, Watchdog};
pub use world::{Motor, MotorConfig, Segment};
