//! The library on simulated boards.

#[path = "../../../../tests/common/mod.rs"]
mod common;
mod doctor;
mod inventory;
mod passive;
mod wiring;
mod wiring_index;
