//! What the command `mesa` is made of, for programs that do the same: the [`inventory`] of a board,
//! the [`diagnosis`] of board, network, computer and wiring, and the [`setup`] of remotes over a
//! serial port.

pub mod diagnosis;
pub mod inventory;
pub mod setup;

extern crate alloc;
