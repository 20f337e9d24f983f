//! Register writes of set-up, kept to be repeated after the board has lost them.

use alloc::vec::Vec;
use core::convert::Infallible;
use core::time::Duration;

use crate::bus::{Access, Direction, Instant, Prepared, RegisterBus};

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

    /// Adds a write.
    pub fn push(&mut self, address: u16, word: u32) {
        self.writes.push((address, word));
    }

    /// Writes all of it to `bus`, in order, acknowledged.
    pub(super) fn replay<B: RegisterBus>(&self, bus: &mut B) -> Result<(), B::Error> {
        for chunk in self.writes.chunks(CHUNK) {
            let (accesses, mut words) = packet(chunk);
            bus.exchange(&accesses, &mut words)?;
        }
        Ok(())
    }

    /// The same for the cycle.
    pub(super) fn prepare<B: RegisterBus>(&self, bus: &mut B) -> Result<Restore, B::Error> {
        let mut packets = Vec::new();
        for chunk in self.writes.chunks(CHUNK) {
            let (accesses, words) = packet(chunk);
            packets.push((bus.prepare(&accesses)?, words));
        }
        Ok(Restore { packets })
    }
}

fn packet(chunk: &[(u16, u32)]) -> (Vec<Access>, Vec<u32>) {
    let accesses = (0u16..)
        .zip(chunk)
        .map(|(n, &(address, _))| Access::write(address, n, 1))
        .collect();
    (accesses, chunk.iter().map(|&(_, word)| word).collect())
}

/// The set-up of a board, ready to be written again within the cycle.
#[derive(Debug)]
pub(super) struct Restore {
    packets: Vec<(Prepared, Vec<u32>)>,
}

impl Restore {
    /// Takes over a setting that was changed since: the last write of its register. Those before
    /// it, which keep the board safe on the way, stay.
    ///
    /// # Real time
    /// Grows with the number of writes; no allocation.
    pub fn change(&mut self, address: u16, word: u32) {
        for (prepared, words) in self.packets.iter_mut().rev() {
            let place = prepared
                .accesses()
                .iter()
                .rposition(|access| access.address == address);
            if let Some(old) = place.and_then(|place| words.get_mut(place)) {
                *old = word;
                return;
            }
        }
    }

    /// Writes all of it, in order.
    ///
    /// # Real time
    /// One exchange for each 64 registers. No allocation.
    pub fn run<B: RegisterBus>(&mut self, bus: &mut B) -> Result<(), B::Error> {
        for (prepared, words) in &mut self.packets {
            bus.exchange_prepared(prepared, words)?;
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
