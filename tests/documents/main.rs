//! What the documents say is so.

mod architecture;
mod citations;
#[path = "../common/mod.rs"]
mod common;
mod dependencies;
mod faults;
mod layers;
mod neighbours;
mod readme;
