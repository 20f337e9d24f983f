//! Simulated machines: one [description](description::Description), which the words of an option
//! and a TOML file both make, and the [machine](built::Machine) that is built from it.

mod argument;
pub mod boards;
pub mod built;
pub mod description;
mod devices;
pub mod embedded;
mod factory_flash;
pub mod file;
mod mechanics;
pub mod slot;
