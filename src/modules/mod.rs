//! The modules of a board: each is one file or folder with its registers, its pins and its cycle.
//!
//! A [`Module`] registers the registers that it reads, writes and is set up with, once, at a
//! [`Registrar`], and then does one step after each read and one before each write. The board's
//! watchdog and its serial ports are modules like the others, and an application can add modules
//! that this crate does not support.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

pub(crate) mod built_in;
mod doubt;
pub mod dpll;
pub mod encoder;
mod error;
pub mod gpio;
pub mod in_mux;
mod latch;
pub mod led;
pub(crate) mod limit;
mod module;
pub mod outputs;
pub mod pwm;
mod registrar;
pub mod serial;
pub mod stepgen;
mod undriven;
mod unsure;
pub mod watchdog;

pub use error::RegisterError;
pub(crate) use module::{LastFeed, bank_stem, bits_of};
pub use module::{ListenCycle, Module, Outage, ReadCycle, RunOnCycle, WriteCycle};
pub use registrar::Registrar;
pub use undriven::{Undriven, UndrivenReason, undriven};

#[cfg(all(test, feature = "std"))]
mod tests;
