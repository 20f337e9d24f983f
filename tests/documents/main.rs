//! What the documents say is so.

#[path = "../common/mod.rs"]
mod common;
mod neighbours;
mod readme;
