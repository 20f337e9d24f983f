//! Access to a flash chip: through the network side of an Ethernet board.

use core::time::Duration;

use crate::ethernet::packets::QUICK;
use crate::ethernet::{EthernetBoard, EthernetError, Lbp16Board};
use crate::lbp16::registers::flash::{self, PAGE};
use crate::lbp16::registers::{self, control};
use crate::lbp16::{Command, Space};
use registers::flash::SECTOR_ERASE;

/// Bytes read by one command, as in the manual's examples.
const BLOCK: usize = 256;
/// Bytes read by one packet.
const PACKET: usize = 4 * BLOCK;

/// A change of a chip, at an address.
#[derive(Clone, Copy, Debug)]
pub enum FlashChange<'a> {
    /// Erases the sector that begins at the address.
    EraseSector,
    /// Writes an erased page.
    WritePage(&'a [u8; PAGE]),
}

/// The way to a flash chip, for [`Flash`](super::Flash): an [`EthernetBoard`], or the registers of
/// a board on the PCI bus ([`SpiFlash`](super::SpiFlash)).
pub trait FlashChip {
    /// The electronic signature of the chip, in the lowest byte.
    ///
    /// # Errors
    /// Errors of the way.
    fn id(&mut self) -> Result<u32, EthernetError>;

    /// Reads bytes from any address, within the chip.
    ///
    /// # Errors
    /// Errors of the way.
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError>;

    /// Erases or writes, and waits until it is done, for `deadline` at most.
    ///
    /// # Errors
    /// Errors of the way, and a chip that is still busy after the deadline.
    fn change(
        &mut self,
        address: u32,
        change: FlashChange<'_>,
        deadline: Duration,
    ) -> Result<(), EthernetError>;
}

impl<B: Lbp16Board> FlashChip for EthernetBoard<'_, B> {
    fn id(&mut self) -> Result<u32, EthernetError> {
        let mut id = [0; 4];
        self.run(&mut id, QUICK, |request| {
            request.read(Space::Flash, flash::ID, 1)
        })?;
        Ok(u32::from_le_bytes(id))
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError> {
        for (part, at) in bytes.chunks_mut(PACKET).zip((address..).step_by(PACKET)) {
            // Addresses and sizes of the memory are multiples of 4; those of the request need not
            // be.
            let skip = at % 4;
            let wanted = part.len().saturating_add(skip as usize);
            let wanted = wanted.next_multiple_of(4);
            let mut buffer = [0; PACKET + 4];
            let reply = buffer.get_mut(..wanted).unwrap_or_default();
            debug_assert_eq!(reply.len(), wanted, "a part fits the buffer");
            self.run(reply, QUICK, |request| {
                let start = at.saturating_sub(skip).to_le_bytes();
                request.write(Space::Flash, flash::ADDRESS, &start)?;
                for done in (0..wanted).step_by(BLOCK) {
                    let count = wanted.saturating_sub(done).min(BLOCK) / 4;
                    let read = Command::read(Space::Flash, count as u8).standing();
                    request.command(read, flash::DATA, &[])?;
                }
                Ok(())
            })?;
            for (target, byte) in part.iter_mut().zip(reply.iter().skip(skip as usize)) {
                *target = *byte;
            }
        }
        Ok(())
    }

    fn change(
        &mut self,
        address: u32,
        change: FlashChange<'_>,
        deadline: Duration,
    ) -> Result<(), EthernetError> {
        let mut echo = [0; 4];
        self.run(&mut echo, deadline, |request| {
            // Cleared at the end of every packet, so it is part of each packet that writes.
            let enable = control::ENABLE_FLASH.to_le_bytes();
            request.write(Space::Control, control::WRITE_ENABLE, &enable)?;
            request.write(Space::Flash, flash::ADDRESS, &address.to_le_bytes())?;
            match change {
                FlashChange::EraseSector => {
                    request.write(Space::Flash, SECTOR_ERASE, &[0; 4])?;
                }
                FlashChange::WritePage(page) => {
                    let write = Command::write(Space::Flash, (PAGE / 4) as u8).standing();
                    request.command(write, flash::DATA, page)?;
                }
            }
            // Reading the address starts the write of a page, and waits for the end of any
            // operation.
            request.read(Space::Flash, flash::ADDRESS, 1)
        })
    }
}
