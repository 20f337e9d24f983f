//! Discovery of a remote: tables in memory, and the simulated devices over the wire.

#[path = "../common/mod.rs"]
mod common;
mod devices;
mod images;
