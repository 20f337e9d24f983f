//! Checks of the statements in the documents.

mod architecture;
mod citations;
#[path = "../common/mod.rs"]
mod common;
mod dependencies;
mod faults;
mod layers;
mod neighbours;
mod readme;
