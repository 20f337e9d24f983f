//! Register writes of set-up, kept to be repeated after the board has lost them.

use alloc::vec::Vec;
use core::convert::Infallible;

use crate::bus::{Access, AccessList, Direction, Hold, RegisterBus, Reply};
use crate::hostmot2::Writes;

/// A bus that only takes notes: what is written to it can be replayed on a real one.
///
/// Reads give 0, so it is for set-up functions that only write.
#[derive(Clone, Debug, Default)]
pub struct SetupList {
    writes: Vec<(u16, u32)>,
}

impl SetupList {
    /// What was written, in order.
    pub fn writes(&self) -> &[(u16, u32)] {
        &self.writes
    }

    /// Adds a write.
    pub fn push(&mut self, address: u16, word: u32) {
        self.writes.push((address, word));
    }

    /// Writes all of it to `bus` in one exchange, in order, acknowledged.
    pub(super) fn replay<B: RegisterBus>(&self, bus: &mut B) -> Result<(), B::Error> {
        let (accesses, mut words) = self.to_accesses();
        bus.exchange(&accesses, &mut words)
    }

    pub(super) fn to_accesses(&self) -> (Vec<Access>, Vec<u32>) {
        let accesses = (0u16..)
            .zip(&self.writes)
            .map(|(n, &(address, _))| Access::write(address, n, 1))
            .collect();
        (
            accesses,
            self.writes.iter().map(|&(_, word)| word).collect(),
        )
    }
}

impl Writes for SetupList {
    fn push(&mut self, address: u16, word: u32) {
        Self::push(self, address, word);
    }
}

impl RegisterBus for SetupList {
    type Error = Infallible;
    type List = AccessList;

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

    fn prepare(&mut self, accesses: &[Access], _: Option<Hold>) -> Result<AccessList, Infallible> {
        Ok(AccessList::new(accesses))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, Infallible> {
        self.exchange(list.accesses(), words)?;
        Ok(Reply::CERTAIN)
    }
}
