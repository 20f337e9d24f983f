//! Remotes: each simulated device, and those that are optional.

mod devices;
pub mod optional;
