//! The contents of a snapshot as 64-bit words.

use core::time::Duration;

use super::RunStatistics;
use crate::bus::{BusStatistics, Instant};
use crate::driver::{BoardState, DriverStatistics, OfflineReason, RemoteState};
use crate::hal::{Age, GroupState};
use crate::sslbp::RemoteFaults;
use crate::tally::Tally;

/// Destination of words.
pub(super) trait WordSink {
    fn put(&mut self, word: u64);
}

/// Counts the words.
impl WordSink for usize {
    fn put(&mut self, _: u64) {
        self.tally(1);
    }
}

/// A value that is a fixed number of words.
///
/// # Real time
/// Constant time, no allocation, no panic.
pub(super) trait Packed {
    fn pack(&self, to: &mut impl WordSink);

    /// Restores a value from the words of [`pack`](Self::pack).
    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self;
}

impl Packed for u64 {
    fn pack(&self, to: &mut impl WordSink) {
        to.put(*self);
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        from.next().unwrap_or_default()
    }
}

impl Packed for Instant {
    fn pack(&self, to: &mut impl WordSink) {
        to.put(self.as_nanos());
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        Self::from_nanos(u64::unpack(from))
    }
}

/// In nanoseconds; the largest number stands for [`Duration::MAX`].
impl Packed for Duration {
    fn pack(&self, to: &mut impl WordSink) {
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
            fn pack(&self, to: &mut impl WordSink) {
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
    others,
});

impl Packed for BusStatistics {
    fn pack(&self, to: &mut impl WordSink) {
        for count in self.counts() {
            to.put(count);
        }
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        Self::from_counts(core::array::from_fn(|_| u64::unpack(from)))
    }
}

packed!(Age { cycles, time });

impl Packed for GroupState {
    fn pack(&self, to: &mut impl WordSink) {
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
    fn pack(&self, to: &mut impl WordSink) {
        to.put(match self {
            Self::Running => 0,
            Self::WatchdogBitten => 1,
            Self::Reset => 2,
            Self::BusDown => 3,
            Self::OtherFirmware => 4,
        });
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        match u64::unpack(from) {
            0 => Self::Running,
            1 => Self::WatchdogBitten,
            2 => Self::Reset,
            3 => Self::BusDown,
            _ => Self::OtherFirmware,
        }
    }
}

impl Packed for RemoteFaults {
    fn pack(&self, to: &mut impl WordSink) {
        to.put(self.bits().into());
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        Self::from_bits_retain(u64::unpack(from) as u8)
    }
}

impl Packed for RemoteState {
    fn pack(&self, to: &mut impl WordSink) {
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

/// The numbers of the reason, in two words; `None` has a number that no reason has.
impl Packed for Option<OfflineReason> {
    fn pack(&self, to: &mut impl WordSink) {
        let (number, one, other) = self.map_or((u8::MAX, 0, 0), OfflineReason::to_words);
        to.put(number.into());
        to.put(u64::from(one) << 32 | u64::from(other));
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Self {
        let (number, detail) = (u64::unpack(from), u64::unpack(from));
        let number = u8::try_from(number).ok()?;
        OfflineReason::from_words((number, (detail >> 32) as u32, detail as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modules::serial::every_reason;

    impl WordSink for Vec<u64> {
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
        use BoardState::{BusDown, OtherFirmware, Reset, Running, WatchdogBitten};
        assert_eq!(again(&None::<OfflineReason>), None);
        let reasons = every_reason(5, 0x1234_5678);
        assert!(reasons.len() > 10);
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
        for state in [Running, WatchdogBitten, Reset, BusDown, OtherFirmware] {
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
