//! The flash chip of a board, behind its network side or behind registers.

use std::time::Duration;

use mesa_hal::ethernet::{EthernetBoard, EthernetError, FlashChange, FlashChip, SpiFlash};

use crate::board::bus::Bus;

/// The flash chip of a board.
#[derive(Debug)]
pub enum BoardChip<'a> {
    /// Of a board on Ethernet.
    Ethernet(EthernetBoard<'a, Bus>),
    /// Of a board on the PCI bus.
    Pci(SpiFlash<'a, Bus>),
}

impl<'a> BoardChip<'a> {
    /// The chip of the board behind a bus.
    pub fn of(bus: &'a mut Bus) -> Self {
        if bus.is_on_ethernet() {
            Self::Ethernet(EthernetBoard::new(bus))
        } else {
            Self::Pci(SpiFlash::new(bus))
        }
    }
}

impl FlashChip for BoardChip<'_> {
    fn id(&mut self) -> Result<u32, EthernetError> {
        match self {
            Self::Ethernet(chip) => chip.id(),
            Self::Pci(chip) => chip.id(),
        }
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError> {
        match self {
            Self::Ethernet(chip) => chip.read(address, bytes),
            Self::Pci(chip) => chip.read(address, bytes),
        }
    }

    fn change(
        &mut self,
        address: u32,
        change: FlashChange<'_>,
        deadline: Duration,
    ) -> Result<(), EthernetError> {
        match self {
            Self::Ethernet(chip) => chip.change(address, change, deadline),
            Self::Pci(chip) => chip.change(address, change, deadline),
        }
    }
}
