//! Mesa Electronics' motion I/O from Rust: a HAL driver in the style of LinuxCNC. The package
//! `mesa-hal-sim` contains a simulated FPGA for development without a board.
//!
//! A [`Board`] is identified and configured, started as a [`Driver`], and cycled: `read`, the
//! application's own work on [`Pins`], `write`. On Linux a [`runner`] does this once in each
//! period:
//!
//! ```
//! use std::ops::ControlFlow::{Break, Continue};
//! use mesa_hal::{Driver, I7i77Analog, I7i77Field, Settings, runner::Runner};
//! use mesa_hal_sim::machines;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let bus = machines::six_axes_7i92(Default::default()); // a board: UdpBus::connect(...)?
//! let driver = Driver::start(bus, Settings::default())?; // 1 ms
//! let field: I7i77Field = driver.attach((0, 0))?; // port 0, channel 0
//! let drive = driver.attach::<I7i77Analog>((0, 1))?.analog_out[0];
//! let ended = Runner::new(driver).run(|cycle| {
//!     // `cycle.read` contains failures of parts, or of the whole read
//!     let limit = field.inputs[2].read(cycle.pins()); // TB8 pin 3: value, valid, age
//!     let may_move = limit.valid && !limit.value;
//!     drive.enable(cycle.pins_mut(), may_move);
//!     drive.set(cycle.pins_mut(), if may_move { 1.5 } else { 0.0 }); // TB5 pin 4, volts
//!     if cycle.number < 100 { Continue(()) } else { Break(()) }
//! });
//! ended.stopped?; // outputs off, ports stopped
//! # Ok(())
//! # }
//! ```
//!
//! # Modules
//! An application needs the names at the root, and parts of [`driver`] and [`hal`]. The other
//! modules serve special tasks:
//!
//! | module | for |
//! |---|---|
//! | [`driver`] | applications: settings, the cycle, faults, recovery, statistics |
//! | [`hal`] | applications: typed pins and parameters, LinuxCNC's names |
//! | [`boards`] | applications: handles of known cards and boards; support for new ones |
//! | [`modules`] | support for a new HostMot2 module: its registers, pins and cycle in one place |
//! | [`bus`] | support for another bus, or for a new module |
//! | [`transport`] | applications on Ethernet; wrappers of buses that record, or inject faults |
//! | [`ethernet`] | maintenance: identity, EEPROM, flash memory |
//! | [`runner`] | applications on Linux: the thread of the cycle, and its end |
//! | [`discovery`], [`remote`] | support for a new card; tools: descriptions and parameters |
//! | [`hostmot2`], [`sslbp`] | tools: contents of a firmware, the ports of its remotes |
//! | [`lbp`], [`lbp16`] | tools: the wire formats, as bytes |
//! | [`guides`] | all: a page for each task, with code that runs |
//! | [`gateware`] | reference: facts missing in the manuals, cited in the code by number |
//!
//! A layer depends only on those below it: `bus` and the wire formats are independent, `hal` and
//! `hostmot2` build on them, then `sslbp`, `discovery`, `remote` with `boards`, `modules`,
//! `driver`.
//!
//! Further packages:
//!
//! | package | for |
//! |---|---|
//! | `mesa-wire` | other drivers or simulators: contains [`bus`], [`lbp`] and [`lbp16`] |
//! | `mesa-hal-sim` | tests and development: simulated FPGA, remotes, motors, Ethernet board |
//! | `mesa-tools` | inventory, diagnosis and wiring, remotes in setup mode; the command `mesa` |
//!
//! The simulator shares only `mesa-wire` with the driver, so that the two cannot contain the same
//! error.
//!
//! The [`guides`] have a page for each task: the cycle with enables and re-arming, faults, homing,
//! several boards, realtime, parameters, your own card or module, microcontrollers, LinuxCNC.
//!
//! # Terms
//! | term | meaning |
//! |---|---|
//! | board | an FPGA card that a host communicates with, such as a 7I97 |
//! | module | a part of its firmware, such as the PWM generators or a smart-serial port |
//! | port | one smart-serial module with its channels. Ports of I/O pins are always I/O ports |
//! | channel | one serial line of a port, 0 to 7 |
//! | remote | the device at the end of a channel. A card may contain several: a 7I77 contains two |
//! | terminal | a screw terminal of a card, such as TB8 pin 3, to which a pin's signal belongs |
//! | transfer | one exchange of process data between a port and its remotes; the command is DOIT |
//! | process data | the inputs and outputs that a transfer moves, as the remote describes them |
//! | pin | a value that every cycle moves: an input, an output, or both. Signals, not screws |
//! | parameter | a value that configures pins, or the remote itself, and that is rarely changed |
//! | group | pins that become valid, old and safe together: those of a remote, or of the board |
//! | valid | an input is valid if the last read of its group, and its transfer, were good |
//! | age | time since the transfer that a value comes from; for pins of the board, since the read |
//! | safe state | the state of outputs that are not armed: off, 0, or their safe value |
//! | armed | a group's outputs follow the application. After a fault they are safe until re-armed |
//! | re-arm | to let the outputs of a group follow again after a fault: [`Driver::rearm`] |
//! | offline | a remote without transfers: it failed, has a fault, or is optional and was absent |
//! | missing | a configured remote that did not start, or is another one; so until the next start |
//! | optional | a remote that may be absent at the start; it has pins, and starts once plugged in |
//! | setting | a register that is written at set-up, when it changes, and after a reset |
//! | evidence | registers read in every cycle, which show that the board still has its set-up |
//! | bite | the expiry of a watchdog that was not fed in time: it switches the outputs off |
//! | pace | the clock that times the cycle: the host's, or the board's ([`Pace::Board`]) |
//!
//! # The real-time contract
//! [`Driver::read`] and [`Driver::write`] do one exchange each, which the bus bounds by a deadline.
//! The two do not allocate, log, panic, or wait for hardware: a busy port is a state, not a loop.
//! Only if the application requests it does `read` wait for the next period of the board's own
//! clock ([`Pace::Board`]). Everything else belongs to set-up or maintenance, is bounded as well,
//! and may allocate. Each item has a section "Real time".
//!
//! # Lost and late packets
//! Over Ethernet every reply indicates the last write that the board executed, and the number of
//! packets that it has received. A packet that is lost, late, duplicate or reordered is detected
//! with the next reply, and counted by its kind as far as the board can distinguish it: see
//! [`BusStatistics`](bus::BusStatistics). The inputs that depend on it are discarded.
//!
//! # Validity and age of pins
//! Reading an input returns its value, its validity, and its age: the age of the data, measured
//! from the start of its transfer. An output that is not finite is replaced by its safe value, one
//! that is out of range by its nearest limit; both are counted. After a failure, outputs are safe
//! until the application re-arms them: [`guides::faults`] lists every fault.
//!
//! # Undetectable events
//! - An encoder counts 16 bits: an encoder that moves more than 32,767 counts between two good
//!   reads is miscounted. At 3 million counts per second that takes 10 ms. The pin `count-unsure`
//!   indicates that a miscount is possible; whether it has happened cannot be detected, and the
//!   axis must be homed again.
//! - Smart serial replies carry no number. A reply that comes a whole period late is distinguished
//!   from the next one by the pause of a channel after a failure; two consecutive replies with that
//!   delay are not.
//! - A program that drives the same board is detected when the bus is opened, and in the cycle when
//!   it sends as many packets for a second
//!   ([`BusStatistics::foreign_packets`](bus::BusStatistics::foreign_packets)); a program that
//!   sends fewer is not. Never let two programs drive one board: commands that it has sent until
//!   then are executed.
//! - A write packet that the network delays is executed when it arrives: for a short time the
//!   outputs are older than the newest. The next reply shows it, and the next write overrides it.
//!
//! # Features
//! - `std` (default): the UDP socket, and [`runner`]. Without `std` the driver needs `alloc`, at
//!   set-up only, and on Ethernet a [network stack](guides::microcontroller).
//! - `log` (default): messages at set-up and when a driver is dropped, never in the cycle; and
//!   events on request ([`Events::log`](driver::Events::log)). Their target is `mesa_hal`. A
//!   program that uses `tracing` receives them through its bridge (crate `tracing-log`, which
//!   `tracing_subscriber::fmt::init` sets up).
//! - `serde`: events, statistics, states, pins, snapshots and settings can be sent, and stored in
//!   files.
//! - `realtime`: a [`runner`] that stops on a signal and, on Linux, configures its thread in the
//!   kernel: priority, locked memory, CPUs.
//!
//! # Compatibility
//! Most types that the library returns are `#[non_exhaustive]`: a new field or case does not break
//! an application. Inputs that an application builds, such as [`Settings`], [`RemoteConfig`] and
//! tables of cards, are not, so that they can be written as literals. A new field there is a
//! breaking change, which the version number announces; a literal that ends in
//! `..Default::default()` compiles nevertheless.
//!
//! # Safety
//! The boards move heavy machines. Never rely on software to disable a motor if a person would be
//! exposed to a hazard should it start.
#![cfg_attr(not(feature = "std"), no_std)]
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

extern crate alloc;

pub mod advice;
pub mod boards;
pub mod bus;
pub mod discovery;
pub mod driver;
pub mod ethernet;
mod events;
mod fraction;
#[cfg(feature = "std")]
pub mod guides;
pub mod hal;
pub mod hostmot2;
pub mod modules;
mod packed;
mod parse_error;
pub mod remote;
#[cfg(feature = "std")]
pub mod runner;
#[cfg(feature = "serde")]
mod serial_form;
mod settings;
pub mod sslbp;
mod tally;
pub mod transport;

pub use advice::{Advice, AdviceTopic, MesaError, WithAdvice};
pub use boards::{I7i72, I7i76, I7i77, I7i77Analog, I7i77Field, I7i97};
pub use bus::{Clock, RegisterBus};
pub use driver::{Board, Configured, Driver, DriverError, Settings};
pub use driver::{BoardState, CycleError, CycleReport, Pace, Rearmed, Remark, RemoteState};
pub use driver::{FaultPolicy, GpioConfig, Presence, RemoteConfig, SerialConfig};
pub use hal::{AnalogIn, AnalogOut, Axis, Counter, DigitalIn, DigitalOut};
pub use hal::{InOut, Input, Output, Param, Pins, Reading};
pub use hostmot2::RemoteId;
pub use mesa_wire::Rounded;
pub use mesa_wire::{lbp, lbp16};
pub use parse_error::ParseError;
pub use sslbp::RemoteLabel;
pub use transport::udp::{UdpBus, UdpConfig};

#[doc = include_str!("../docs/gateware.md")]
pub mod gateware {}

/// The code in the README is compiled and run as a test.
#[cfg(all(doctest, feature = "std"))]
#[doc = include_str!("../README.md")]
struct Readme;
