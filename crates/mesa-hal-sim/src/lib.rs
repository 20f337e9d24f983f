//! A simulated FPGA with its remote bus, on a virtual clock.
//!
//! The simulator shares the pure wire formats ([`mesa_wire::lbp`], [`mesa_wire::lbp16`]) and
//! register addresses with the driver, and nothing else: its behaviour comes from the manuals, from
//! observations of the gateware and from its recorded transcripts.
//!
//! From the host to the machine: [`SimFpga`] is the register file of a HostMot2 [`SimFirmware`] and
//! implements [`RegisterBus`](mesa_wire::bus::RegisterBus); its smart serial ports ([`sslbp`])
//! communicate over serial lines ([`wire`]) with the remotes plugged in; drives and [`Motor`]s
//! follow the analog outputs and turn the encoders. [`machines`] has complete assemblies. Time
//! advances only with register accesses and explicit calls; nothing sleeps.
//!
//! ```
//! use mesa_wire::bus::RegisterBus;
//! use mesa_hal_sim::machines;
//!
//! let mut fpga = machines::i7i92_7i77();
//! assert_eq!(fpga.read(0x0100)?, 0x55AA_CAFE);
//! fpga.advance_to(1_000_000);
//! # Ok::<(), mesa_wire::bus::BusError>(())
//! ```
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::indexing_slicing
    )
)]

mod board;
pub mod devices;
mod faults;
mod fpga;
pub mod machines;
mod modules;
pub mod remote;
mod serial_face;
pub mod sslbp;
pub mod wire;
mod world;

pub use board::{
    AddressJumpers, BoardConfig, Endpoint, Gateware, Mishaps, PcapWriter, SimBoard, SimPciBus,
    StateError, Tap, UdpClient, UdpCounters, UdpFace,
};
pub use faults::{FaultKind, FaultPlace};
pub use fpga::{
    AccessCounters, AxisWiring, ChangeCause, DEFAULT_ACCESS_COST, Director, DriveSignal,
    DriveSource, Fabric, FirmwareImage, FirmwareImageError, OUTPUT_PIN, Readout, SimFirmware,
    SimFpga, SimModuleDescriptor, SimPinDescriptor, StepperWiring, UNDRIVEN, gtag,
};
pub use modules::{
    Configuration, Effect, EncoderBank, Inputs, RegisterAddress, Settles, SimDpll, SimIoPorts,
    SimLeds, SimModule, SimOutputs, SimPwm, SimStepgen, SimWatchdog, SmartSerial,
    Source as PinSource,
};
pub use serial_face::SerialFace;
pub use world::{
    EstopConfig, Motor, MotorConfig, MotorError, Segment, SimTerminal, Stepper, StepperConfig,
    Switch, SwitchConfig, Wheel, WheelConfig,
};
