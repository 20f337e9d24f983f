//! What all commands have in common: files, help, and other programs at the same board.

mod files;
mod firewall;
mod manual;
mod second_master;
mod troubles;
