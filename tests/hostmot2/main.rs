//! HostMot2: what a firmware says about itself.

#[path = "../common/mod.rs"]
mod common;
mod identify;
