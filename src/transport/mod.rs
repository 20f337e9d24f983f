//! Buses: LBP16 over UDP, and wrappers that record accesses or inject faults. Also the search for
//! boards and the route to an address.

// Runs in the cycle.
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
pub use recording::{RecordedEntry, Recording};
