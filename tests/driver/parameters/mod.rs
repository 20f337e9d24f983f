//! Parameters in the non-volatile memory of remotes.

mod remote;
mod remote_watchdog;
mod requested;
