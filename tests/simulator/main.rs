//! The simulator by itself: modules, remotes, machines, and its robustness against any write.

mod arbitrary_accesses;
#[path = "../common/mod.rs"]
mod common;
mod dither;
mod encoders;
mod identity;
mod modules;
mod pci;
mod remotes;
mod serial_ports;
mod six_axes;
mod steppers;
