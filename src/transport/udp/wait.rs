//! The awaited reply.

use core::time::Duration;

use super::ledger::LedgerState;
use crate::bus::Instant;

/// The awaited reply.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    pub request: u32,
    /// The writes that were sent before it.
    pub ledger: LedgerState,
    /// The details were requested.
    pub detailed: bool,
    pub started: Instant,
    /// Longest time that it may take, in addition to the wait in the board.
    pub deadline: Duration,
    /// Number of packets sent up to and including this one.
    pub sent: u64,
}
