//! The line to a remote.

use core::time::Duration;

/// Baud rate of every channel unless it is changed.
pub const DEFAULT_BAUD_RATE: u32 = 2_500_000;

/// Time that a remote takes to answer, as recorded with well-behaved remotes.
pub const USUAL_REMOTE_LATENCY: Duration = Duration::from_micros(10);
