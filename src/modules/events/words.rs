//! Events as words, which another thread can take without a lock.

use super::{Event, EventKind};
use crate::bus::{BusErrorKind, Instant};
use crate::lbp::RemoteFaults;
use crate::modules::serial::OfflineReason;
use crate::sslbp::{CsStatus, Failure, ProcessDataSizes, RemoteName};

/// The words of an event: time, cycle, what, and two that say more.
pub(super) const WORDS: usize = 7;

/// All kinds of errors, in an order of this file's own.
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
    /// The number of its bit, port, channel and reason, and what these need.
    fn to_words(self) -> [u32; 3] {
        let (port, channel) = self.remote().unwrap_or((0, 0));
        let (reason, one, other) = match self {
            Self::TransferFailed { failure, .. } => (0, failure as u32, 0),
            Self::RemoteOffline { reason, .. } | Self::RemoteStaysOffline { reason, .. } => {
                of_reason(reason)
            }
            Self::Rearmed { armed, waiting } => (0, armed, waiting),
            Self::ReadFailed { why } | Self::WriteFailed { why } => {
                let number = BUS_ERRORS.iter().position(|kind| *kind == why);
                (0, number.unwrap_or(BUS_ERRORS.len()) as u32, 0)
            }
            Self::NotThere { found: one }
            | Self::ReadsAgain { failed: one }
            | Self::LostWrites { count: one }
            | Self::MissedPeriods { count: one }
            | Self::Dropped { count: one } => (0, one, 0),
            Self::RemoteBack { .. }
            | Self::RemoteUp { .. }
            | Self::RemoteRearmed { .. }
            | Self::WatchdogBitten
            | Self::BoardReset
            | Self::BusDown
            | Self::BoardSetUp => (0, 0, 0),
        };
        let bit = self.mask().bits().trailing_zeros() as u8;
        [u32::from_le_bytes([bit, port, channel, reason]), one, other]
    }

    fn from_words([what, one, other]: [u32; 3]) -> Option<Self> {
        let [bit, port, channel, reason] = what.to_le_bytes();
        let reason = || reason_of(reason, one, other);
        let why = || BUS_ERRORS.get(one as usize).copied();
        Some(match bit {
            0 => Self::TransferFailed {
                port,
                channel,
                failure: failure_of(one)?,
            },
            1 => Self::RemoteOffline {
                port,
                channel,
                reason: reason()?,
            },
            2 => Self::RemoteStaysOffline {
                port,
                channel,
                reason: reason()?,
            },
            3 => Self::RemoteBack { port, channel },
            4 => Self::RemoteUp { port, channel },
            5 => Self::RemoteRearmed { port, channel },
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
            13 => Self::ReadsAgain { failed: one },
            14 => Self::WriteFailed { why: why()? },
            15 => Self::LostWrites { count: one },
            16 => Self::MissedPeriods { count: one },
            17 => Self::Dropped { count: one },
            _ => return None,
        })
    }
}

fn failure_of(number: u32) -> Option<Failure> {
    Failure::ALL.get(number as usize).copied()
}

fn of_sizes(sizes: ProcessDataSizes) -> u32 {
    u32::from(sizes.rx) | u32::from(sizes.tx) << 8
}

fn sizes_of(word: u32) -> ProcessDataSizes {
    let [rx, tx, ..] = word.to_le_bytes();
    ProcessDataSizes { rx, tx }
}

fn of_reason(reason: OfflineReason) -> (u8, u32, u32) {
    match reason {
        OfflineReason::Absent => (0, 0, 0),
        OfflineReason::TooManyFailures(failure) => (1, failure as u32, 0),
        OfflineReason::NotRunning(cs) => (2, cs.0, 0),
        OfflineReason::Watchdog => (3, 0, 0),
        OfflineReason::IllegalMode => (4, 0, 0),
        OfflineReason::FieldPower(faults) => (5, faults.bits().into(), 0),
        OfflineReason::Reported(faults) => (6, faults.bits().into(), 0),
        OfflineReason::DidNotStart(cs) => (7, cs.0, 0),
        OfflineReason::AnotherDevice { name, unit_number } => {
            (8, u32::from_le_bytes(name.0), unit_number)
        }
        OfflineReason::OtherTables { found, expected } => (9, found, expected),
        OfflineReason::OtherSizes { found, expected } => (10, of_sizes(found), of_sizes(expected)),
        OfflineReason::PortStuck => (11, 0, 0),
        OfflineReason::Stopped => (12, 0, 0),
        OfflineReason::Requested => (13, 0, 0),
    }
}

fn reason_of(number: u8, one: u32, other: u32) -> Option<OfflineReason> {
    let faults = RemoteFaults::from_bits_retain(one as u8);
    Some(match number {
        0 => OfflineReason::Absent,
        1 => OfflineReason::TooManyFailures(failure_of(one)?),
        2 => OfflineReason::NotRunning(CsStatus(one)),
        3 => OfflineReason::Watchdog,
        4 => OfflineReason::IllegalMode,
        5 => OfflineReason::FieldPower(faults),
        6 => OfflineReason::Reported(faults),
        7 => OfflineReason::DidNotStart(CsStatus(one)),
        8 => OfflineReason::AnotherDevice {
            name: RemoteName::from_register(one),
            unit_number: other,
        },
        9 => OfflineReason::OtherTables {
            found: one,
            expected: other,
        },
        10 => OfflineReason::OtherSizes {
            found: sizes_of(one),
            expected: sizes_of(other),
        },
        11 => OfflineReason::PortStuck,
        12 => OfflineReason::Stopped,
        13 => OfflineReason::Requested,
        _ => return None,
    })
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
    fn every_kind_of_event_and_every_reason_has_words() {
        let word = |bit, reason| u32::from_le_bytes([bit, 1, 2, reason]);
        for bit in 0..18 {
            let kind = EventKind::from_words([word(bit, 0), 1, 2]).expect("a kind");
            assert_eq!(kind.mask().bits(), 1 << bit, "{kind:?}");
        }
        assert_eq!(EventKind::from_words([word(18, 0), 0, 0]), None);
        for number in 0..14 {
            let reason = reason_of(number, 1, 2).expect("a reason");
            assert_eq!(of_reason(reason).0, number, "{reason:?}");
        }
        assert_eq!(reason_of(14, 0, 0), None);
    }
}
