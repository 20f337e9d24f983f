//! What a remote says about itself: tables in memory, and the simulated devices over the wire.

#[path = "../common/mod.rs"]
mod common;
mod devices;
mod images;
