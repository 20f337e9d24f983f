//! What all commands have in common: files, help, and other programs at the same board.

mod completion;
mod consent;
mod failure;
mod files;
mod firewall;
pub mod manual;
mod second_master;
pub mod signals;
mod troubles;
