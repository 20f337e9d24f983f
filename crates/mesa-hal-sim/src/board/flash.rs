//! Space 3: the configuration flash, an M25P16 behind an address and a data register.

use crate::wire::Nanos;
use mesa_wire::lbp16::registers::flash::{ADDRESS, DATA, ID, PAGE, SECTOR, SECTOR_ERASE};

/// Bytes of an M25P16. Manual: 7I97, "EEPROM LAYOUT".
pub(super) const FLASH_SIZE: usize = 2 << 20;

/// Electronic signature of an M25P16.
const FLASH_ID: u32 = 0x14;

/// Typical times of an M25P16 for a page and for a sector.
pub(super) const PAGE_PROGRAM: Nanos = 640_000;
pub(super) const ERASE: Nanos = 600_000_000;

/// A refused access of the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FlashError {
    /// The register does not exist, or does not permit this access.
    NoRegister,
    /// A write without the write enable.
    NotEnabled,
}

/// The flash with its host registers. Manual: 7I97, "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS".
#[derive(Clone, Debug)]
pub(super) struct Flash {
    memory: Box<[u8]>,
    address: u32,
    page: Option<PageBuffer>,
    changes: u64,
}

/// A page that was sent to the chip but is not programmed yet.
#[derive(Clone, Copy, Debug)]
struct PageBuffer {
    base: usize,
    bytes: [u8; PAGE],
}

impl Flash {
    /// An erased flash.
    pub(super) fn new() -> Self {
        Self {
            memory: vec![0xFF; FLASH_SIZE].into_boxed_slice(),
            address: 0,
            page: None,
            changes: 0,
        }
    }

    /// The contents.
    pub(super) fn memory(&self) -> &[u8] {
        &self.memory
    }

    /// The contents, to restore them.
    pub(super) fn memory_mut(&mut self) -> &mut [u8] {
        &mut self.memory
    }

    /// Number of changes of the contents.
    pub(super) fn changes(&self) -> u64 {
        self.changes
    }

    /// Reads a register; returns its value and the time that the read takes.
    pub(super) fn read(&mut self, register: u16) -> Result<(u32, Nanos), FlashError> {
        match register {
            ADDRESS => {
                let time = self.program();
                Ok((self.address, time))
            }
            DATA => {
                let time = self.program();
                let at = (self.address as usize % FLASH_SIZE) & !3;
                let bytes = self.memory.get(at..at + 4).unwrap_or(&[]);
                let fold = |value, &byte: &u8| value << 8 | u32::from(byte);
                let value = bytes.iter().rev().fold(0, fold);
                self.address = self.address.wrapping_add(4);
                Ok((value, time))
            }
            ID => {
                let time = self.program();
                Ok((FLASH_ID, time))
            }
            _ => Err(FlashError::NoRegister),
        }
    }

    /// Writes a register; returns the time that the write takes.
    pub(super) fn write(
        &mut self,
        register: u16,
        value: u32,
        enabled: bool,
    ) -> Result<Nanos, FlashError> {
        match register {
            ADDRESS => {
                let time = self.program();
                self.address = value;
                Ok(time)
            }
            DATA if enabled => {
                self.buffer(value);
                Ok(0)
            }
            SECTOR_ERASE if enabled => {
                let time = self.program();
                self.erase_sector(self.address as usize % FLASH_SIZE);
                Ok(time + ERASE)
            }
            DATA | SECTOR_ERASE => Err(FlashError::NotEnabled),
            _ => Err(FlashError::NoRegister),
        }
    }

    /// Collects data for a page. The low eight address bits wrap within the page.
    fn buffer(&mut self, value: u32) {
        let address = self.address as usize % FLASH_SIZE;
        let page = self.page.get_or_insert(PageBuffer {
            base: address & !(PAGE - 1),
            bytes: [0xFF; PAGE],
        });
        for (index, byte) in value.to_le_bytes().into_iter().enumerate() {
            if let Some(slot) = page.bytes.get_mut((address + index) % PAGE) {
                *slot = byte;
            }
        }
        self.address = self.address.wrapping_add(4);
    }

    /// Programs the collected page: bits can only become 0.
    fn program(&mut self) -> Nanos {
        let Some(page) = self.page.take() else {
            return 0;
        };
        self.program_page(page.base, &page.bytes);
        PAGE_PROGRAM
    }

    /// Programs bytes of a page that begins at `base`: bits can only become 0.
    pub(super) fn program_page(&mut self, base: usize, bytes: &[u8; PAGE]) {
        let cells = self.memory.get_mut(base..base + PAGE);
        for (cell, byte) in cells.unwrap_or_default().iter_mut().zip(bytes) {
            *cell &= byte;
        }
        self.changes += 1;
    }

    /// Erases the sector around an address.
    pub(super) fn erase_sector(&mut self, address: usize) {
        let start = address & !(SECTOR - 1);
        let sector = self.memory.get_mut(start..start + SECTOR);
        sector.unwrap_or_default().fill(0xFF);
        self.changes += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write_page(flash: &mut Flash, address: u32, words: &[u32]) {
        flash.write(ADDRESS, address, false).unwrap();
        for &word in words {
            flash.write(DATA, word, true).unwrap();
        }
        flash.read(ADDRESS).unwrap();
    }

    #[test]
    fn programming_only_clears_bits_and_erasing_sets_a_whole_sector() {
        let mut flash = Flash::new();
        write_page(&mut flash, 0x1_0000, &[0x1234_5678]);
        write_page(&mut flash, 0x1_0000, &[0xFFFF_0FFF]);
        assert_eq!(flash.memory()[0x1_0000..0x1_0004], [0x78, 0x06, 0x34, 0x12]);
        write_page(&mut flash, 0x1_FF00, &[0]);
        write_page(&mut flash, 0x2_0000, &[0]);
        flash.write(ADDRESS, 0x1_2345, false).unwrap();
        assert_eq!(flash.write(SECTOR_ERASE, 0, true), Ok(ERASE));
        assert!(
            flash.memory()[0x1_0000..0x2_0000]
                .iter()
                .all(|&b| b == 0xFF)
        );
        assert_eq!(flash.memory()[0x2_0000..0x2_0004], [0; 4]);
    }

    #[test]
    fn page_is_programmed_by_each_of_the_accesses_the_manual_lists() {
        let commits: [fn(&mut Flash) -> bool; 5] = [
            |flash| flash.write(ADDRESS, 0, false).is_ok(),
            |flash| flash.read(ADDRESS).is_ok(),
            |flash| flash.read(DATA).is_ok(),
            |flash| flash.read(ID).is_ok(),
            |flash| flash.write(SECTOR_ERASE, 0, true).is_ok(),
        ];
        for commit in commits {
            let mut flash = Flash::new();
            flash.write(ADDRESS, 0x1F_FFFC, false).unwrap();
            flash.write(DATA, 0, true).unwrap();
            assert_eq!(flash.memory()[0x1F_FFFC], 0xFF, "not yet");
            // Outside the page, so that the erase does not affect it.
            flash.address = 0;
            assert!(commit(&mut flash));
            assert_eq!(flash.memory()[0x1F_FFFC], 0);
        }
    }

    #[test]
    fn address_moves_on_by_4_with_each_data_access() {
        let mut flash = Flash::new();
        flash.write(ADDRESS, 0x100, false).unwrap();
        for _ in 0..64 {
            flash.write(DATA, 0x55AA_55AA, true).unwrap();
        }
        assert_eq!(flash.read(ADDRESS), Ok((0x200, PAGE_PROGRAM)));
        assert_eq!(flash.read(ADDRESS), Ok((0x200, 0)));
        flash.write(ADDRESS, 0x1FC, false).unwrap();
        assert_eq!(flash.read(DATA), Ok((0x55AA_55AA, 0)));
        assert_eq!(flash.read(DATA), Ok((u32::MAX, 0)));
        assert_eq!(flash.read(ADDRESS), Ok((0x204, 0)));
    }

    #[test]
    fn data_past_the_end_of_a_page_wraps_within_it() {
        let mut flash = Flash::new();
        write_page(&mut flash, 0x1F8, &[1, 2, 3]);
        assert_eq!(flash.memory()[0x100..0x104], [3, 0, 0, 0]);
        assert_eq!(flash.memory()[0x200..0x204], [0xFF; 4]);
    }

    #[test]
    fn flash_is_unchanged_without_the_write_enable() {
        let mut flash = Flash::new();
        assert_eq!(flash.write(DATA, 0, false), Err(FlashError::NotEnabled));
        let erase = flash.write(SECTOR_ERASE, 0, false);
        assert_eq!(erase, Err(FlashError::NotEnabled));
        assert_eq!(flash.read(ADDRESS), Ok((0, 0)));
        assert_eq!(flash.changes(), 0);
        assert_eq!(flash.read(SECTOR_ERASE), Err(FlashError::NoRegister));
        assert_eq!(flash.write(ID, 0, true), Err(FlashError::NoRegister));
        assert_eq!(flash.read(ID), Ok((0x14, 0)));
    }
}
