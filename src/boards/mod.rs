//! Which remote or module is which pin.
//!
//! [`RemotePins`](crate::remote::RemotePins) makes the pins of any remote from its descriptor; a [`RemoteTable`] adds terminals
//! and safe values for the boards that are known. [`i7i77`] and [`i7i72`] give their pins names in
//! Rust.

mod board_table;
mod error;
mod flash;
pub mod fpga;
mod handles;
pub mod i7i72;
pub mod i7i77;
pub mod i7i97;
mod identity;
mod table;
mod terminals;

pub use board_table::{BoardTable, CardTable, ModuleTerminals, PwmTable};
pub use error::BoardError;
pub use flash::FlashLayout;
pub use i7i72::I7i72;
pub use i7i77::{I7i77Analog, I7i77Field, OutputType};
pub use i7i97::I7i97;
pub use identity::{Difference, IdentityError};
pub use table::{ElementTable, RemoteTable, Terminal};
pub use terminals::{Place, Terminals};

use handles::handles;
