//! Reasons why the data of a transfer cannot be used, with their counts.

use core::fmt;

use crate::advice::{self, Advice, MesaError};

/// Reason why the data of a transfer cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Failure {
    /// No reply in time, or a reply that is too short.
    NoReply,
    /// A reply that came after its timeout. Recognised one transfer later.
    Late,
    /// A reply with a wrong CRC.
    Crc,
    /// More characters than expected in the reply.
    ExtraCharacters,
    /// The line was held low.
    Break,
    /// Only a character received at the start of a request: noise, or a reply that overlaps the
    /// next request. Does not indicate damaged data (FACTS 11.8).
    Overrun,
    /// A damaged reply of unknown kind, because the sticky bits of CS were set already.
    Damaged,
    /// The channel does not run: another host stopped it, or the FPGA was reset.
    NotRunning,
    /// A good transfer after one that the bus may have lost: the reply could belong to that one.
    Doubtful,
}

impl Failure {
    /// All failures, in the order of [`FailureCounts`].
    pub const ALL: [Self; 9] = [
        Self::NoReply,
        Self::Late,
        Self::Crc,
        Self::ExtraCharacters,
        Self::Break,
        Self::Overrun,
        Self::Damaged,
        Self::NotRunning,
        Self::Doubtful,
    ];
}

impl core::error::Error for Failure {}

impl MesaError for Failure {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::NoReply | Self::Break => Some(advice::CHECK_CARD_POWER),
            Self::Crc | Self::ExtraCharacters | Self::Overrun | Self::Damaged => {
                Some(advice::CHECK_SHIELD)
            }
            Self::NotRunning => Some(advice::CHECK_SUPPLY),
            // The card has answered, and the network has lost packets.
            Self::Doubtful => Some(advice::CHECK_SWITCHES),
            Self::Late => None,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::NoReply => "no reply",
            Self::Late => "late reply",
            Self::Crc => "wrong CRC",
            Self::ExtraCharacters => "extra characters",
            Self::Break => "line low",
            Self::Overrun => "overrun",
            Self::Damaged => "damaged reply",
            Self::NotRunning => "not running",
            Self::Doubtful => "discarded after a failure",
        })
    }
}

/// Count of each [`Failure`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FailureCounts {
    counts: [u64; Failure::ALL.len()],
    total: u64,
}

/// Serialised as a map from each failure to its count.
#[cfg(feature = "serde")]
impl serde::Serialize for FailureCounts {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter())
    }
}

impl FailureCounts {
    /// Number of all failures, without the transfers discarded after them.
    pub const fn total(&self) -> u64 {
        self.total
    }

    /// Each failure with its count.
    pub fn iter(&self) -> impl Iterator<Item = (Failure, u64)> + '_ {
        Failure::ALL.into_iter().zip(self.counts)
    }

    pub(super) fn add(&mut self, failure: Failure) {
        let count = self.counts.get_mut(failure as usize);
        debug_assert!(count.is_some(), "no count for {failure}");
        if let Some(count) = count {
            *count = count.wrapping_add(1);
        }
        let counted = u64::from(failure != Failure::Doubtful);
        self.total = self.total.wrapping_add(counted);
    }

    /// Counts a reply that was taken for lost as late.
    pub(super) fn lost_was_late(&mut self) {
        let [no_reply, late, ..] = &mut self.counts;
        *no_reply = no_reply.saturating_sub(1);
        *late = late.wrapping_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_is_doubted_only_where_nothing_was_received() {
        for failure in Failure::ALL {
            let doubts_power = failure.advice() == Some(advice::CHECK_CARD_POWER);
            let has_received = !matches!(failure, Failure::NoReply | Failure::Break);
            assert_eq!(doubts_power, !has_received, "{failure}");
        }
    }
}
