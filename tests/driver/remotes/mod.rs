//! Remotes: each simulated device, those that are optional, and reasons of those that are offline.

mod at_start;
mod cards;
mod devices;
pub mod optional;
mod reasons;
