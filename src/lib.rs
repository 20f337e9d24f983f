//! Mesa Electronics' motion I/O from Rust: a HAL driver in the style of LinuxCNC. To develop against
//! without a board there is a simulated FPGA, the package `mesa-hal-sim`.
//!
//! A [`Board`] is identified and configured, started as a [`Driver`], and cycled: `read`, the
//! application's own work on [`Pins`], `write`. On Linux a [`runner`] does that, once in each period:
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
//!     // `cycle.read` is what failed in part, or as a whole
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
//! # Who needs what
//! An application needs the names at the root, and of [`driver`] and [`hal`] what it wants to know
//! beyond them. Each module says whom it is for:
//!
//! | module | for |
//! |---|---|
//! | [`driver`] | applications: settings, the cycle, faults, recovery, statistics |
//! | [`hal`] | applications: typed pins and parameters, LinuxCNC's names |
//! | [`boards`] | applications: handles of known cards and boards; whoever adds a card or a board |
//! | [`modules`] | whoever adds a HostMot2 module: registers, pins and cycle of one in one place |
//! | [`bus`] | whoever brings another bus, or adds a module |
//! | [`transport`] | applications on Ethernet; wrappers of buses that record, and that fail on purpose |
//! | [`ethernet`] | maintenance: identity, EEPROM, flash memory |
//! | [`runner`] | applications on Linux: the thread of the cycle, and how it ends |
//! | [`discovery`], [`remote`] | whoever adds a card: its table; tools: what remotes tell, their parameters |
//! | [`hostmot2`], [`sslbp`] | tools: what a firmware has, the ports of its remotes |
//! | [`lbp`], [`lbp16`] | tools: the wire formats, as bytes |
//! | [`gateware`] | readers: facts that the manuals do not have, which the code cites by number |
//!
//! A layer knows only those below it: `bus` and the wire formats know nothing else, `hal` and
//! `hostmot2` stand on them, then `sslbp`, `discovery`, `remote` with `boards`, `modules`, `driver`.
//!
//! Other packages have what belongs to none of these:
//!
//! | package | for |
//! |---|---|
//! | `mesa-wire` | whoever writes another driver or simulator: [`bus`], [`lbp`] and [`lbp16`] are from there |
//! | `mesa-hal-sim` | tests, and work without a board: simulated FPGA, remotes, motors, Ethernet board |
//! | `mesa-tools` | tools: inventory, diagnosis and wiring, remotes in setup mode; the command `mesa` |
//!
//! The simulator shares `mesa-wire` with the driver and nothing else, so that the two can not agree on
//! the same mistake.
//!
//! Pages with code that runs: [home an axis on its index](driver::homing),
//! [faults and re-arm](driver::faults), [several boards](driver::several_boards),
//! threads and realtime set-up on Linux (`runner::linux`, feature `realtime`),
//! [parameters of remotes](guides::parameters), [your own module](guides::own_module),
//! [your own card](guides::own_card), [LinuxCNC and the simulated board](guides::linuxcnc). What a remote
//! that fails costs the others of its port is on [a page](driver::neighbours) without.
//!
//! # Words
//! | word | means |
//! |---|---|
//! | board | an FPGA card that a host talks to, such as a 7I97 |
//! | module | a part of its firmware, such as the PWM generators or a smart-serial port |
//! | port | one smart-serial module with its channels. Ports of I/O pins are always I/O ports |
//! | channel | one serial line of a port, 0 to 7 |
//! | remote | the device at the end of a channel. A card may hold several: a 7I77 holds two |
//! | transfer | one exchange of process data between a port and its remotes; the command is DOIT |
//! | process data | the inputs and outputs that a transfer moves, as the remote describes them |
//! | group | the pins that become valid, old and safe together: those of a remote, or of the board |
//! | safe state | what outputs do that nobody drives: off, or 0 |
//! | armed | a group's outputs follow the application. After a fault they are safe until re-armed |
//! | offline | a remote that takes no part in transfers: it failed too often, or reported a fault |
//! | setting | a register that is written at set-up, when it changes, and after a reset |
//! | evidence | registers read in every cycle, which tell that the board still has its set-up |
//!
//! # The real-time contract
//! [`Driver::read`] and [`Driver::write`] do one exchange each, which the bus bounds by a deadline.
//! They do not allocate, log, panic, or wait for hardware: a busy port is a state, not a loop. Only
//! where the application asks for it does `read` wait for the next period of the board's own clock
//! ([`Pace::Board`]). Everything else belongs to set-up or maintenance, is bounded as well, and may
//! allocate. Each item has a section "Real time".
//!
//! # What becomes of packets
//! Over Ethernet every reply tells which write was the last that the board executed, and how many
//! packets it has received. A packet that is lost, late, duplicate or reordered is noticed with the
//! next reply, and counted as what it was as far as the board can tell: see
//! [`BusStatistics`](bus::BusStatistics). The inputs that depend on it are not taken.
//!
//! # What a pin says
//! Reading an input gives its value, whether it is valid, and its age: the age of the data, from
//! the moment its transfer was started. An output that is not finite becomes its safe value, one
//! that is out of range its nearest limit; both are counted. After a failure, outputs are safe
//! until the application re-arms them: [`driver::faults`] has every fault.
//!
//! # What nothing can notice
//! - An encoder counts 16 bits: one that moves more than 32,767 counts between two good reads is
//!   miscounted. At 3 million counts a second that is 10 ms. That it may have happened is on its
//!   pin `count-unsure`; whether it did, nothing can tell, and the axis has to be homed again.
//! - Smart serial replies carry no number. One that comes a whole period late is distinguished
//!   from the next by the rest a channel gets after a failure; two in a row that late are not.
//! - A program that drives the same board is noticed when the bus is opened, and in the cycle when it
//!   sends as much for a second ([`BusStatistics::others`](bus::BusStatistics::others));
//!   one that sends less is not. Never let two programs drive one board: what it has ordered until
//!   then is done.
//! - A write packet that the network delays is executed when it arrives: for a moment the outputs
//!   are older than the newest. The next reply shows it, and the next write overrides it.
//!
//! # Features
//! - `std` (default): [`transport`] and [`runner`]. Without it the core needs `alloc`, at set-up only.
//! - `log` (default): messages at set-up and where a driver is dropped, never in the cycle; and events,
//!   when they are asked for ([`Events::log`](driver::Events::log)). Their target is `mesa_hal`. A program
//!   that uses `tracing` gets them by its bridge (crate `tracing-log`, which `tracing_subscriber::fmt::init`
//!   sets up).
//! - `serde`: events, statistics, states and settings can be sent, and kept in files.
//! - `realtime`: a [`runner`] that stops on a signal, and on Linux what its thread asks of the kernel:
//!   priority, locked memory, CPUs.
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
mod fraction;
#[cfg(feature = "std")]
pub mod guides;
pub mod hal;
pub mod hostmot2;
pub mod modules;
pub mod remote;
mod rounded;
#[cfg(feature = "std")]
pub mod runner;
#[cfg(feature = "serde")]
mod serial_form;
pub mod sslbp;
mod tally;
#[cfg(feature = "std")]
pub mod transport;

pub use boards::{I7i72, I7i77, I7i77Analog, I7i77Field, I7i97};
pub use bus::{Clock, RegisterBus};
pub use driver::{Board, Driver, DriverError, Settings};
pub use driver::{BoardState, CycleError, CycleReport, Pace, Rearmed, Remark, RemoteState};
pub use driver::{FaultPolicy, GpioConfig, Presence, RemoteConfig, SerialConfig};
pub use hal::{AnalogIn, AnalogOut, Counter, DigitalIn, DigitalOut};
pub use hal::{InOut, Input, Output, Param, Pins, Reading};
pub use hostmot2::RemoteId;
pub use mesa_wire::{lbp, lbp16};
pub use rounded::Rounded;
#[cfg(feature = "std")]
pub use transport::udp::{UdpBus, UdpConfig};

#[doc = include_str!("../docs/gateware.md")]
pub mod gateware {}

/// The code in the README is compiled and run as a test.
#[cfg(all(doctest, feature = "std"))]
#[doc = include_str!("../README.md")]
struct Readme;
