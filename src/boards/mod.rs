//! Boards and cards as data: tables of properties that they do not report themselves, and structs
//! of handles with the same shapes for the same functions.
//!
//! [`BoardTable`] and [`RemoteTable`](crate::discovery::RemoteTable) serve the kinds that this
//! crate supports and your own; so do [`BoardHandles`], [`RemoteHandles`] and [`CardHandles`],
//! which are attached by one common mechanism.

mod attach;
mod board_table;
mod connectors;
mod flash;
pub mod i7i64;
pub mod i7i72;
pub mod i7i76;
pub mod i7i77;
pub mod i7i97;
mod identity;
mod remotes;

pub use crate::hostmot2::board_table::{
    BoardTable, CardTable, FlashLayout, ModuleTerminals, PwmTable,
};
pub use connectors::DB25;

pub use attach::{AttachError, BoardHandles, CardFinder, CardHandles, Finder, RemoteHandles};
pub use i7i72::I7i72;
pub use i7i76::I7i76;
pub use i7i77::{I7i77, I7i77Analog, I7i77Field};
pub use i7i97::I7i97;
pub use identity::IdentityError;
pub use remotes::REMOTES;
pub(crate) use remotes::check_identity;
