//! Events as words, which another thread can take without a lock.

use core::time::Duration;

use super::{Event, EventKind, Repeating};
use crate::bus::{BusErrorKind, Instant};
use crate::hostmot2::RemoteId;
use crate::modules::serial::OfflineReason;
use crate::sslbp::Failure;

/// Number of words of an event: time, cycle, kind, and two for its fields.
pub(super) const WORDS: usize = 7;

/// All kinds of bus errors, in the order of their numbers in an event.
const BUS_ERRORS: [BusErrorKind; 10] = [
    BusErrorKind::Late,
    BusErrorKind::Lost,
    BusErrorKind::Stale,
    BusErrorKind::Refused,
    BusErrorKind::Unreachable,
    BusErrorKind::Short,
    BusErrorKind::Invalid,
    BusErrorKind::Occupied,
    BusErrorKind::Device,
    BusErrorKind::Other,
];

impl Event {
    pub(super) fn to_words(self) -> [u32; WORDS] {
        let [what, more @ ..] = self.kind.to_words();
        let (at, cycle) = (self.at.as_nanos(), self.cycle);
        let [one, other] = more;
        [
            at as u32,
            (at >> 32) as u32,
            cycle as u32,
            (cycle >> 32) as u32,
            what,
            one,
            other,
        ]
    }

    pub(super) fn from_words(words: [u32; WORDS]) -> Option<Self> {
        let [at, at_high, cycle, cycle_high, what, one, other] = words;
        let long = |low, high| u64::from(low) | u64::from(high) << 32;
        Some(Self {
            at: Instant::from_nanos(long(at, at_high)),
            cycle: long(cycle, cycle_high),
            kind: EventKind::from_words([what, one, other])?,
        })
    }
}

impl EventKind {
    /// A number for each reason with which an event may repeat.
    pub(super) fn reason(self) -> u32 {
        match self {
            Self::NotThere { .. } => (BUS_ERRORS.len() as u32).saturating_add(1),
            Self::TransferFailed { .. } | Self::ReadFailed { .. } | Self::WriteFailed { .. } => {
                let [_, reason, _] = self.to_words();
                reason
            }
            _ => 0,
        }
    }

    /// The words of a kind: number of its bit, port, channel and a number in the first, and two for
    /// its fields.
    fn to_words(self) -> [u32; 3] {
        let RemoteId { port, channel } = self.remote().unwrap_or(RemoteId::new(0, 0));
        let (number, one, other) = match self {
            Self::TransferFailed { failure, .. } => (0, failure as u32, 0),
            Self::RemoteOffline { reason, .. } | Self::RemoteStaysOffline { reason, .. } => {
                reason.to_words()
            }
            Self::Rearmed { armed, waiting } => (0, armed, waiting),
            Self::ReadFailed { why } | Self::WriteFailed { why } => {
                let number = BUS_ERRORS.iter().position(|kind| *kind == why);
                (0, number.unwrap_or(BUS_ERRORS.len()) as u32, 0)
            }
            Self::Repeated {
                what,
                count,
                lasted,
            } => {
                let millis = u32::try_from(lasted.as_millis()).unwrap_or(u32::MAX);
                (what.number(), count, millis)
            }
            Self::NotThere { found: one }
            | Self::LostWrites { count: one }
            | Self::MissedPeriods { count: one }
            | Self::Dropped { count: one }
            | Self::OtherMaster { packets: one }
            | Self::NotRead { writes: one } => (0, one, 0),
            Self::RemoteBack { .. }
            | Self::RemoteUp { .. }
            | Self::RemoteRearmed { .. }
            | Self::WatchdogBitten
            | Self::BoardReset
            | Self::BusDown
            | Self::BoardSetUp
            | Self::OtherFirmware => (0, 0, 0),
        };
        let bit = self.mask().bits().trailing_zeros() as u8;
        [u32::from_le_bytes([bit, port, channel, number]), one, other]
    }

    fn from_words([what, one, other]: [u32; 3]) -> Option<Self> {
        let [bit, port, channel, number] = what.to_le_bytes();
        let remote = RemoteId::new(port, channel);
        let reason = || OfflineReason::from_words((number, one, other));
        let why = || BUS_ERRORS.get(one as usize).copied();
        Some(match bit {
            0 => Self::TransferFailed {
                remote,
                failure: *Failure::ALL.get(one as usize)?,
            },
            1 => Self::RemoteOffline {
                remote,
                reason: reason()?,
            },
            2 => Self::RemoteStaysOffline {
                remote,
                reason: reason()?,
            },
            3 => Self::RemoteBack { remote },
            4 => Self::RemoteUp { remote },
            5 => Self::RemoteRearmed { remote },
            6 => Self::WatchdogBitten,
            7 => Self::BoardReset,
            8 => Self::BusDown,
            9 => Self::BoardSetUp,
            10 => Self::Rearmed {
                armed: one,
                waiting: other,
            },
            11 => Self::ReadFailed { why: why()? },
            12 => Self::NotThere { found: one },
            13 => Self::Repeated {
                what: Repeating::from_number(number, remote)?,
                count: one,
                lasted: Duration::from_millis(other.into()),
            },
            14 => Self::WriteFailed { why: why()? },
            15 => Self::LostWrites { count: one },
            16 => Self::MissedPeriods { count: one },
            17 => Self::Dropped { count: one },
            18 => Self::OtherMaster { packets: one },
            19 => Self::OtherFirmware,
            20 => Self::NotRead { writes: one },
            _ => return None,
        })
    }
}

impl Repeating {
    const fn number(self) -> u8 {
        match self {
            Self::FailedTransfers { .. } => 0,
            Self::FailedReads => 1,
            Self::FailedWrites => 2,
            Self::LostWrites => 3,
            Self::MissedPeriods => 4,
            Self::OtherMaster => 5,
        }
    }

    const fn from_number(number: u8, remote: RemoteId) -> Option<Self> {
        Some(match number {
            0 => Self::FailedTransfers { remote },
            1 => Self::FailedReads,
            2 => Self::FailedWrites,
            3 => Self::LostWrites,
            4 => Self::MissedPeriods,
            5 => Self::OtherMaster,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn whatever_words_make_an_event_they_are_its_words(
            time in any::<[u32; 4]>(),
            bit in 0u8..=20, port in 0u8..4, channel in 0u8..8, reason in 0u8..=14,
            one in prop_oneof![0u32..12, any::<u32>()], other in any::<u32>(),
        ) {
            let what = u32::from_le_bytes([bit, port, channel, reason]);
            let [at, at_high, cycle, cycle_high] = time;
            let words = [at, at_high, cycle, cycle_high, what, one, other];
            if let Some(event) = Event::from_words(words) {
                prop_assert_eq!(Event::from_words(event.to_words()), Some(event));
                prop_assert_eq!(event.to_words()[4].to_le_bytes()[0], bit);
                prop_assert!(!event.to_string().is_empty());
            }
        }
    }

    #[test]
    fn every_kind_of_event_has_words() {
        let word = |bit| u32::from_le_bytes([bit, 1, 2, 0]);
        for bit in 0..21 {
            let kind = EventKind::from_words([word(bit), 1, 2]).expect("a kind");
            assert_eq!(kind.mask().bits(), 1 << bit, "{kind:?}");
        }
        assert_eq!(EventKind::from_words([word(21), 0, 0]), None);
        for number in 0..6 {
            let what = Repeating::from_number(number, RemoteId::new(1, 2)).expect("something");
            assert_eq!(what.number(), number, "{what:?}");
        }
        assert_eq!(Repeating::from_number(6, RemoteId::new(0, 0)), None);
    }

    #[test]
    fn each_reason_with_which_something_repeats_has_a_bit_of_its_own() {
        let reads = BUS_ERRORS.map(|why| EventKind::ReadFailed { why }.reason());
        let not_there = EventKind::NotThere { found: 3 }.reason();
        let all: alloc::collections::BTreeSet<_> = reads.into_iter().chain([not_there]).collect();
        assert_eq!(all.len(), BUS_ERRORS.len() + 1);
        assert!(all.iter().all(|reason| *reason < u32::BITS));
        assert!(Failure::ALL.len() < u32::BITS as usize);
    }
}
