//! The mapped registers as the bus of a driver.

use core::time::Duration;
use std::fs::File;

use mesa_wire::bus::{
    Access, AccessList, BusError, BusStatistics, Clock, Direction, Hold, HostClock, Instant,
    RegisterBus, Reply,
};

use crate::mapping::Mapping;
use crate::simulated::Log;
use crate::{COOKIE, COOKIE_ADDRESS, PciAddress};

/// Number of accesses on the bus since its creation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PciCounts {
    /// Registers read, about 1 us each on a real bus; with the forced reads.
    pub reads: u64,
    /// Registers written. They are posted: the processor does not wait for them.
    pub writes: u64,
    /// Reads of the cookie that forced writes to arrive.
    pub forced: u64,
    /// Reads of the cookie because a register has read as all ones.
    pub doubted: u64,
}

/// The registers of a board on the PCI bus. [`PciDevice::open`](crate::PciDevice::open) makes it.
///
/// The page of the crate has the order and the arrival of writes, and what happens when the board
/// vanishes.
///
/// # Real time
/// An exchange makes one access for each register, in the order of the list, and no system call. It
/// is bounded by the bus: about 1 us for each register that is read, and a wait of some ms at most
/// where the bus is stuck. It does not allocate if the list was prepared.
#[derive(Debug)]
pub struct PciBus {
    board: PciAddress,
    registers: Mapping,
    /// Announces accesses to the simulator, if the board is simulated.
    log: Option<Log>,
    /// The words of an exchange until it is complete: on failure, none has changed.
    scratch: Vec<u32>,
    clock: HostClock,
    counts: PciCounts,
    exchanges: u64,
    /// Keeps the lock.
    _file: File,
}

impl PciBus {
    pub(crate) fn new(board: PciAddress, registers: Mapping, log: Option<Log>, file: File) -> Self {
        Self {
            board,
            registers,
            log,
            scratch: Vec::new(),
            clock: HostClock::new(),
            counts: PciCounts::default(),
            exchanges: 0,
            _file: file,
        }
    }

    /// Address of the board.
    pub const fn address(&self) -> PciAddress {
        self.board
    }

    /// Number of accesses so far.
    pub const fn counts(&self) -> PciCounts {
        self.counts
    }

    /// True if the board is [simulated](crate::simulated).
    pub const fn is_simulated(&self) -> bool {
        self.log.is_some()
    }

    /// Reads the cookie, and nothing else.
    pub(crate) fn cookie(&mut self) -> Result<u32, BusError> {
        self.announce(&[Access::read(COOKIE_ADDRESS, 0, 1)])?;
        Ok(self.load(COOKIE_ADDRESS))
    }

    fn load(&mut self, address: u16) -> u32 {
        self.counts.reads += 1;
        self.registers.read(usize::from(address / 4))
    }

    /// Runs a list on `words`. `is_forced` has the writes at its end arrive before it returns.
    fn run_list(
        &mut self,
        accesses: &[Access],
        words: &mut [u32],
        is_forced: bool,
    ) -> Result<Reply, BusError> {
        accesses
            .iter()
            .try_for_each(|access| access.check(words.len()))?;
        self.exchanges += 1;
        let mut scratch = core::mem::take(&mut self.scratch);
        scratch.clear();
        scratch.extend_from_slice(words);
        let result = self.access_all(accesses, &mut scratch, is_forced);
        if result.is_ok() {
            words.copy_from_slice(&scratch);
        }
        self.scratch = scratch;
        result
    }

    fn access_all(
        &mut self,
        accesses: &[Access],
        words: &mut [u32],
        is_forced: bool,
    ) -> Result<Reply, BusError> {
        let (mut has_read, mut is_doubtful) = (false, false);
        let mut rest = accesses;
        while let Some((&access, behind)) = rest.split_first() {
            if access.direction == Direction::Read {
                // All neighbouring reads at once: a simulator executes them together.
                let end = rest
                    .iter()
                    .position(|access| access.direction == Direction::Write);
                let (reads, behind) = rest.split_at(end.unwrap_or(rest.len()));
                is_doubtful |= self.read_all(reads, words)?;
                (has_read, rest) = (true, behind);
            } else {
                self.write_all_of(access, words)?;
                rest = behind;
            }
        }
        let ends_with_write = accesses
            .last()
            .is_some_and(|access| access.direction == Direction::Write);
        if is_forced && ends_with_write {
            self.counts.forced += 1;
            (has_read, is_doubtful) = (true, true);
        } else if is_doubtful {
            self.counts.doubted += 1;
        }
        if is_doubtful {
            let (board, cookie) = (self.board, self.cookie()?);
            if cookie != COOKIE {
                return Err(BusError::Vanished { board, cookie });
            }
        }
        if let Some(log) = &self.log {
            log.wake();
        }
        Ok(Reply::CERTAIN.with_certain(has_read))
    }

    /// Reads registers; returns true if one reads as all ones.
    fn read_all(&mut self, reads: &[Access], words: &mut [u32]) -> Result<bool, BusError> {
        self.announce(reads)?;
        let mut is_doubtful = false;
        for access in reads {
            let targets = words.get_mut(access.words()).unwrap_or_default();
            for (target, address) in targets.iter_mut().zip((access.address..).step_by(4)) {
                *target = self.load(address);
                is_doubtful |= *target == u32::MAX;
            }
        }
        Ok(is_doubtful)
    }

    fn write_all_of(&mut self, access: Access, words: &[u32]) -> Result<(), BusError> {
        let sources = words.get(access.words()).unwrap_or_default();
        for (&word, address) in sources.iter().zip((access.address..).step_by(4)) {
            self.counts.writes += 1;
            self.registers.write(usize::from(address / 4), word);
            if let Some(log) = &mut self.log {
                let board = self.board;
                log.write(address, word)
                    .ok_or(BusError::Unanswered { board })?;
            }
        }
        Ok(())
    }

    /// Has a simulator execute all writes so far, and these reads.
    fn announce(&mut self, reads: &[Access]) -> Result<(), BusError> {
        let Some(log) = &mut self.log else {
            return Ok(());
        };
        let addresses = reads.iter().flat_map(|access| {
            let addresses = (access.address..).step_by(4);
            addresses.take(access.count.into())
        });
        let board = self.board;
        log.read(addresses).ok_or(BusError::Unanswered { board })
    }
}

impl RegisterBus for PciBus {
    /// For set-up: writes have arrived when it returns, at the cost of one more read if the list
    /// ends with a write.
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.run_list(accesses, words, true).map(drop)
    }

    fn prepare(&mut self, accesses: &[Access], _: Option<Hold>) -> Result<AccessList, BusError> {
        let words = accesses.iter().map(|access| access.words().end).max();
        let words = words.unwrap_or(0);
        accesses.iter().try_for_each(|access| access.check(words))?;
        // The buffer of an exchange may be longer than this list needs.
        self.scratch.reserve(2 * words + ROOM);
        Ok(AccessList::new(accesses))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.run_list(list.as_ref(), words, false)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.run_list(accesses, words, false).map(drop)
    }

    fn statistics(&self) -> BusStatistics {
        BusStatistics::of_exchanges(self.exchanges)
    }
}

/// Words of an exchange's buffer that no prepared list may need.
const ROOM: usize = 1024;

impl Clock for PciBus {
    fn now(&mut self) -> Instant {
        self.clock.read()
    }

    fn wait(&mut self, duration: Duration) {
        self.clock.wait(duration);
    }

    fn sleep(&mut self, duration: Duration) {
        self.clock.sleep(duration);
    }
}
