//! Set-up of a driver: what it refuses, requests and logs.

mod bus_at_run_time;
mod corrected;
mod duplicated_replies;
mod given_back;
mod large;
mod linuxcnc;
pub mod log;
mod refused;
mod watchdog;
mod words;
