//! What the documents say is so.

mod citations;
#[path = "../common/mod.rs"]
mod common;
mod neighbours;
mod readme;
