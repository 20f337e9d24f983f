//! What a snapshot holds, as 64-bit words.

use core::time::Duration;

use super::RunStatistics;
use crate::bus::{BusStatistics, Instant};
use crate::driver::{BoardState, DriverStatistics, Failure, OfflineReason, RemoteState};
use crate::hal::{Age, GroupState};
use crate::sslbp::{CsStatus, ProcessDataSizes, RemoteFaults, RemoteName};

/// Where words go.
pub(super) trait Sink {
    fn put(&mut self, word: u64);
}

/// How many there are.
impl Sink for usize {
    fn put(&mut self, _: u64) {
        *self += 1;
    }
}

/// Something that is a fixed number of words.
///
/// # Real time
/// Constant time, no allocation, no panic.
pub(super) trait Packed {
    fn pack(&self, to: &mut impl Sink);

    /// Of words that [`pack`](Self::pack) made.
    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self;
}

impl Packed for u64 {
    fn pack(&self, to: &mut impl Sink) {
        to.put(*self);
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        from.next().unwrap_or_default()
    }
}

impl Packed for Instant {
    fn pack(&self, to: &mut impl Sink) {
        to.put(self.as_nanos());
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        Self::from_nanos(u64::unpack(from))
    }
}

/// In nanoseconds; the longest is for ever.
impl Packed for Duration {
    fn pack(&self, to: &mut impl Sink) {
        to.put(u64::try_from(self.as_nanos()).unwrap_or(u64::MAX));
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        match u64::unpack(from) {
            u64::MAX => Self::MAX,
            nanos => Self::from_nanos(nanos),
        }
    }
}

macro_rules! packed {
    ($type:ident { $($field:ident),* $(,)? }) => {
        impl Packed for $type {
            fn pack(&self, to: &mut impl Sink) {
                $(self.$field.pack(to);)*
            }

            fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
                Self { $($field: Packed::unpack(from),)* }
            }
        }
    };
}

packed!(RunStatistics {
    cycles,
    failed_reads,
    failed_writes,
    skipped_periods,
    latest,
    longest,
    last_late,
    last_took,
});
packed!(DriverStatistics {
    reads,
    writes,
    read_errors,
    write_errors,
    lost_writes,
    missed_periods,
    unpaced_cycles,
    watchdog_bites,
    resets,
    bus_down,
});
packed!(BusStatistics {
    exchanges,
    late,
    lost,
    stale,
    duplicate,
    short,
    foreign,
    lost_writes,
    late_writes,
    repeated_writes,
    unconfirmed_writes,
    doubts,
    bytes_sent,
    bytes_received,
});
packed!(Age { cycles, time });

impl Packed for GroupState {
    fn pack(&self, to: &mut impl Sink) {
        to.put(u64::from(self.valid) | u64::from(self.armed) << 1);
        self.age.pack(to);
        to.put(self.faults);
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        let flags = u64::unpack(from);
        Self {
            valid: flags & 1 != 0,
            armed: flags & 2 != 0,
            age: Age::unpack(from),
            faults: u64::unpack(from),
        }
    }
}

impl Packed for BoardState {
    fn pack(&self, to: &mut impl Sink) {
        to.put(match self {
            Self::Running => 0,
            Self::WatchdogBitten => 1,
            Self::Reset => 2,
            Self::BusDown => 3,
        });
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        match u64::unpack(from) {
            0 => Self::Running,
            1 => Self::WatchdogBitten,
            2 => Self::Reset,
            _ => Self::BusDown,
        }
    }
}

impl Packed for RemoteFaults {
    fn pack(&self, to: &mut impl Sink) {
        to.put(self.bits().into());
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        Self::from_bits_retain(u64::unpack(from) as u8)
    }
}

impl Packed for RemoteState {
    fn pack(&self, to: &mut impl Sink) {
        let (kind, reason, next) = match *self {
            Self::Running => (0, None, None),
            Self::Offline {
                reason,
                next_attempt,
            } => (1, Some(reason), next_attempt),
            Self::Restarting { reason } => (2, Some(reason), None),
        };
        to.put(kind);
        reason.pack(to);
        to.put(next.map_or(u64::MAX, Instant::as_nanos));
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        let (kind, reason) = (u64::unpack(from), Option::<OfflineReason>::unpack(from));
        let next = u64::unpack(from);
        match (kind, reason) {
            (1, Some(reason)) => Self::Offline {
                reason,
                next_attempt: (next != u64::MAX).then(|| Instant::from_nanos(next)),
            },
            (2, Some(reason)) => Self::Restarting { reason },
            _ => Self::Running,
        }
    }
}

/// What it is, and two numbers.
impl Packed for Option<OfflineReason> {
    fn pack(&self, to: &mut impl Sink) {
        use OfflineReason as Reason;
        let pair = |one: u32, other: u32| u64::from(one) << 32 | u64::from(other);
        let sizes = |sizes: ProcessDataSizes| u32::from_le_bytes([sizes.rx, sizes.tx, 0, 0]);
        let (kind, detail) = match *self {
            None => (0, 0),
            Some(Reason::Absent) => (1, 0),
            Some(Reason::TooManyFailures(failure)) => (2, failure as u64),
            Some(Reason::NotRunning(cs)) => (3, cs.0.into()),
            Some(Reason::Watchdog) => (4, 0),
            Some(Reason::IllegalMode) => (5, 0),
            Some(Reason::FieldPower(faults)) => (6, faults.bits().into()),
            Some(Reason::Reported(faults)) => (7, faults.bits().into()),
            Some(Reason::DidNotStart(cs)) => (8, cs.0.into()),
            Some(Reason::AnotherDevice { name, unit_number }) => {
                (9, pair(u32::from_le_bytes(name.0), unit_number))
            }
            Some(Reason::OtherTables { found, expected }) => (10, pair(found, expected)),
            Some(Reason::OtherSizes { found, expected }) => {
                (11, pair(sizes(found), sizes(expected)))
            }
            Some(Reason::PortStuck) => (12, 0),
            Some(Reason::Stopped) => (13, 0),
            Some(Reason::Requested) => (14, 0),
        };
        to.put(kind);
        to.put(detail);
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        use OfflineReason as Reason;
        let (kind, detail) = (u64::unpack(from), u64::unpack(from));
        let (one, other) = ((detail >> 32) as u32, detail as u32);
        let faults = RemoteFaults::from_bits_retain(detail as u8);
        let sizes = |word: u32| {
            let [rx, tx, ..] = word.to_le_bytes();
            ProcessDataSizes { rx, tx }
        };
        Some(match kind {
            1 => Reason::Absent,
            2 => Reason::TooManyFailures(*Failure::ALL.get(detail as usize)?),
            3 => Reason::NotRunning(CsStatus(other)),
            4 => Reason::Watchdog,
            5 => Reason::IllegalMode,
            6 => Reason::FieldPower(faults),
            7 => Reason::Reported(faults),
            8 => Reason::DidNotStart(CsStatus(other)),
            9 => Reason::AnotherDevice {
                name: RemoteName(one.to_le_bytes()),
                unit_number: other,
            },
            10 => Reason::OtherTables {
                found: one,
                expected: other,
            },
            11 => Reason::OtherSizes {
                found: sizes(one),
                expected: sizes(other),
            },
            12 => Reason::PortStuck,
            13 => Reason::Stopped,
            14 => Reason::Requested,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Sink for Vec<u64> {
        fn put(&mut self, word: u64) {
            self.push(word);
        }
    }

    fn again<T: Packed>(value: &T) -> T {
        let mut words = Vec::new();
        value.pack(&mut words);
        let mut rest = words.into_iter();
        let again = T::unpack(&mut rest);
        assert_eq!(rest.next(), None, "as many words are read as were written");
        again
    }

    #[test]
    fn every_reason_and_state_comes_back_as_it_was() {
        use BoardState::{BusDown, Reset, Running, WatchdogBitten};
        let sizes = |rx, tx| ProcessDataSizes { rx, tx };
        let faults = RemoteFaults::from_bits_retain(0xA5);
        let cs = CsStatus(0x8123_4567);
        let mut reasons = vec![
            OfflineReason::Absent,
            OfflineReason::NotRunning(cs),
            OfflineReason::Watchdog,
            OfflineReason::IllegalMode,
            OfflineReason::FieldPower(faults),
            OfflineReason::Reported(faults),
            OfflineReason::DidNotStart(cs),
            OfflineReason::AnotherDevice {
                name: RemoteName(*b"7I72"),
                unit_number: 0x1234_5678,
            },
            OfflineReason::OtherTables {
                found: 0xFEDC_BA98,
                expected: 1,
            },
            OfflineReason::OtherSizes {
                found: sizes(1, 255),
                expected: sizes(9, 4),
            },
            OfflineReason::PortStuck,
            OfflineReason::Stopped,
            OfflineReason::Requested,
        ];
        reasons.extend(Failure::ALL.map(OfflineReason::TooManyFailures));
        assert_eq!(again(&None::<OfflineReason>), None);
        for reason in reasons {
            assert_eq!(again(&Some(reason)), Some(reason));
            for next_attempt in [None, Some(Instant::from_nanos(77))] {
                let state = RemoteState::Offline {
                    reason,
                    next_attempt,
                };
                assert_eq!(again(&state), state);
            }
            let state = RemoteState::Restarting { reason };
            assert_eq!(again(&state), state);
        }
        assert_eq!(again(&RemoteState::Running), RemoteState::Running);
        for state in [Running, WatchdogBitten, Reset, BusDown] {
            assert_eq!(again(&state), state);
        }
        for (valid, armed) in [(false, true), (true, false)] {
            let age = Age::NEVER;
            let state = GroupState {
                valid,
                armed,
                age,
                faults: 3,
            };
            assert_eq!(again(&state), state);
        }
    }
}
