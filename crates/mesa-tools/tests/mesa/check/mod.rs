//! Commands that check a machine.

mod doctor;
mod latency;
pub mod set;
pub mod wiring;
