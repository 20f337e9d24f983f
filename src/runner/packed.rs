//! The parts of a snapshot that no event has, as words.

use core::time::Duration;

use super::RunStatistics;
use crate::bus::BusStatistics;
use crate::driver::DriverStatistics;
use crate::hal::{Age, GroupState};
use crate::packed::{Packed, WordSink, packed};

packed!(RunStatistics {
    cycles: u64,
    failed_reads: u64,
    failed_writes: u64,
    skipped_periods: u64,
    latest: Duration,
    longest: Duration,
    last_late: Duration,
    last_took: Duration,
});
packed!(DriverStatistics {
    reads: u64,
    writes: u64,
    read_errors: u64,
    write_errors: u64,
    lost_writes: u64,
    missed_periods: u64,
    unpaced_cycles: u64,
    watchdog_bites: u64,
    resets: u64,
    bus_down: u64,
    foreign_packets: u64,
});

/// Number of counts of [`BusStatistics`].
const COUNTS: usize = 15;

impl Packed for BusStatistics {
    const WORDS: usize = COUNTS;

    fn pack(&self, to: &mut impl WordSink) {
        for count in self.counts() {
            to.put(count);
        }
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self> {
        let mut counts = [0; COUNTS];
        for count in &mut counts {
            *count = from.next()?;
        }
        Some(Self::from_counts(counts))
    }
}

packed!(Age {
    cycles: u64,
    time: Duration,
});

/// The flags share a word.
impl Packed for GroupState {
    const WORDS: usize = 2 + Age::WORDS;

    fn pack(&self, to: &mut impl WordSink) {
        let [valid, armed, pending] = [self.valid, self.armed, self.rearm_pending].map(u64::from);
        to.put(valid | armed << 1 | pending << 2);
        self.age.pack(to);
        to.put(self.faults);
    }

    fn unpack(from: &mut impl Iterator<Item = u64>) -> Option<Self> {
        let flags = from.next()?;
        Some(Self {
            valid: flags & 1 != 0,
            armed: flags & 2 != 0,
            rearm_pending: flags & 4 != 0,
            age: Age::unpack(from)?,
            faults: from.next()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::Instant;
    use crate::driver::{BoardState, OfflineReason, RemoteState};
    use crate::packed::tests::{again, every};

    #[test]
    fn every_reason_and_state_comes_back_as_it_was() {
        assert_eq!(again(&None::<OfflineReason>), Some(None));
        for reason in every::<OfflineReason>(&[5, 0x1234_5678]) {
            assert_eq!(again(&Some(reason)), Some(Some(reason)));
            for next_attempt in [None, Some(Instant::from_nanos(77))] {
                let state = RemoteState::Offline {
                    reason,
                    next_attempt,
                };
                assert_eq!(again(&state), Some(state));
            }
        }
        // The first field of a state is the number of its reason.
        for state in every::<RemoteState>(&[0, 9, 7]) {
            assert_eq!(again(&state), Some(state));
        }
        for state in every::<BoardState>(&[0]) {
            assert_eq!(again(&state), Some(state));
        }
        for (valid, armed) in [(false, true), (true, false)] {
            let age = Age::NEVER;
            let state = GroupState {
                valid,
                armed,
                rearm_pending: !armed,
                age,
                faults: 3,
            };
            assert_eq!(again(&state), Some(state));
        }
    }

    #[test]
    fn every_number_of_the_statistics_comes_back_in_its_place() {
        let words = 1..=RunStatistics::WORDS as u64;
        let run = RunStatistics::unpack(&mut words.into_iter()).expect("enough words");
        assert_eq!((run.cycles, run.failed_reads), (1, 2));
        assert_eq!(run.last_took, Duration::from_nanos(8));
        assert_eq!(again(&run), Some(run));
        let words = 1..=DriverStatistics::WORDS as u64;
        let driver = DriverStatistics::unpack(&mut words.into_iter()).expect("enough words");
        assert_eq!((driver.reads, driver.foreign_packets), (1, 11));
        assert_eq!(again(&driver), Some(driver));
    }
}
