//! Commands that set up a board or its remotes.

pub mod flash;
mod flash_boot_block;
mod hal;
mod ip;
mod led;
mod param;
mod param_words;
mod report;
pub mod restart;
mod update;
