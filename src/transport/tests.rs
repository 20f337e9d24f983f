//! Tests of the bus wrappers, on a bus of words in memory.

mod faulty;
mod recording;

use core::time::Duration;
use std::collections::BTreeMap;

use crate::bus::{
    Access, AccessList, BusError, BusErrorKind, Clock, Direction, Instant, RegisterBus, Reply,
};

/// Registers keep their values; each exchange takes a microsecond.
#[derive(Debug, Default)]
struct Memory {
    words: BTreeMap<u16, u32>,
    exchanges: usize,
    fail_next: bool,
    /// Number of lists that were started.
    started: usize,
    now: u64,
}

const MEMORY_ERROR: BusError = BusError::custom(BusErrorKind::Device, "fails as it is asked to");

impl RegisterBus for Memory {
    fn can_hold(&self) -> bool {
        true
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.exchanges += 1;
        self.now += 1_000;
        if core::mem::take(&mut self.fail_next) {
            return Err(MEMORY_ERROR);
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

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.exchange(list.as_ref(), words)?;
        Ok(Reply::CERTAIN.with_slack(Some(Duration::from_micros(5))))
    }

    fn start(&mut self, _: &AccessList, _: &[u32]) -> Result<(), BusError> {
        self.started += 1;
        Ok(())
    }
}

impl Clock for Memory {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.now)
    }

    fn wait(&mut self, duration: Duration) {
        self.now += duration.as_nanos() as u64;
    }
}
