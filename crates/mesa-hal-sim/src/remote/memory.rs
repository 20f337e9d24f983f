//! Memories of a remote: working memory, EEPROM, program flash.

use core::ops::Range;

use crate::wire::Nanos;
use mesa_wire::lbp::{LbpStatus, flash};

const SIZE: usize = 0x1_0000;

/// 64 KiB of working memory, part of it write-protected against the line.
#[derive(Clone, Debug)]
pub struct SimMemory {
    bytes: Box<[u8]>,
    protected: Range<u16>,
}

impl Default for SimMemory {
    fn default() -> Self {
        Self {
            bytes: vec![0; SIZE].into_boxed_slice(),
            protected: 0..0,
        }
    }
}

impl SimMemory {
    /// One byte.
    pub fn byte(&self, address: u16) -> u8 {
        self.bytes
            .get(usize::from(address))
            .copied()
            .unwrap_or_default()
    }

    /// Sets one byte, protected or not, as the remote's own program may do.
    pub fn set_byte(&mut self, address: u16, value: u8) {
        if let Some(byte) = self.bytes.get_mut(usize::from(address)) {
            *byte = value;
        }
    }

    /// Sets bytes from `address` on; wraps from FFFF to 0.
    pub fn load(&mut self, address: u16, data: &[u8]) {
        for (offset, &byte) in data.iter().enumerate() {
            self.set_byte(address.wrapping_add(offset as u16), byte);
        }
    }

    /// Up to 64 bits, least significant byte first.
    pub fn word(&self, address: u16, bytes: usize) -> u64 {
        (0..bytes.min(8)).fold(0, |word, offset| {
            let byte = self.byte(address.wrapping_add(offset as u16));
            word | u64::from(byte) << (8 * offset)
        })
    }

    /// Sets up to 64 bits, least significant byte first.
    pub fn set_word(&mut self, address: u16, bytes: usize, value: u64) {
        for (offset, byte) in value.to_le_bytes().into_iter().take(bytes).enumerate() {
            self.set_byte(address.wrapping_add(offset as u16), byte);
        }
    }

    /// Protects addresses against writes from the line.
    pub fn protect(&mut self, addresses: Range<u16>) {
        self.protected = addresses;
    }

    /// Writes a byte from the line; fails at a protected address.
    pub fn write_from_line(&mut self, address: u16, value: u8) -> Result<(), LbpStatus> {
        if self.protected.contains(&address) {
            return Err(LbpStatus::INVALID_ADDRESS);
        }
        self.set_byte(address, value);
        Ok(())
    }
}

/// The EEPROM: a write takes effect after the write time, and survives a power cycle.
#[derive(Clone, Debug)]
pub struct SimEeprom {
    bytes: SimMemory,
    write_time: Nanos,
    pending: [(u16, u8); 8],
    pending_len: usize,
    busy_until: Nanos,
    changes: u64,
}

impl SimEeprom {
    /// An EEPROM of zeros with a `write_time` for each access that writes.
    pub fn new(write_time: Nanos) -> Self {
        Self {
            bytes: SimMemory::default(),
            write_time,
            pending: [(0, 0); 8],
            pending_len: 0,
            busy_until: 0,
            changes: 0,
        }
    }

    /// The cells.
    pub const fn cells(&self) -> &SimMemory {
        &self.bytes
    }

    /// Number of writes from the line.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// Mutable access to the cells, for factory values.
    pub const fn cells_mut(&mut self) -> &mut SimMemory {
        &mut self.bytes
    }

    /// Completes a write that is due.
    pub fn advance(&mut self, now: Nanos) {
        if self.pending_len > 0 && now >= self.busy_until {
            for &(address, value) in self.pending.iter().take(self.pending_len) {
                self.bytes.set_byte(address, value);
            }
            self.pending_len = 0;
            self.changes += 1;
        }
    }

    /// End of the write in progress.
    pub fn busy_until(&self) -> Option<Nanos> {
        (self.pending_len > 0).then_some(self.busy_until)
    }

    /// Starts to write one byte of an access at `now`; the bytes of one access are written
    /// together. Returns the time of completion.
    pub fn write(&mut self, now: Nanos, address: u16, value: u8) -> Nanos {
        self.advance(now);
        if self.pending_len == 0 {
            self.busy_until = now + self.write_time;
        }
        if let Some(slot) = self.pending.get_mut(self.pending_len) {
            *slot = (address, value);
            self.pending_len += 1;
        }
        self.busy_until
    }

    /// Handles a power failure: a write in progress is lost.
    pub const fn power_off(&mut self) {
        self.pending_len = 0;
    }
}

/// The program flash behind the registers of FACTS 1.6.
///
/// Accesses below [`flash::OFFSET`] read the flash at the offset and write the page buffer.
#[derive(Clone, Debug)]
pub struct SimFlash {
    cells: Box<[u8]>,
    page: Box<[u8]>,
    offset: u32,
    log2_erase: u8,
    log2_write: u8,
    /// Contents of the affected block before the operation in progress, and its place.
    before: Box<[u8]>,
    under_way: Option<Range<usize>>,
    busy_until: Nanos,
    changes: u64,
    is_hidden: bool,
    repeats: bool,
    stuck: Option<usize>,
}

/// Duration of the erase of a flash block.
const ERASE_TIME: Nanos = 20_000_000;
/// Duration of the write of a page.
const PROGRAM_TIME: Nanos = 2_000_000;

impl SimFlash {
    /// An erased flash. Sizes are powers of two.
    pub fn new(size: usize, log2_erase: u8, log2_write: u8) -> Self {
        Self {
            cells: vec![0xFF; size].into_boxed_slice(),
            page: vec![0xFF; 1 << log2_write.min(15)].into_boxed_slice(),
            offset: 0,
            log2_erase: log2_erase.min(24),
            log2_write: log2_write.min(15),
            before: vec![0xFF; 1 << log2_erase.min(24).max(log2_write.min(15))].into_boxed_slice(),
            under_way: None,
            busy_until: 0,
            changes: 0,
            is_hidden: false,
            repeats: false,
            stuck: None,
        }
    }

    /// Hides the flash from reads of the line: the behaviour of real remotes is unknown.
    pub const fn hide(&mut self, hidden: bool) {
        self.is_hidden = hidden;
    }

    /// Makes the cells appear again behind their end, as where high address bits are not decoded.
    /// Otherwise an access behind the end has an invalid address: the behaviour of real remotes is
    /// unknown.
    pub const fn repeat(&mut self, repeats: bool) {
        self.repeats = repeats;
    }

    /// The cell at an offset.
    const fn at(&self, offset: usize) -> usize {
        if self.repeats {
            offset % self.cells.len()
        } else {
            offset
        }
    }

    /// Makes the cell at `offset` worn out from now on: it keeps its value.
    pub const fn stick(&mut self, offset: usize) {
        self.stuck = Some(offset);
    }

    /// Sets the cells from offset 0 on, like the factory.
    pub fn load(&mut self, data: &[u8]) {
        for (cell, &byte) in self.cells.iter_mut().zip(data) {
            *cell = byte;
        }
    }

    /// Handles a power failure at `now`: an erase or a write in progress affects half of its cells.
    pub fn power_off(&mut self, now: Nanos) {
        let under_way = self.under_way.take().filter(|_| now < self.busy_until);
        if let Some(block) = under_way.and_then(|range| self.cells.get_mut(range)) {
            let half = block.len() / 2;
            let cells = block.iter_mut().zip(&self.before).skip(half);
            cells.for_each(|(cell, before)| *cell = *before);
        }
        self.offset = 0;
    }

    /// The cells.
    pub const fn cells(&self) -> &[u8] {
        &self.cells
    }

    /// Number of erases and writes from the line.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// The byte that accesses read.
    pub fn read(&self, address: u16) -> Result<u8, LbpStatus> {
        let error = LbpStatus::INVALID_ADDRESS;
        match address {
            flash::LOG2_ERASE_SIZE => Ok(self.log2_erase),
            flash::LOG2_WRITE_SIZE => Ok(self.log2_write),
            flash::COMMIT => Ok(0),
            0..flash::OFFSET => {
                if self.is_hidden {
                    return Ok(0);
                }
                let at = self.at(self.offset as usize + usize::from(address));
                self.cells.get(at).copied().ok_or(error)
            }
            _ => {
                let byte = usize::from(address - flash::OFFSET);
                self.offset.to_le_bytes().get(byte).copied().ok_or(error)
            }
        }
    }

    /// Writes one byte by an access at `now`. Returns the time for which the remote is busy.
    pub fn write(&mut self, now: Nanos, address: u16, value: u8) -> Result<Nanos, LbpStatus> {
        let error = LbpStatus::INVALID_ADDRESS;
        match address {
            0..flash::OFFSET => {
                *self.page.get_mut(usize::from(address)).ok_or(error)? = value;
                Ok(0)
            }
            flash::COMMIT => self.commit(now, value).ok_or(error),
            _ => {
                let mut offset = self.offset.to_le_bytes();
                let byte = offset.get_mut(usize::from(address - flash::OFFSET));
                *byte.ok_or(error)? = value;
                self.offset = u32::from_le_bytes(offset);
                Ok(0)
            }
        }
    }

    fn commit(&mut self, now: Nanos, value: u8) -> Option<Nanos> {
        let (log2, time) = match value {
            flash::COMMIT_ERASE => (self.log2_erase, ERASE_TIME),
            flash::COMMIT_WRITE => (self.log2_write, PROGRAM_TIME),
            _ => return None,
        };
        let start = (self.at(self.offset as usize) >> log2) << log2;
        let range = start..start + (1 << log2);
        let block = self.cells.get_mut(range.clone())?;
        for (before, cell) in self.before.iter_mut().zip(block.iter()) {
            *before = *cell;
        }
        self.under_way = Some(range.clone());
        self.busy_until = now + time;
        self.changes += 1;
        let stuck = self.stuck.and_then(|at| Some((at, *self.cells.get(at)?)));
        let block = self.cells.get_mut(range)?;
        if value == flash::COMMIT_ERASE {
            block.fill(0xFF);
        } else {
            for (cell, byte) in block.iter_mut().zip(&self.page) {
                *cell &= byte;
            }
        }
        if let Some((at, value)) = stuck
            && let Some(cell) = self.cells.get_mut(at)
        {
            *cell = value;
        }
        Some(time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_cut_loses_an_unfinished_eeprom_write_only() {
        let mut eeprom = SimEeprom::new(4_000_000);
        assert_eq!(eeprom.write(0, 0x24, 100), 4_000_000);
        eeprom.advance(4_000_000);
        eeprom.write(5_000_000, 0x26, 7);
        eeprom.advance(8_999_999);
        eeprom.power_off();
        eeprom.advance(20_000_000);
        assert_eq!(eeprom.cells().byte(0x24), 100);
        assert_eq!(eeprom.cells().byte(0x26), 0);
    }

    #[test]
    fn flash_is_erased_and_written_through_its_registers() {
        let mut flash = SimFlash::new(0x1_0000, 12, 8);
        let set = |flash: &mut SimFlash, offset: u32| {
            for (at, byte) in (flash::OFFSET..).zip(offset.to_le_bytes()) {
                flash.write(0, at, byte).unwrap();
            }
        };
        set(&mut flash, 0x2100);
        flash.write(0, 3, 0x12).unwrap();
        assert!(flash.write(0, flash::COMMIT, flash::COMMIT_WRITE).unwrap() > 0);
        assert_eq!(flash.read(3), Ok(0x12));
        assert_eq!(flash.cells()[0x2103], 0x12);
        // Without an erase, bits can only change from 1 to 0.
        flash.write(0, 3, 0x21).unwrap();
        flash.write(0, flash::COMMIT, flash::COMMIT_WRITE).unwrap();
        assert_eq!(flash.cells()[0x2103], 0x00);
        flash.write(0, flash::COMMIT, flash::COMMIT_ERASE).unwrap();
        assert_eq!(flash.cells()[0x2103], 0xFF);
        assert!(flash.write(0, flash::COMMIT, 0x55).is_err());
        set(&mut flash, 0x10_0000);
        assert!(flash.write(0, flash::COMMIT, flash::COMMIT_ERASE).is_err());
    }

    #[test]
    fn power_cut_in_an_erase_leaves_half_of_the_block() {
        let mut flash = SimFlash::new(0x1000, 8, 4);
        flash.load(&[0; 0x1000]);
        let busy = flash
            .write(1_000, flash::COMMIT, flash::COMMIT_ERASE)
            .unwrap();
        flash.power_off(1_000 + busy - 1);
        assert_eq!(flash.cells()[..0x80], [0xFF; 0x80]);
        assert_eq!(flash.cells()[0x80..0x100], [0; 0x80]);
        let busy = flash.write(0, flash::COMMIT, flash::COMMIT_ERASE).unwrap();
        flash.power_off(busy);
        assert_eq!(flash.cells()[..0x100], [0xFF; 0x100]);
    }
}
