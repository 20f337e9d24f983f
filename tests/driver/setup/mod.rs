//! Set-up of a driver: what it refuses, requests and logs.

mod bus_at_run_time;
mod duplicated_replies;
mod given_back;
mod linuxcnc;
pub mod log;
mod refused;
mod watchdog;
mod words;
