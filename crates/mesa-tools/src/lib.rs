//! Library behind the command `mesa`, for programs with the same tasks: the [`inventory`] of a
//! board, the [`diagnosis`] of board, network, computer and wiring, a [`passive`] look at a board
//! that another program drives, and the [`setup`] of remotes over a serial port.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::indexing_slicing
    )
)]

pub mod advice;
mod counted;
pub mod diagnosis;
pub mod inventory;
pub mod passive;
pub mod setup;

pub use counted::Counted;
