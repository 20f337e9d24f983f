//! Set-up of a driver: what it refuses, requests and logs.

mod duplicated_replies;
#[cfg(feature = "log")]
pub mod log;
mod refused;
mod watchdog;
