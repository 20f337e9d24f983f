//! The board of a command: its address, its bus, its pins as a person names them, and its cycle.

pub mod address;
pub mod bus;
pub mod bus_log;
pub mod changed;
pub mod consent;
pub mod hazard;
pub mod link;
pub mod look;
pub mod modes;
pub mod named;
pub mod pattern;
pub mod place;
pub mod reason;
pub mod running;
pub mod slow_watchdog;
pub mod target;
