//! The flash memory that holds the FPGA's configurations, and what may be written where.

use core::ops::Range;

use super::{Bitfile, EthernetError};
use crate::boards::FlashLayout;

/// One page: what is written at once.
pub const PAGE: usize = 256;
/// One sector: what is erased at once.
pub const SECTOR: u32 = 0x1_0000;

/// A flash memory, as a board gives access to it.
pub trait FlashMemory {
    /// What can go wrong on the way to it.
    type Error;

    /// The chip's identification.
    fn id(&mut self) -> Result<u32, EthernetError<Self::Error>>;

    /// Reads from `address` on.
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError<Self::Error>>;

    /// Erases the sector that begins at `address` to FF, and waits until it is.
    fn erase_sector(&mut self, address: u32) -> Result<(), EthernetError<Self::Error>>;

    /// Writes the page that begins at `address`, and waits until it is.
    fn write_page(
        &mut self,
        address: u32,
        page: &[u8; PAGE],
    ) -> Result<(), EthernetError<Self::Error>>;
}

impl FlashLayout {
    /// The addresses of an area.
    pub fn addresses(&self, area: Area) -> Range<u32> {
        let (start, end) = match area {
            Area::BootBlock => self.boot_block,
            Area::Fallback => self.fallback,
            Area::User => self.user,
            Area::Application => self.application,
            Area::Whole => (0, self.size),
        };
        start..end
    }
}

/// What somebody wants to write; naming it is the only way to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Area {
    /// The boot block: a mistake here needs a JTAG programmer to mend.
    BootBlock,
    /// The fallback configuration: the way back when the user configuration is damaged.
    Fallback,
    /// The user configuration: what new firmware is written to.
    User,
    /// The last two sectors, which configurations never use.
    Application,
    /// Everything, to restore a backup of the whole chip.
    Whole,
}

/// What is being done, for a progress display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Sectors are being erased.
    Erase,
    /// Pages are being written.
    Write,
    /// What was written is being read back.
    Verify,
}

/// The flash memory of a board, guarded by its layout.
#[derive(Debug)]
pub struct Flash<M> {
    memory: M,
    layout: FlashLayout,
}

impl<M: FlashMemory> Flash<M> {
    /// The memory behind a board, after checking that it is the chip that the layout is for.
    pub fn open(mut memory: M, layout: FlashLayout) -> Result<Self, EthernetError<M::Error>> {
        let found = memory.id()?;
        if found != layout.id {
            return Err(EthernetError::WrongChip {
                found,
                expected: layout.id,
            });
        }
        Ok(Self { memory, layout })
    }

    /// The chip's identification.
    pub fn id(&mut self) -> Result<u32, EthernetError<M::Error>> {
        self.memory.id()
    }

    /// Reads from anywhere.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError<M::Error>> {
        self.inside(address, bytes.len(), Area::Whole)?;
        self.memory.read(address, bytes)
    }

    /// Writes a configuration into the user or the fallback area, and verifies it.
    ///
    /// The file is checked before anything is erased, also whether it is for this board
    /// ([`Bitfile::check`]). The FPGA needs one of the two configurations to start: the fallback is
    /// refused while there is no boot block, or no user configuration.
    pub fn program(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        progress: impl FnMut(Stage, usize),
    ) -> Result<(), EthernetError<M::Error>> {
        if !matches!(area, Area::User | Area::Fallback) {
            return Err(EthernetError::NotForConfigurations { area });
        }
        let FlashLayout { board, part, .. } = self.layout;
        let range = self.layout.addresses(area);
        bitfile.check(board, part, range.len())?;
        self.need_boot_block()?;
        if area == Area::Fallback {
            self.need_user_configuration()?;
        }
        self.write(area, range.start, bitfile.configuration, progress)
    }

    /// Compares an area with a configuration.
    pub fn verify(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        mut progress: impl FnMut(Stage, usize),
    ) -> Result<(), EthernetError<M::Error>> {
        let start = self.layout.addresses(area).start;
        self.inside(start, bitfile.configuration.len(), area)?;
        self.compare(start, bitfile.configuration, &mut progress)
    }

    /// Erases what `data` needs, writes it, and verifies it. `address` begins a sector.
    ///
    /// Sectors are erased as a whole, also behind the end of `data`. [`Area::Whole`] takes all of
    /// the chip, and nothing less. The first page is written last: a configuration that was not
    /// written to its end has no beginning, and the FPGA does not try to load it.
    ///
    /// `progress` is told how many bytes of the stage are done.
    pub fn write(
        &mut self,
        area: Area,
        address: u32,
        data: &[u8],
        mut progress: impl FnMut(Stage, usize),
    ) -> Result<(), EthernetError<M::Error>> {
        self.may_write(area, address, data.len())?;
        let end = address + data.len() as u32;
        for sector in (address..end).step_by(SECTOR as usize) {
            self.memory.erase_sector(sector)?;
            progress(Stage::Erase, (sector + SECTOR - address) as usize);
        }
        let mut written = 0;
        let pages = || (address..end).step_by(PAGE).zip(data.chunks(PAGE));
        for (at, chunk) in pages().skip(1).chain(pages().take(1)) {
            self.write_page(at, chunk)?;
            written += chunk.len();
            progress(Stage::Write, written);
        }
        self.compare(address, data, &mut progress)
    }

    fn write_page(&mut self, at: u32, chunk: &[u8]) -> Result<(), EthernetError<M::Error>> {
        let mut page = [0xFF; PAGE];
        for (target, byte) in page.iter_mut().zip(chunk) {
            *target = *byte;
        }
        // An erased page is all FF already.
        if page != [0xFF; PAGE] {
            self.memory.write_page(at, &page)?;
        }
        Ok(())
    }

    /// Gives the memory back.
    pub fn into_inner(self) -> M {
        self.memory
    }

    fn may_write(
        &self,
        area: Area,
        address: u32,
        bytes: usize,
    ) -> Result<(), EthernetError<M::Error>> {
        self.inside(address, bytes, area)?;
        let size = self.layout.size;
        if area == Area::Whole && bytes != size as usize {
            return Err(EthernetError::NotWhole {
                address,
                bytes,
                size,
            });
        }
        let within = address % SECTOR;
        if within != 0 {
            return Err(EthernetError::NotASector {
                address,
                sector: address - within,
            });
        }
        Ok(())
    }

    fn inside(
        &self,
        address: u32,
        bytes: usize,
        area: Area,
    ) -> Result<(), EthernetError<M::Error>> {
        let range = self.layout.addresses(area);
        let end = u64::from(address) + bytes as u64;
        if range.start <= address && end <= u64::from(range.end) {
            return Ok(());
        }
        Err(EthernetError::OutsideArea {
            address,
            bytes,
            area,
            start: range.start,
            end: range.end,
        })
    }

    fn need_boot_block(&mut self) -> Result<(), EthernetError<M::Error>> {
        let address = self.layout.boot_block.0;
        let mut head = [0xFF; PAGE];
        self.memory.read(address, &mut head)?;
        if head == [0xFF; PAGE] {
            return Err(EthernetError::NoBootBlock { address });
        }
        Ok(())
    }

    /// Whether a configuration begins in the user area; see [`write`](Self::write) for why that is
    /// enough.
    fn need_user_configuration(&mut self) -> Result<(), EthernetError<M::Error>> {
        let address = self.layout.user.0;
        let mut head = [0; Bitfile::SYNC_WITHIN];
        self.memory.read(address, &mut head)?;
        if Bitfile::has_sync(&head) {
            return Ok(());
        }
        Err(EthernetError::NoUserConfiguration { address })
    }

    fn compare(
        &mut self,
        start: u32,
        data: &[u8],
        progress: &mut impl FnMut(Stage, usize),
    ) -> Result<(), EthernetError<M::Error>> {
        const BLOCK: usize = 4 * PAGE;
        let mut buffer = [0; BLOCK];
        for (at, chunk) in (start..).step_by(BLOCK).zip(data.chunks(BLOCK)) {
            let read = buffer.get_mut(..chunk.len()).unwrap_or_default();
            self.memory.read(at, read)?;
            let pairs = (at..).zip(read.iter().zip(chunk));
            for (address, (&found, &expected)) in pairs {
                if found != expected {
                    return Err(EthernetError::Differs {
                        address,
                        expected,
                        found,
                    });
                }
            }
            progress(Stage::Verify, (at - start) as usize + chunk.len());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
