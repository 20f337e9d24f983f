//! The library on simulated boards.

#[path = "../../../../tests/common/mod.rs"]
mod common;
mod inventory;
mod passive;
mod wiring_index;
