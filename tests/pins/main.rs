//! Pins and parameters: their names, and what they make of registers.

#[path = "../common/mod.rs"]
mod common;
mod packing_plan;
mod remote;
