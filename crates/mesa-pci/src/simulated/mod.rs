//! Simulated boards: a folder like sysfs's, and a simulator in another thread or process.
//!
//! [`SimulatedDevice`] makes the folder. Its `resource0` is a file that both sides map, so that
//! [`PciBus`](crate::PciBus) makes the same loads and stores as on a board. Memory alone cannot be
//! a board: it shows neither that a word was read, nor a write of the value that is already there,
//! nor the order of writes. So the folder has a second file, the log, which the bus maps as well if
//! it is there: each store is noted in it, and each load is announced and waits until the simulator
//! has put the word into the memory. A real board has no such file, and the bus then does nothing
//! but loads and stores.
//!
//! # What a simulated board does not show
//!
//! - The time of an access. A list that reads takes the time in which the system switches to the
//!   simulator and back, some 10 us, and not about 1 us for each register.
//! - Posted writes. A write is executed when the simulator looks, within 1 ms, or with the next
//!   read; on a real bus it has usually arrived within 1 us. The order is the same.
//! - The bus itself: bridges, other devices' traffic, parity errors, a stuck bus. Loads never fail.
//! - Programs that know nothing of the log: they see the registers as they were read last, and
//!   their writes have no effect. They can look at the identification.
//! - The rights of a real `resource0`, and the kernel's refusal to map it (`lockdown`, an exclusive
//!   driver).

mod log;
mod tree;

pub(crate) use log::{LOG_FILE, Log};

use core::time::Duration;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use mesa_wire::bus::HostClock;

use crate::mapping::Mapping;
use crate::{BoardKind, PciAddress, REGISTERS};
use log::{Entry, LogReader};

/// The registers of a simulated board.
pub trait SimulatedRegisters {
    /// Advances to a time, in nanoseconds since the device was made.
    fn advance_to(&mut self, nanos: u64);

    /// Reads the register at a byte address, with its side effects.
    fn read(&mut self, address: u16) -> u32;

    /// Writes the register at a byte address.
    fn write(&mut self, address: u16, value: u32);
}

/// A board in a folder like sysfs's, and the simulator's side of it.
///
/// The folder of the board is removed when the value is dropped. A folder that was left behind by a
/// simulator that was killed is made anew.
#[derive(Debug)]
pub struct SimulatedDevice {
    registers: Mapping,
    log: LogReader,
    clock: HostClock,
    folder: PathBuf,
    is_unplugged: bool,
    _lock: File,
}

impl SimulatedDevice {
    /// Makes a board at an address below `root`, which is made if it is not there.
    ///
    /// # Errors
    /// The folder cannot be made, or another simulator has this address there
    /// ([`io::ErrorKind::AlreadyExists`]).
    pub fn new(root: &Path, address: PciAddress, kind: BoardKind) -> io::Result<Self> {
        let folder = tree::folder(root, address);
        let lock = tree::lock(&folder)?;
        tree::make(root, &folder, address, kind)?;
        let file = File::options()
            .read(true)
            .write(true)
            .open(folder.join("resource0"))?;
        let registers = Mapping::new(&file, REGISTERS / 4)?;
        let log = LogReader::new(&lock)?;
        Ok(Self {
            registers,
            log,
            clock: HostClock::new(),
            folder,
            is_unplugged: false,
            _lock: lock,
        })
    }

    /// Folder of the board.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Time of the device, in nanoseconds since it was made.
    pub fn now(&self) -> u64 {
        self.clock.read().as_nanos()
    }

    /// Puts the identification into the memory, for programs that know nothing of the log.
    pub fn show(&mut self, board: &mut impl SimulatedRegisters) {
        for address in (0x0100..0x0110).chain(0x0400..0x0800).step_by(4) {
            let word = self.word(board, address);
            self.registers.write(usize::from(address / 4), word);
        }
    }

    /// Executes all accesses so far, and waits for `limit` at most if there were none. Returns
    /// their number.
    pub fn step(&mut self, board: &mut impl SimulatedRegisters, limit: Duration) -> u32 {
        board.advance_to(self.now());
        let mut done = 0;
        while let Some(entry) = self.log.next() {
            match entry {
                Entry::Read(address) => {
                    let word = self.word(board, address);
                    self.registers.write(usize::from(address / 4), word);
                }
                Entry::Write(address, word) if !self.is_unplugged => board.write(address, word),
                Entry::Write(..) => {}
            }
            done += 1;
        }
        if done > 0 {
            self.log.answer();
        } else {
            self.log.wait(limit);
        }
        done
    }

    /// Takes the board from the bus, or puts it back: all registers read as all ones meanwhile, and
    /// writes have no effect.
    pub fn set_unplugged(&mut self, is_unplugged: bool) {
        self.is_unplugged = is_unplugged;
    }

    fn word(&self, board: &mut impl SimulatedRegisters, address: u16) -> u32 {
        if self.is_unplugged {
            u32::MAX
        } else {
            board.read(address)
        }
    }
}

impl Drop for SimulatedDevice {
    fn drop(&mut self) {
        // What cannot be removed is made anew by the next simulator.
        let _ = tree::remove(&self.folder);
    }
}
