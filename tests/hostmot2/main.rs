//! HostMot2: what a firmware says about itself, and its modules.

#[path = "../common/mod.rs"]
mod common;
mod identify;
mod modules;
mod simulated;
