//! What a read of a port has brought.

use crate::bus::Instant;
use crate::sslbp::ChannelMask;

/// The result of a read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ReadOutcome {
    /// Channels with new, valid data.
    pub good: ChannelMask,
    /// Channels with a transfer whose data must not be used.
    pub failed: ChannelMask,
    /// Channels that went offline with this read.
    pub offline: ChannelMask,
    /// Channels that a START has started.
    pub started_anew: ChannelMask,
    /// Channels on which an attempt has found a new fault: see
    /// [`LifeChange::has_new_fault`](super::life::LifeChange::has_new_fault).
    pub new_faults: ChannelMask,
    /// The transfer was not complete in time.
    pub too_short: bool,
    /// Start of the transfer to which `good` and `failed` belong, and the number of earlier reads
    /// that found it incomplete.
    pub started: Instant,
    pub reads_before: u32,
}

impl ReadOutcome {
    /// The cycle in which the data of the transfer was due.
    pub fn due(&self, cycle: u64) -> u64 {
        cycle.saturating_sub(self.reads_before.into())
    }
}
