//! The DPLL.

use crate::Replay;

/// Not connected yet.
pub const REPLAY: Option<Replay> = None;
