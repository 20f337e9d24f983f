//! Inputs: their validity and their age.

mod failed_transfer;
mod stale_after;
mod write_without_read;
