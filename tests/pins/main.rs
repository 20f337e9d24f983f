//! Pins and parameters: their names, and their conversion from and to registers.

#[path = "../common/mod.rs"]
mod common;
mod packing_plan;
mod remote;
