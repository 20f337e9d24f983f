//! Mesa Electronics' motion I/O from Rust: a HAL driver in the style of LinuxCNC, and a simulated
//! FPGA to develop against.
//!
//! A [`Driver`] is built on a bus, finds out what is there, and is then cycled:
//! `read`, the application's own work on [`Pins`], `write`. These types, and those an
//! application names beside them, are here; everything else is one module down.
//!
//! # The layers
//! Bottom to top; a layer knows only those above it in this list.
//!
//! | module | what it owns |
//! |---|---|
//! | [`bus`] | 32-bit registers at 16-bit byte addresses: one primitive, and the process image |
//! | [`lbp`] | the serial Little Binary Protocol as bytes |
//! | [`lbp16`] | LBP16 packets as bytes |
//! | [`hostmot2`] | cookie, IDROM, descriptors, and one file for each kind of module |
//! | [`sslbp`] | one smart serial port |
//! | [`discovery`] | what a remote tells about itself |
//! | [`process_data`] | descriptor to packing plan; register bits to engineering values |
//! | [`hal`] | typed pins and parameters, LinuxCNC names |
//! | [`boards`] | which remote or module is which pin, on which terminal |
//! | [`driver`] | the cycle, faults, recovery, statistics |
//! | [`ethernet`] | Ethernet boards beside their registers: identity, EEPROM, flash memory |
//! | [`transport`] | buses: LBP16 over UDP, and wrappers that record and that fail on purpose |
//! | [`sim`] | the simulated FPGA, its remotes and motors, and a simulated Ethernet board |
//!
//! The simulator shares wire formats and register addresses with the driver and nothing else, so
//! that the two can not agree on the same mistake.
//!
//! # The real-time contract
//! [`Driver::read`](driver::Driver::read) and [`Driver::write`](driver::Driver::write) do one
//! exchange each, which the bus bounds by a deadline. They do not allocate, log, panic, or wait
//! for hardware: a busy port is a state, not a loop. Only where the application asks for it does
//! `read` wait for the next period of the board's own clock ([`Pace::Board`](driver::Pace::Board)).
//! Everything else belongs to set-up or maintenance, is bounded as well, and may allocate. Each
//! item says so under "Real time".
//!
//! # What becomes of packets
//! Over Ethernet every reply tells which write was the last that the board executed, and how many
//! packets it has received. A packet that was lost, late, duplicate or reordered is noticed with the
//! next reply, and counted as what it was as far as the board can tell: see
//! [`BusStatistics`](bus::BusStatistics). The inputs that depend on it are not taken.
//!
//! # What a pin says
//! Reading an input gives its value, whether it is valid, and its age: the age of the data, from
//! the moment its transfer was started. An output that is not finite becomes its safe value, one
//! that is out of range its nearest limit; both are counted. After a failure, outputs are safe
//! until the application re-arms them.
//!
//! # What nothing can notice
//! - An encoder counts 16 bits: one that moves more than 32,767 counts between two good reads is
//!   miscounted. At 3 million counts a second that is 10 ms. That it may have happened is on its
//!   pin `count-unsure`; whether it did, nothing can tell, and the axis has to be homed again.
//! - Smart serial replies carry no number. One that comes a whole period late is told from the next
//!   by the rest a channel gets after a failure; two in a row that late are not.
//! - A program that drives the same board is noticed when the bus is opened, if it sends at least
//!   about 100 packets a second ([`UdpBus::new`]); one that begins later is not. Never let two
//!   programs drive one board.
//! - A write packet that the network delays is executed when it arrives: for a moment the outputs
//!   are older than the newest. The next reply says so, and the next write overrides it.
//!
//! # Features
//! - `std` (default): [`transport`] and [`sim`]. Without it the core needs `alloc`, at set-up only.
//! - `log` (default): messages at set-up, never in the cycle.
//!
//! # Safety
//! These boards move heavy machines. Never depend on software to disable a motor when somebody
//! would be exposed to a hazard should it start.
#![cfg_attr(not(feature = "std"), no_std)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

extern crate alloc;

pub mod boards;
pub mod bus;
pub mod discovery;
pub mod driver;
pub mod ethernet;
pub mod hal;
pub mod hostmot2;
pub mod lbp;
pub mod lbp16;
pub mod modules;
pub mod remote;
#[cfg(feature = "std")]
pub mod sim;
pub mod sslbp;
#[cfg(feature = "std")]
pub mod transport;

pub use bus::{Clock, RegisterBus};
pub use driver::{Board, Driver, Settings};
pub use hal::{InOut, Input, Output, Param, Pins, Reading};
#[cfg(feature = "std")]
pub use sim::SimFpga;
#[cfg(feature = "std")]
pub use transport::udp::{UdpBus, UdpConfig};

#[doc = include_str!("../docs/gateware.md")]
pub mod gateware {}

/// The code in the README is compiled and run as a test.
#[cfg(all(doctest, feature = "std"))]
#[doc = include_str!("../README.md")]
struct Readme;
