//! Register writes of set-up, kept to be repeated after the board has lost them.

use alloc::vec::Vec;
use core::convert::Infallible;
use core::time::Duration;

use crate::bus::{Access, Direction, Instant, RegisterBus};

/// A bus that only takes notes: what is written to it can be replayed on a real one.
///
/// Reads give 0, so it is for set-up functions that only write.
#[derive(Clone, Debug, Default)]
pub struct SetupList {
    writes: Vec<(u16, u32)>,
}

/// Writes in one exchange: far below what a packet holds.
const CHUNK: usize = 64;

impl SetupList {
    /// What was written, in order.
    pub fn writes(&self) -> &[(u16, u32)] {
        &self.writes
    }

    /// Writes all of it to `bus`, in order.
    pub(super) fn replay<B: RegisterBus>(&self, bus: &mut B) -> Result<(), B::Error> {
        for chunk in self.writes.chunks(CHUNK) {
            let accesses: Vec<Access> = (0u16..)
                .zip(chunk)
                .map(|(n, &(address, _))| Access::write(address, n, 1))
                .collect();
            let mut words: Vec<u32> = chunk.iter().map(|&(_, word)| word).collect();
            bus.exchange(&accesses, &mut words)?;
        }
        Ok(())
    }
}

impl RegisterBus for SetupList {
    type Error = Infallible;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Infallible> {
        for access in accesses {
            let range = words.get_mut(access.words()).unwrap_or_default();
            for (n, word) in (0u16..).zip(range) {
                match access.direction {
                    Direction::Read => *word = 0,
                    Direction::Write => {
                        let address = access.address.wrapping_add(4 * n);
                        self.writes.push((address, *word));
                    }
                }
            }
        }
        Ok(())
    }

    fn now(&mut self) -> Instant {
        Instant::default()
    }

    fn wait(&mut self, _: Duration) {}
}
