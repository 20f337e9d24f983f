//! Buses: LBP16 over UDP, recording and fault-injecting wrappers.

mod faulty;
mod recording;
#[cfg(test)]
mod tests;
pub mod udp;

pub use faulty::{Fault, Faulty, FaultyError};
pub use recording::{Entry, Event, Recording};
