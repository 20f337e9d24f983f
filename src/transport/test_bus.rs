//! A bus of words in memory, for the tests of the buses around buses.

use core::time::Duration;
use std::collections::BTreeMap;

use crate::bus::{Access, BusError, BusErrorKind, Direction, Instant, Prepared, RegisterBus};

/// Registers keep what is written; each exchange takes a microsecond.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) words: BTreeMap<u16, u32>,
    pub(super) exchanges: usize,
    pub(super) fail_next: bool,
    /// Requests that were sent ahead.
    pub(super) posted: usize,
    now: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("told to fail")]
pub(super) struct MemoryError;

impl BusError for MemoryError {
    fn kind(&self) -> BusErrorKind {
        BusErrorKind::Device
    }
}

impl RegisterBus for Memory {
    type Error = MemoryError;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), MemoryError> {
        self.exchanges += 1;
        self.now += 1_000;
        if core::mem::take(&mut self.fail_next) {
            return Err(MemoryError);
        }
        for access in accesses {
            for (n, word) in words[access.words()].iter_mut().enumerate() {
                let address = access.address + 4 * n as u16;
                match access.direction {
                    Direction::Read => *word = self.words.get(&address).copied().unwrap_or(0),
                    Direction::Write => {
                        self.words.insert(address, *word);
                    }
                }
            }
        }
        Ok(())
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn wait(&mut self, duration: Duration) {
        self.now += duration.as_nanos() as u64;
    }

    fn prepare_paced(
        &mut self,
        accesses: &[Access],
        _limit: Duration,
    ) -> Result<Option<Prepared>, MemoryError> {
        self.prepare(accesses).map(Some)
    }

    fn post(&mut self, _list: &Prepared) -> Result<(), MemoryError> {
        self.posted += 1;
        Ok(())
    }

    fn slack(&self) -> Option<Duration> {
        Some(Duration::from_micros(5))
    }
}
