//! The end of a driver: its report, its log, and pins that are not driven after it.

mod log;
mod pins;
mod report;
