//! Buses: LBP16 over UDP, recording and fault-injecting wrappers. Beside them: where boards are, and
//! the way to them.

// The cycle runs it.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod faulty;
pub mod network;
mod recording;
pub mod search;
#[cfg(test)]
mod tests;
pub mod udp;

pub use crate::bus::Fault;
pub use faulty::{Faulty, FaultyError};
pub use recording::{Entry, Event, Recording};
