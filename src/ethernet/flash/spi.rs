//! Access to a flash chip through registers of the FPGA, on boards without a network side.

use core::time::Duration;

use super::{FlashChange, FlashChip};
use crate::bus::{Access, Clock, RegisterBus};
use crate::ethernet::EthernetError;

/// Register that selects the chip, and shows when a byte is complete. FACTS 15.2.
const CONTROL: u16 = 0x0070;
/// Register of a byte to and from the chip.
const DATA: u16 = 0x0074;
/// Written to [`CONTROL`]: the chip is not selected, and executes the command before.
const NOT_SELECTED: u32 = 1;
const SELECTED: u32 = 0;
/// Read from [`CONTROL`]: a byte is complete.
const COMPLETE: u32 = 1 << 2;
/// Number of looks for a byte to be complete, as mesaflash has it: 3 ms at least.
const LOOKS: u32 = 5000;

/// Commands of the chip.
const WRITE_PAGE: u8 = 0x02;
const READ: u8 = 0x03;
const READ_STATUS: u8 = 0x05;
const ENABLE_WRITE: u8 = 0x06;
const READ_SIGNATURE: u8 = 0xAB;
const ERASE_SECTOR: u8 = 0xD8;
/// Bit of the status: a change goes on.
const IS_BUSY: u8 = 1;

/// The flash chip of a board on the PCI bus, behind two registers of its FPGA.
///
/// The accesses are those of mesaflash. Each byte takes three of them, two of which read: about 2
/// us on the bus, and what the chip needs.
#[derive(Debug)]
pub struct SpiFlash<'a, B> {
    bus: &'a mut B,
}

impl<'a, B: RegisterBus + Clock> SpiFlash<'a, B> {
    /// The chip behind a bus. Nothing is accessed.
    pub fn new(bus: &'a mut B) -> Self {
        Self { bus }
    }

    /// Sends a command, `data` after it, and fills `reply` with what follows.
    fn command(
        &mut self,
        command: u8,
        address: Option<u32>,
        data: &[u8],
        reply: &mut [u8],
    ) -> Result<(), EthernetError> {
        self.select(NOT_SELECTED)?;
        self.select(SELECTED)?;
        self.send(command)?;
        if let Some(address) = address {
            let [_, high, middle, low] = address.to_be_bytes();
            for byte in [high, middle, low] {
                self.send(byte)?;
            }
        }
        for &byte in data {
            self.send(byte)?;
        }
        for byte in reply {
            self.send(0)?;
            *byte = self.bus.read(DATA).map_err(EthernetError::Bus)? as u8;
        }
        self.select(NOT_SELECTED)
    }

    fn select(&mut self, value: u32) -> Result<(), EthernetError> {
        self.bus.write(CONTROL, value).map_err(EthernetError::Bus)
    }

    /// Sends a byte, and waits until it is complete.
    fn send(&mut self, byte: u8) -> Result<(), EthernetError> {
        let list = [Access::write(DATA, 0, 1), Access::read(CONTROL, 1, 1)];
        let mut words = [u32::from(byte), 0];
        let sent = self.bus.exchange(&list, &mut words);
        sent.map_err(EthernetError::Bus)?;
        let [_, mut control] = words;
        for _ in 0..LOOKS {
            if control & COMPLETE != 0 {
                return Ok(());
            }
            control = self.bus.read(CONTROL).map_err(EthernetError::Bus)?;
        }
        Err(EthernetError::ChipSilent { control })
    }

    fn status(&mut self) -> Result<u8, EthernetError> {
        let mut status = [0];
        self.command(READ_STATUS, None, &[], &mut status)?;
        let [status] = status;
        Ok(status)
    }
}

impl<B: RegisterBus + Clock> FlashChip for SpiFlash<'_, B> {
    fn id(&mut self) -> Result<u32, EthernetError> {
        let mut id = [0];
        self.command(READ_SIGNATURE, Some(0), &[], &mut id)?;
        let [id] = id;
        Ok(id.into())
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError> {
        self.command(READ, Some(address), &[], bytes)
    }

    fn change(
        &mut self,
        address: u32,
        change: FlashChange<'_>,
        deadline: Duration,
    ) -> Result<(), EthernetError> {
        self.command(ENABLE_WRITE, None, &[], &mut [])?;
        match change {
            FlashChange::EraseSector => self.command(ERASE_SECTOR, Some(address), &[], &mut [])?,
            FlashChange::WritePage(page) => {
                self.command(WRITE_PAGE, Some(address), page, &mut [])?;
            }
        }
        let until = self.bus.now().after(deadline);
        while self.status()? & IS_BUSY != 0 {
            if self.bus.now() >= until {
                return Err(EthernetError::ChipBusy { waited: deadline });
            }
        }
        Ok(())
    }
}
