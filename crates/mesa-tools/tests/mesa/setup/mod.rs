//! Commands that set up a board or its remotes.

mod flash;
mod hal;
mod ip;
mod led;
mod param;
mod report;
pub mod restart;
mod update;
