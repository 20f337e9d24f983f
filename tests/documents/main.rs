//! The documents agree with the code and with each other.

mod architecture;
mod circles;
mod citations;
#[path = "../common/mod.rs"]
mod common;
mod dependencies;
mod faults;
mod layers;
mod links;
mod names;
mod neighbours;
mod readme;

use std::path::Path;

/// The folder of the project.
fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}
