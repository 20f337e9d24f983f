//! Ethernet boards: the driver behind a bad network, and the functions of a board apart from its
//! registers.

mod bad_network;
mod board;
mod bursts;
#[path = "../common/mod.rs"]
mod common;
mod network_stack;
mod other_board;
mod registers;
mod spi;
