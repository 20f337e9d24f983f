//! Buses: LBP16 over UDP, and layers that record accesses or inject faults; names of registers.
//! With the feature `std` also the socket, and the search for boards.

// Runs in the cycle.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod faulty;
mod recording;
mod register_map;
#[cfg(feature = "std")]
pub mod search;
#[cfg(all(test, feature = "std"))]
mod tests;
pub mod udp;

pub use crate::bus::Fault;
pub use faulty::Faulty;
pub use recording::{BusLog, RecordedEntry, Recording};
pub use register_map::{NamedRegister, ReadRefusal, RegisterMap};
