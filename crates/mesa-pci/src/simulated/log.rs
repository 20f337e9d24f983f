//! The log of a simulated board: accesses from the host, in order, and how far they are executed.
//!
//! Words of the file, little-endian: 0 magic, 1 number of entries so far (host), 2 number of
//! executed entries (simulator); from 16 on a ring of entries of two words: the address, with bit
//! 16 for a read, and the value.

use core::hint::spin_loop;
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use std::fs::{File, OpenOptions};
use std::io;
use std::path::Path;

use mesa_wire::bus::{HostClock, Instant};
use rustix::fs::{FlockOperation, Timespec, flock};
use rustix::io::Errno;
use rustix::thread::futex::{Flags, wait, wake};

use crate::mapping::Mapping;

/// The file of the log, in the folder of the board.
pub(crate) const LOG_FILE: &str = "mesa_simulated";

/// Bytes of the file.
pub(super) const BYTES: u64 = 4 * WORDS as u64;
const WORDS: usize = FIRST + 2 * ENTRIES as usize;
const ENTRIES: u32 = 4096;
const FIRST: usize = 16;

const MAGIC: u32 = 0x4D50_4331;
const MAGIC_WORD: usize = 0;
const PUT: usize = 1;
const DONE: usize = 2;

/// Bit of an entry's first word: a read.
const READ: u32 = 1 << 16;

/// Longest wait for the simulator.
const PATIENCE: Duration = Duration::from_secs(3);
/// Number of looks before the host sleeps: the simulator is often on another CPU already.
const LOOKS: u32 = 200;
/// Time of a sleep, after which the host looks again.
const SLEEP: Duration = Duration::from_millis(20);

/// One access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entry {
    Read(u16),
    Write(u16, u32),
}

/// The host's side.
#[derive(Debug)]
pub(crate) struct Log {
    words: Mapping,
    put: u32,
    clock: HostClock,
}

impl Log {
    /// Opens the log of a board whose simulator runs.
    ///
    /// # Errors
    /// Those of the file, and [`io::ErrorKind::NotConnected`] if its simulator has ended.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        // The simulator keeps the lock as long as it runs.
        if flock(&file, FlockOperation::NonBlockingLockShared) != Err(Errno::WOULDBLOCK) {
            return Err(io::ErrorKind::NotConnected.into());
        }
        let words = Mapping::new(&file, WORDS)?;
        if words.read(MAGIC_WORD) != MAGIC {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let put = words.read(PUT);
        Ok(Self {
            words,
            put,
            clock: HostClock::new(),
        })
    }

    /// Notes a write; `None` if the simulator does not answer.
    pub(crate) fn write(&mut self, address: u16, value: u32) -> Option<()> {
        self.push(u32::from(address), value)
    }

    /// Announces reads, and waits until they and all writes before them are executed; `None` if the
    /// simulator does not answer.
    pub(crate) fn read(&mut self, addresses: impl Iterator<Item = u16>) -> Option<()> {
        for address in addresses {
            self.push(u32::from(address) | READ, 0)?;
        }
        self.flush()
    }

    /// Has the simulator look now.
    pub(crate) fn wake(&self) {
        if let Some(put) = self.words.atomic(PUT) {
            // Nobody waits: then the simulator looks anyway.
            let _ = wake(put, Flags::empty(), 1);
        }
    }

    fn push(&mut self, access: u32, value: u32) -> Option<()> {
        if self.put.wrapping_sub(self.done()) >= ENTRIES {
            self.flush()?;
        }
        let place = FIRST + 2 * (self.put % ENTRIES) as usize;
        self.words.write(place, access);
        self.words.write(place + 1, value);
        self.put = self.put.wrapping_add(1);
        self.words.atomic(PUT)?.store(self.put, Ordering::Release);
        Some(())
    }

    fn done(&self) -> u32 {
        let done = self.words.atomic(DONE);
        done.map_or(self.put, |done| done.load(Ordering::Acquire))
    }

    fn flush(&self) -> Option<()> {
        self.wake();
        for _ in 0..LOOKS {
            if self.done() == self.put {
                return Some(());
            }
            spin_loop();
        }
        let until = self.clock.read().after(PATIENCE);
        loop {
            let done = self.done();
            if done == self.put {
                return Some(());
            }
            if self.clock.read() >= until {
                return None;
            }
            sleep_while(self.words.atomic(DONE)?, done, SLEEP);
        }
    }
}

/// The simulator's side.
#[derive(Debug)]
pub(super) struct LogReader {
    words: Mapping,
    done: u32,
}

impl LogReader {
    pub(super) fn new(file: &File) -> io::Result<Self> {
        let mut words = Mapping::new(file, WORDS)?;
        words.write(PUT, 0);
        words.write(DONE, 0);
        words.write(MAGIC_WORD, MAGIC);
        Ok(Self { words, done: 0 })
    }

    /// The next access, which is then executed. More of them than the ring has room for are not
    /// from a host that waits for the simulator: they are skipped.
    pub(super) fn next(&mut self) -> Option<Entry> {
        let put = self.words.atomic(PUT)?.load(Ordering::Acquire);
        if put.wrapping_sub(self.done) > ENTRIES {
            self.done = put;
        }
        if put == self.done {
            return None;
        }
        let place = FIRST + 2 * (self.done % ENTRIES) as usize;
        let (access, value) = (self.words.read(place), self.words.read(place + 1));
        self.done = self.done.wrapping_add(1);
        let address = access as u16 & !3;
        Some(if access & READ == 0 {
            Entry::Write(address, value)
        } else {
            Entry::Read(address)
        })
    }

    /// Lets the host go on.
    pub(super) fn answer(&self) {
        if let Some(done) = self.words.atomic(DONE) {
            done.store(self.done, Ordering::Release);
            let _ = wake(done, Flags::empty(), 1);
        }
    }

    /// Waits for the next access, for `limit` at most.
    pub(super) fn wait(&self, limit: Duration) {
        if let Some(put) = self.words.atomic(PUT) {
            sleep_while(put, self.done, limit);
        }
    }
}

/// Sleeps until a word has another value than `old`, for `limit` at most.
fn sleep_while(word: &AtomicU32, old: u32, limit: Duration) {
    let limit = Instant::from_nanos(0).after(limit).as_nanos();
    let limit = Timespec {
        tv_sec: (limit / 1_000_000_000) as i64,
        tv_nsec: (limit % 1_000_000_000) as i64,
    };
    // The caller looks again, whatever has ended the sleep.
    let _ = wait(word, Flags::empty(), old, Some(&limit));
}

#[cfg(test)]
mod tests {
    use rustix::fs::{MemfdFlags, ftruncate, memfd_create};

    use super::*;

    #[test]
    fn number_of_entries_that_the_ring_cannot_hold_is_skipped() {
        let file = File::from(memfd_create("log", MemfdFlags::CLOEXEC).expect("a memfd"));
        ftruncate(&file, BYTES).expect("a size");
        let mut reader = LogReader::new(&file).expect("mapped");
        let mut host = Mapping::new(&file, WORDS).expect("mapped");
        host.write(PUT, 0x8000_0000);
        assert_eq!(reader.next(), None);
        host.write(FIRST, 0x0100 | READ);
        host.write(PUT, 0x8000_0001);
        assert_eq!(reader.next(), Some(Entry::Read(0x0100)));
        assert_eq!(reader.next(), None);
    }
}
