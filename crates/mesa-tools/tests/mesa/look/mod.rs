//! Commands that show a board: inventory, pins, values, registers.

mod colours;
mod firmwares;
mod info;
mod list;
mod passive;
mod pins;
mod raw;
mod registers;
mod scope;
mod watch;
