//! Boards and cards as data: tables of what they do not tell of themselves, and structs of handles
//! with the same shapes for the same functions.
//!
//! [`BoardTable`] and [`RemoteTable`](crate::discovery::RemoteTable) are for the kinds that this
//! crate knows and for your own; so are [`BoardHandles`], [`RemoteHandles`] and [`CardHandles`], which
//! one mechanism attaches.

mod attach;
mod board_table;
mod flash;
pub mod i7i64;
pub mod i7i72;
pub mod i7i77;
pub mod i7i97;
mod identity;

pub use crate::hostmot2::board_table::{
    BoardTable, CardTable, FlashLayout, ModuleTerminals, PwmTable,
};
pub use board_table::DB25;

pub use attach::{AttachError, BoardHandles, CardFinder, CardHandles, Finder, RemoteHandles};
pub use i7i72::I7i72;
pub use i7i77::{I7i77, I7i77Analog, I7i77Field};
pub use i7i97::I7i97;
pub(crate) use identity::check_identity;
pub use identity::{IdentityError, REMOTES};
