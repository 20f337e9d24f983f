//! The flash memory that holds the FPGA's configurations, and the rules for writing it.

use alloc::format;
use core::ops::Range;
use core::time::Duration;

mod backup;
mod boot_block;
mod chip;
mod spi;

pub use backup::FlashDifference;
pub use chip::{FlashChange, FlashChip};
pub use spi::SpiFlash;

use super::{Area, Bitfile, EthernetBoard, EthernetError, Lbp16Board};
use crate::boards::FlashLayout;
use crate::lbp16::registers::flash::{PAGE, SECTOR};

/// A sector of an M25P16 is erased within 3 s.
const ERASE: Duration = Duration::from_secs(4);
/// A page of an M25P16 is written within 5 ms.
const WRITE: Duration = Duration::from_millis(100);
/// Bytes of a sector, in the type of an address.
const SECTOR_BYTES: u32 = SECTOR as u32;
/// Bytes read at a time.
const PACKET: usize = 1024;

/// Current step, for a progress display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashStep {
    /// Sectors are being erased.
    Erase,
    /// Pages are being written.
    Write,
    /// The written data are being read back.
    Verify,
}

/// What is behind the end of the data, in their last page.
#[derive(Clone, Copy, Debug)]
enum Padding {
    /// What an erased page has.
    Erased,
    /// What mesaflash writes there, and expects when it verifies: its buffer has 8192 bytes, and
    /// the end of the block before is left in it (mesaflash 3.4.6 and 3.5.11, tried).
    OfMesaflash,
}

impl Padding {
    const BUFFER: usize = 8192;

    /// The page of the data from `index` on.
    fn page(self, data: &[u8], index: usize) -> [u8; PAGE] {
        let mut page = [0xFF; PAGE];
        for (at, byte) in (index..).zip(&mut page) {
            let behind = || match self {
                Self::Erased => None,
                Self::OfMesaflash => data.get(at.checked_sub(Self::BUFFER)?),
            };
            if let Some(value) = data.get(at).or_else(behind) {
                *byte = *value;
            }
        }
        page
    }
}

/// The flash memory of a board, guarded by its layout.
#[derive(Debug)]
pub struct Flash<C> {
    chip: C,
    layout: FlashLayout,
    needs_fallback: bool,
}

impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// The board's flash memory, after a check that the board and its chip are those that the
    /// layout is for.
    ///
    /// # Errors
    /// [`EthernetError::WrongBoard`], and errors of [`identity`](Self::identity).
    pub fn into_flash(mut self, layout: FlashLayout) -> Result<Flash<Self>, EthernetError> {
        let found = self.identity()?.card;
        if !found.eq_ignore_ascii_case(layout.board) {
            return Err(EthernetError::WrongBoard {
                found: format!("a {found}"),
                expected: format!("a {}", layout.board),
            });
        }
        Flash::open(self, layout)
    }
}

impl<C: FlashChip> Flash<C> {
    /// The memory of a board, after a check that its chip is the one that the layout is for. The
    /// caller has checked the board.
    ///
    /// # Errors
    /// [`EthernetError::WrongBoard`], and errors of the bus.
    pub fn open(mut chip: C, layout: FlashLayout) -> Result<Self, EthernetError> {
        let (found, expected) = (chip.id()?, layout.id);
        if found == expected {
            return Ok(Self {
                chip,
                layout,
                needs_fallback: true,
            });
        }
        Err(EthernetError::WrongBoard {
            found: format!("a board with flash id 0x{found:08X}"),
            expected: format!("one with 0x{expected:08X}"),
        })
    }

    /// The layout of the memory.
    pub fn layout(&self) -> &FlashLayout {
        &self.layout
    }

    /// Allows writing the user configuration while there is no fallback: for a chip that has
    /// neither, and with the user's consent, since only a JTAG programmer helps if the write is
    /// interrupted.
    pub fn without_fallback(&mut self) {
        self.needs_fallback = false;
    }

    /// Reads from any address.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`] beyond the chip's end, and errors of the bus.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError> {
        self.check(Area::Whole, address, bytes.len(), false)?;
        for (part, at) in bytes.chunks_mut(PACKET).zip((address..).step_by(PACKET)) {
            self.chip.read(at, part)?;
        }
        Ok(())
    }

    /// Writes a configuration into the user or the fallback area, and verifies it.
    ///
    /// The file is checked before anything is erased, including that it is for this board
    /// ([`Bitfile::check`]). The FPGA needs one of the two configurations to start: writing either
    /// is refused while the boot block [is not valid](Self::check_boot_block), or the other does
    /// not [begin](Self::begins).
    ///
    /// Manual: 7I97, "FALLBACK".
    ///
    /// # Errors
    /// [`EthernetError::Bitfile`], [`EthernetError::NotForConfigurations`],
    /// [`EthernetError::NoFallback`], [`EthernetError::NoUserConfiguration`], and errors of
    /// [`check_boot_block`](Self::check_boot_block) and of [`write`](Self::write).
    pub fn program(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        self.check_program(bitfile, area)?;
        let range = self.layout.addresses(area);
        let (data, mut progress) = (bitfile.configuration, progress);
        self.check(area, range.start, data.len(), true)?;
        self.put(range.start, data, Padding::OfMesaflash, &mut progress)
    }

    /// Performs the checks of [`program`](Self::program) that precede the erasing.
    ///
    /// # Errors
    /// Errors of `program`, and of the bus.
    pub fn check_program(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
    ) -> Result<(), EthernetError> {
        self.check_file(bitfile, area)?;
        self.check_boot_block()?;
        self.need_other(area)
    }

    /// Performs the checks of [`program`](Self::program) except that of the boot block, for a
    /// caller that [writes it](Self::write_boot_block) first.
    ///
    /// # Errors
    /// Errors of `program`, and of the bus.
    pub fn check_configuration(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
    ) -> Result<(), EthernetError> {
        self.check_file(bitfile, area)?;
        self.need_other(area)
    }

    /// Checks that a file is a configuration for this board and fits into the area.
    fn check_file(&self, bitfile: &Bitfile<'_>, area: Area) -> Result<(), EthernetError> {
        if !matches!(area, Area::User | Area::Fallback) {
            return Err(EthernetError::NotForConfigurations { area });
        }
        let FlashLayout { board, part, .. } = self.layout;
        let range = self.layout.addresses(area);
        Ok(bitfile.check(board, part, range.len())?)
    }

    /// Checks that the FPGA can still start when the area is erased.
    fn need_other(&mut self, area: Area) -> Result<(), EthernetError> {
        let FlashLayout { fallback, user, .. } = self.layout;
        match area {
            Area::User if self.needs_fallback && !self.begins(Area::Fallback)? => {
                let (address, _) = fallback;
                Err(EthernetError::NoFallback { address })
            }
            Area::Fallback | Area::BootBlock if !self.begins(Area::User)? => {
                let (address, _) = user;
                Err(EthernetError::NoUserConfiguration { address })
            }
            _ => Ok(()),
        }
    }

    /// True if a configuration begins in an area: without one in the user or in the fallback area
    /// the FPGA has nothing to load. Its beginning is sufficient evidence: [`write`](Self::write)
    /// writes the beginning last.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn begins(&mut self, area: Area) -> Result<bool, EthernetError> {
        let mut head = [0; Bitfile::SYNC_WITHIN];
        self.read(self.layout.addresses(area).start, &mut head)?;
        Ok(Bitfile::has_sync(&head))
    }

    /// Compares an area with a configuration.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`], [`EthernetError::Differs`], and errors of the bus.
    pub fn verify(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        mut progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        let start = self.layout.addresses(area).start;
        self.check(area, start, bitfile.configuration.len(), false)?;
        self.compare(start, bitfile.configuration, &mut progress)
    }

    /// Erases the sectors that `data` needs, writes the data, and verifies them. `address` is the
    /// start of a sector.
    ///
    /// Sectors are erased as a whole, also behind the end of `data`. [`Area::Whole`] takes the data
    /// of the whole chip, and nothing less. The first page is written last: a configuration that
    /// was not written to its end has no beginning, and the FPGA does not try to load it.
    ///
    /// `progress` receives the number of bytes of the step that are done.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`], [`EthernetError::Differs`], and errors of the bus.
    pub fn write(
        &mut self,
        area: Area,
        address: u32,
        data: &[u8],
        mut progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        self.check(area, address, data.len(), true)?;
        self.put(address, data, Padding::Erased, &mut progress)
    }

    /// Erases, writes and verifies after all checks have passed.
    fn put(
        &mut self,
        address: u32,
        data: &[u8],
        padding: Padding,
        progress: &mut impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        let mut erased = 0_usize;
        for (_, sector) in data.chunks(SECTOR).zip((address..).step_by(SECTOR)) {
            self.change(sector, FlashChange::EraseSector)?;
            erased = erased.saturating_add(SECTOR);
            progress(FlashStep::Erase, erased);
        }
        let mut written = 0_usize;
        let pages = || {
            let places = (0..).step_by(PAGE).zip((address..).step_by(PAGE));
            data.chunks(PAGE).zip(places)
        };
        for (chunk, (index, at)) in pages().skip(1).chain(pages().take(1)) {
            let page = padding.page(data, index);
            // An erased page is all FF already.
            if page != [0xFF; PAGE] {
                self.change(at, FlashChange::WritePage(&page))?;
            }
            written = written.saturating_add(chunk.len());
            progress(FlashStep::Write, written);
        }
        self.compare(address, data, progress)
    }

    /// Erases or writes at `address`, and waits until it is done.
    fn change(&mut self, address: u32, change: FlashChange<'_>) -> Result<(), EthernetError> {
        let deadline = match change {
            FlashChange::EraseSector => ERASE,
            FlashChange::WritePage(_) => WRITE,
        };
        self.chip.change(address, change, deadline)
    }

    /// Checks that the bytes are inside of the area and, for a write, that no others are erased
    /// with them.
    fn check(
        &self,
        area: Area,
        address: u32,
        bytes: usize,
        is_write: bool,
    ) -> Result<(), EthernetError> {
        let Range { start, end } = self.layout.addresses(area);
        let (size, within) = (self.layout.size, address % SECTOR_BYTES);
        let behind = u64::from(address).saturating_add(bytes as u64);
        let expected = if address < start || behind > u64::from(end) {
            format!("0x{start:06X} to 0x{end:06X}")
        } else if is_write && area == Area::Whole && bytes != size as usize {
            format!("all of its {size} bytes from 0 on")
        } else if is_write && within != 0 {
            let begin = address.saturating_sub(within);
            format!("what begins a sector, here 0x{begin:06X}")
        } else {
            return Ok(());
        };
        Err(EthernetError::OutsideArea {
            address,
            bytes,
            area,
            expected,
        })
    }

    fn compare(
        &mut self,
        start: u32,
        data: &[u8],
        progress: &mut impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        let mut buffer = [0; PACKET];
        let mut verified = 0_usize;
        for (chunk, at) in data.chunks(PACKET).zip((start..).step_by(PACKET)) {
            let read = buffer.get_mut(..chunk.len()).unwrap_or_default();
            debug_assert_eq!(read.len(), chunk.len(), "a chunk fits the buffer");
            self.read(at, read)?;
            for (address, (&found, &expected)) in (at..).zip(read.iter().zip(chunk)) {
                if found != expected {
                    return Err(EthernetError::Differs {
                        address,
                        expected,
                        found,
                    });
                }
            }
            verified = verified.saturating_add(chunk.len());
            progress(FlashStep::Verify, verified);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
