//! Outputs that are enabled individually although several share one enable.

use super::slot::NONE;

/// Longest chain of enables that is followed: more than any output needs.
pub(in crate::hal) const MAX_ENABLES: usize = 8;

/// Enable state of one pin, both as an output and as an enable of others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Enabling {
    /// Index of the pin that must be on for this one to reach its terminal; `NONE` without one.
    pub by: u32,
    /// As an output: the round of `by` in which it was enabled; 0 if it is not enabled.
    pub since: u32,
    /// As an enable: 0 until an output was enabled or disabled individually; changes whenever all
    /// enabled outputs are forgotten.
    pub round: u32,
    /// As an enable: number of outputs enabled in this round.
    pub wanted: u32,
}

impl Enabling {
    pub const NONE: Self = Self {
        by: NONE,
        since: 0,
        round: 0,
        wanted: 0,
    };

    /// Forgets all outputs that were enabled through this enable.
    pub fn forget(&mut self) {
        if self.round != 0 {
            self.round = self.round.wrapping_add(1).max(1);
            self.wanted = 0;
        }
    }
}
