//! A board on the PCI bus: the registers of its FPGA, among them those of the flash memory.
//!
//! The chip hangs on a shift register of the FPGA: 0x70 selects it (bit 0 is 1 while it is not
//! selected), and shows with bit 2 that a byte is complete; a byte that is written to 0x74 is
//! shifted out while one is shifted in. Source: what mesaflash writes and reads (FACTS 15.2). The
//! time of a byte is not confirmed.

use core::time::Duration;

use super::flash::{ERASE, PAGE_PROGRAM};
use super::{Flash, Gateware, SimBoard};
use crate::fpga::SimFpga;
use crate::wire::Nanos;
use mesa_wire::bus::{Access, BusError, BusStatistics, Clock, Direction, Instant, RegisterBus};
use mesa_wire::lbp16::registers::flash::PAGE;

/// Register that selects the chip, and shows that a byte is complete.
const SPI_CONTROL: u16 = 0x0070;
/// Register of the byte.
const SPI_DATA: u16 = 0x0074;
/// Written to [`SPI_CONTROL`]: the chip is not selected.
const NOT_SELECTED: u32 = 1;
/// Read from [`SPI_CONTROL`]: a byte is complete.
const COMPLETE: u32 = 1 << 2;

/// Time of a byte on the way to the chip.
const BYTE: Nanos = 1000;
/// Bytes of the chip of a 5I25, an M25P80. FACTS 15.3.
const SIZE: usize = 1 << 20;
/// Its electronic signature.
const SIGNATURE: u8 = 0x13;

/// Commands of the chip, and the bit of its status for a change that goes on.
const WRITE_PAGE: u8 = 0x02;
const READ: u8 = 0x03;
const READ_STATUS: u8 = 0x05;
const ENABLE_WRITE: u8 = 0x06;
const READ_SIGNATURE: u8 = 0xAB;
const ERASE_SECTOR: u8 = 0xD8;
const IS_BUSY: u8 = 1 << 0;
const IS_ENABLED: u8 = 1 << 1;

/// The chip with its shift register.
#[derive(Clone, Debug)]
pub(super) struct Spi {
    is_selected: bool,
    /// Command of this selection; `None` before its first byte, and if the chip ignores it.
    command: Option<u8>,
    /// Bytes of this selection.
    count: u32,
    address: usize,
    page: [u8; PAGE],
    is_enabled: bool,
    /// Byte that was shifted in.
    shifted: u8,
    complete_at: Nanos,
    busy_until: Nanos,
}

impl Default for Spi {
    fn default() -> Self {
        Self {
            is_selected: false,
            command: None,
            count: 0,
            address: 0,
            page: [0xFF; PAGE],
            is_enabled: false,
            shifted: 0xFF,
            complete_at: 0,
            busy_until: 0,
        }
    }
}

impl Spi {
    fn control(&self, now: Nanos) -> u32 {
        let complete = if now < self.complete_at { 0 } else { COMPLETE };
        complete | u32::from(!self.is_selected)
    }

    fn select(&mut self, now: Nanos, flash: &mut Flash, is_selected: bool) {
        if self.is_selected && !is_selected {
            self.execute(now, flash);
        }
        if self.is_selected != is_selected {
            (self.command, self.count) = (None, 0);
            self.page = [0xFF; PAGE];
        }
        self.is_selected = is_selected;
    }

    /// Executes a change, which begins when the chip is no longer selected.
    fn execute(&mut self, now: Nanos, flash: &mut Flash) {
        let has_address = self.count >= 4;
        let time = match self.command {
            Some(ENABLE_WRITE) => {
                self.is_enabled = true;
                return;
            }
            Some(WRITE_PAGE) if self.is_enabled && self.count > 4 => {
                flash.program_page(self.address & !(PAGE - 1), &self.page);
                PAGE_PROGRAM
            }
            Some(ERASE_SECTOR) if self.is_enabled && has_address => {
                flash.erase_sector(self.address);
                ERASE
            }
            _ => return,
        };
        self.is_enabled = false;
        self.busy_until = now + time;
    }

    fn shift(&mut self, now: Nanos, flash: &Flash, byte: u8) {
        if !self.is_selected || now < self.complete_at {
            return;
        }
        self.complete_at = now + BYTE;
        let is_busy = now < self.busy_until;
        self.shifted = 0xFF;
        match self.count {
            0 => self.command = Some(byte).filter(|&byte| !is_busy || byte == READ_STATUS),
            1..=3 => self.address = (self.address << 8 | usize::from(byte)) % SIZE,
            _ => {}
        }
        match self.command {
            Some(READ_STATUS) if self.count > 0 => {
                let enabled = if self.is_enabled { IS_ENABLED } else { 0 };
                self.shifted = enabled | if is_busy { IS_BUSY } else { 0 };
            }
            Some(READ_SIGNATURE) if self.count > 3 => self.shifted = SIGNATURE,
            Some(READ) if self.count > 3 => {
                let cell = flash.memory().get(self.address);
                self.shifted = cell.copied().unwrap_or(0xFF);
                self.address = (self.address + 1) % SIZE;
            }
            Some(WRITE_PAGE) if self.count > 3 => {
                // Addresses wrap within the page.
                let at = (self.address + self.count as usize - 4) % PAGE;
                if let Some(cell) = self.page.get_mut(at) {
                    *cell = byte;
                }
            }
            _ => {}
        }
        self.count = self.count.saturating_add(1);
    }
}

impl<G: Gateware> SimBoard<G> {
    /// Reads the register at a byte address, on the PCI bus, at the time reached.
    pub fn read_on_pci(&mut self, address: u16) -> u32 {
        match address {
            _ if self.gateware.is_in_reset() => u32::MAX,
            SPI_CONTROL => self.spi.control(self.time),
            SPI_DATA => u32::from(self.spi.shifted),
            _ => self.gateware.read_register(address),
        }
    }

    /// Writes the register at a byte address, on the PCI bus, at the time reached.
    pub fn write_on_pci(&mut self, address: u16, value: u32) {
        let now = self.time;
        match address {
            _ if self.gateware.is_in_reset() => {}
            SPI_CONTROL => {
                let is_selected = value & NOT_SELECTED == 0;
                self.spi.select(now, &mut self.flash, is_selected);
            }
            SPI_DATA => self.spi.shift(now, &self.flash, value as u8),
            _ => self.gateware.write_register(address, value),
        }
    }
}

/// A simulated board on the PCI bus, on virtual time: each access takes 600 ns. The FPGA's
/// registers, with those of the flash memory.
#[derive(Debug)]
pub struct SimPciBus {
    /// The board; its Ethernet side has no function.
    pub board: SimBoard<SimFpga>,
    exchanges: u64,
}

impl SimPciBus {
    /// The bus with a board at its end.
    pub const fn new(board: SimBoard<SimFpga>) -> Self {
        Self {
            board,
            exchanges: 0,
        }
    }
}

impl RegisterBus for SimPciBus {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        accesses
            .iter()
            .try_for_each(|access| access.check(words.len()))?;
        self.exchanges += 1;
        for access in accesses {
            let words = words.get_mut(access.words()).unwrap_or_default();
            for (index, word) in words.iter_mut().enumerate() {
                let at = self.board.time() + crate::DEFAULT_ACCESS_COST;
                self.board.advance_to(at);
                let address = access.address.wrapping_add(4 * index as u16);
                match access.direction {
                    Direction::Read => *word = self.board.read_on_pci(address),
                    Direction::Write => self.board.write_on_pci(address, *word),
                }
            }
        }
        Ok(())
    }

    fn statistics(&self) -> BusStatistics {
        BusStatistics::of_exchanges(self.exchanges)
    }
}

impl Clock for SimPciBus {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.board.time())
    }

    fn wait(&mut self, duration: Duration) {
        let nanos = Instant::from_nanos(self.board.time()).after(duration);
        self.board.advance_to(nanos.as_nanos());
    }
}
