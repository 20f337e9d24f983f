//! The PWM generators.

use crate::Replay;

/// Not connected yet.
pub const REPLAY: Option<Replay> = None;
