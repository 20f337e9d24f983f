//! The end of a driver: its report, its log, and pins that are not driven after it.

#[cfg(feature = "log")]
mod log;
mod pins;
mod report;
