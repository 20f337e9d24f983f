//! The realtime component `mesa_eth` for LinuxCNC: the driver of [`mesa_hal`] in the place of
//! `hostmot2` and `hm2_eth`, with the same names of pins, parameters and functions.
//!
//! ```text
//! loadrt mesa_eth board_ip=10.10.10.10 config="num_encoders=6 sserial_port_0=000xxxxx"
//! addf hm2_7i97.0.read  servo-thread
//! addf hm2_7i97.0.write servo-thread
//! ```
//!
//! A copy of the library under the name `mesa_pci.so` is the component `mesa_pci`, in the place of
//! `hm2_pci`: it drives the boards on the PCI bus, in the order of their addresses, each with its
//! word of `config=`.
//!
//! [The page for LinuxCNC users](mesa_hal::guides::linuxcnc) describes what differs. From the
//! outside in:
//!
//! | module | contains |
//! |---|---|
//! | `exports` | the symbols that `rtapi_app` looks up |
//! | `load` | loading the boards of a `loadrt` line |
//! | `component` | the functions of the cycle, the end, and panics |
//! | `parameters` | the words of the `loadrt` line |
//! | `config` | the words of `config=` |
//! | `cycle` | a board's cycle: HAL to the driver and back |
//! | `gpio` | the I/O pins alone, for a faster thread |
//! | `table` | the copy between HAL's values and the driver's pins |
//! | `rearm` | which outputs follow again after what the user has done in HAL |
//! | `outputs` | what HAL has on |
//! | `report` | events in the words of LinuxCNC's users |
//! | `loss` | the share of lost packets |
//! | `advice` | next steps, in the words of LinuxCNC's users |
//! | `log` | messages, limited in number by time |
//! | `memory` | pins and parameters in HAL's shared memory; unsafe |
//! | `interface` | `mesa_eth` or `mesa_pci`, by the name of the file |
//! | `ffi` | the functions of HAL, RTAPI and the C library; unsafe |
//!
//! # Real time
//! The functions of the cycle do not allocate, lock memory, or change the scheduling, which are
//! `rtapi_app`'s own. No environment variable changes their behaviour.

#![cfg_attr(
    not(test),
    warn(clippy::unwrap_used, clippy::expect_used, clippy::panic)
)]

mod advice;
mod component;
mod config;
mod cycle;
mod dpll;
mod exports;
mod ffi;
mod gpio;
mod interface;
mod load;
mod log;
mod loss;
mod memory;
mod outputs;
mod parameters;
mod rearm;
mod refused;
mod report;
mod table;

pub use config::{Config, ConfigError};

/// The largest number of boards in a `loadrt` line, as in hm2_eth.
pub const MAX_BOARDS: usize = 4;
