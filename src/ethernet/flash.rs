//! The flash memory that holds the FPGA's configurations, and what may be written where.

use alloc::format;
use alloc::string::String;
use core::ops::Range;
use core::time::Duration;

use super::packets::QUICK;
use super::{Bitfile, EthernetBoard, EthernetError, Lbp16Board};
use crate::boards::FlashLayout;
use crate::lbp16::{Command, Space, registers};
use registers::flash::{PAGE, SECTOR};
use registers::{control, flash};

/// A sector of an M25P16 is erased within 3 s.
const ERASE: Duration = Duration::from_secs(4);
/// A page of an M25P16 is written within 5 ms.
const WRITE: Duration = Duration::from_millis(100);
/// Bytes read by one command; the manual's examples do the same.
const BLOCK: usize = 256;
/// Bytes read by one packet.
const PACKET: usize = 4 * BLOCK;

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

/// What is to be written; naming it is the only way to.
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
pub enum FlashStep {
    /// Sectors are being erased.
    Erase,
    /// Pages are being written.
    Write,
    /// What was written is being read back.
    Verify,
}

/// The flash memory of a board, guarded by its layout.
#[derive(Debug)]
pub struct Flash<B> {
    board: EthernetBoard<B>,
    layout: FlashLayout,
}

impl<B: Lbp16Board> EthernetBoard<B> {
    /// The board's flash memory, after checking that the board and its chip are those that the
    /// layout is for.
    ///
    /// # Errors
    /// [`EthernetError::WrongBoard`], and those of [`identity`](Self::identity).
    pub fn into_flash(mut self, layout: FlashLayout) -> Result<Flash<B>, EthernetError<B::Error>> {
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

impl<B: Lbp16Board> Flash<B> {
    fn open(board: EthernetBoard<B>, layout: FlashLayout) -> Result<Self, EthernetError<B::Error>> {
        let mut this = Self { board, layout };
        let (found, expected) = (this.id()?, layout.id);
        if found == expected {
            return Ok(this);
        }
        Err(EthernetError::WrongBoard {
            found: format!("a board with flash id 0x{found:08X}"),
            expected: format!("one with 0x{expected:08X}"),
        })
    }

    /// Gives the board back.
    pub fn into_board(self) -> EthernetBoard<B> {
        self.board
    }

    /// The chip's identification.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn id(&mut self) -> Result<u32, EthernetError<B::Error>> {
        let mut id = [0; 4];
        self.board.run(&mut id, QUICK, |request| {
            request.read(Space::Flash, flash::ID, 1)
        })?;
        Ok(u32::from_le_bytes(id))
    }

    /// Reads from anywhere.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`] beyond the chip's end, and those of the bus.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError<B::Error>> {
        self.inside(address, bytes.len(), Area::Whole)?;
        for (at, part) in (address..).step_by(PACKET).zip(bytes.chunks_mut(PACKET)) {
            // Addresses and sizes of the memory are multiples of 4; what is asked for need not be.
            let skip = at % 4;
            let wanted = (skip as usize + part.len()).next_multiple_of(4);
            let mut buffer = [0; PACKET + 4];
            let reply = buffer.get_mut(..wanted).unwrap_or_default();
            self.board.run(reply, QUICK, |request| {
                request.write_doubles(Space::Flash, flash::ADDRESS, &[at - skip])?;
                for done in (0..wanted).step_by(BLOCK) {
                    let count = (wanted - done).min(BLOCK) / 4;
                    let read = from_port(Command::read(Space::Flash, count as u8));
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

    /// Writes a configuration into the user or the fallback area, and verifies it.
    ///
    /// The file is checked before anything is erased, also whether it is for this board
    /// ([`Bitfile::check`]). The FPGA needs one of the two configurations to start: the fallback is
    /// refused while there is no boot block, or no user configuration.
    ///
    /// # Errors
    /// [`EthernetError::Bitfile`], [`EthernetError::NotForConfigurations`],
    /// [`EthernetError::NoBootBlock`], [`EthernetError::NoUserConfiguration`], and those of
    /// [`write`](Self::write).
    pub fn program(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError<B::Error>> {
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
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`], [`EthernetError::Differs`], and those of the bus.
    pub fn verify(
        &mut self,
        bitfile: &Bitfile<'_>,
        area: Area,
        mut progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError<B::Error>> {
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
    /// `progress` gets how many bytes of the stage are done.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`], [`EthernetError::Differs`], and those of the bus.
    pub fn write(
        &mut self,
        area: Area,
        address: u32,
        data: &[u8],
        mut progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError<B::Error>> {
        self.may_write(area, address, data.len())?;
        let end = address + data.len() as u32;
        for sector in (address..end).step_by(SECTOR) {
            let erase = Command::write(Space::Flash, 1);
            self.change(sector, ERASE, (erase, flash::SECTOR_ERASE, &[0; 4]))?;
            progress(FlashStep::Erase, (sector - address) as usize + SECTOR);
        }
        let mut written = 0;
        let pages = || (address..end).step_by(PAGE).zip(data.chunks(PAGE));
        for (at, chunk) in pages().skip(1).chain(pages().take(1)) {
            let mut page = [0xFF; PAGE];
            for (target, byte) in page.iter_mut().zip(chunk) {
                *target = *byte;
            }
            // An erased page is all FF already.
            if page != [0xFF; PAGE] {
                let write = from_port(Command::write(Space::Flash, (PAGE / 4) as u8));
                self.change(at, WRITE, (write, flash::DATA, &page))?;
            }
            written += chunk.len();
            progress(FlashStep::Write, written);
        }
        self.compare(address, data, &mut progress)
    }

    /// Erases or writes at `address`, and waits until it is done.
    fn change(
        &mut self,
        address: u32,
        deadline: Duration,
        (command, register, data): (Command, u16, &[u8]),
    ) -> Result<(), EthernetError<B::Error>> {
        let mut echo = [0; 4];
        self.board.run(&mut echo, deadline, |request| {
            // Cleared at the end of every packet, so it is part of each that writes.
            let enable = [control::ENABLE_FLASH];
            request.write_words(Space::Control, control::WRITE_ENABLE, &enable)?;
            request.write_doubles(Space::Flash, flash::ADDRESS, &[address])?;
            request.command(command, register, data)?;
            // Reading the address starts the write of a page, and waits for the end of anything.
            request.read(Space::Flash, flash::ADDRESS, 1)
        })
    }

    fn may_write(
        &self,
        area: Area,
        address: u32,
        bytes: usize,
    ) -> Result<(), EthernetError<B::Error>> {
        self.inside(address, bytes, area)?;
        let (size, within) = (self.layout.size, address % SECTOR as u32);
        if area == Area::Whole && bytes != size as usize {
            let expected = format!("all of its {size} bytes from 0 on");
            return Err(outside(area, address, bytes, expected));
        }
        if within != 0 {
            let expected = format!("what begins a sector, here 0x{:06X}", address - within);
            return Err(outside(area, address, bytes, expected));
        }
        Ok(())
    }

    fn inside(
        &self,
        address: u32,
        bytes: usize,
        area: Area,
    ) -> Result<(), EthernetError<B::Error>> {
        let Range { start, end } = self.layout.addresses(area);
        if start <= address && u64::from(address) + bytes as u64 <= u64::from(end) {
            return Ok(());
        }
        let expected = format!("0x{start:06X} to 0x{end:06X}");
        Err(outside(area, address, bytes, expected))
    }

    fn need_boot_block(&mut self) -> Result<(), EthernetError<B::Error>> {
        let address = self.layout.boot_block.0;
        let mut head = [0xFF; PAGE];
        self.read(address, &mut head)?;
        if head == [0xFF; PAGE] {
            return Err(EthernetError::NoBootBlock { address });
        }
        Ok(())
    }

    /// Whether a configuration begins in the user area; see [`write`](Self::write) for why that is
    /// enough.
    fn need_user_configuration(&mut self) -> Result<(), EthernetError<B::Error>> {
        let address = self.layout.user.0;
        let mut head = [0; Bitfile::SYNC_WITHIN];
        self.read(address, &mut head)?;
        if Bitfile::has_sync(&head) {
            return Ok(());
        }
        Err(EthernetError::NoUserConfiguration { address })
    }

    fn compare(
        &mut self,
        start: u32,
        data: &[u8],
        progress: &mut impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError<B::Error>> {
        let mut buffer = [0; PACKET];
        for (at, chunk) in (start..).step_by(PACKET).zip(data.chunks(PACKET)) {
            let read = buffer.get_mut(..chunk.len()).unwrap_or_default();
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
            progress(FlashStep::Verify, (at - start) as usize + chunk.len());
        }
        Ok(())
    }
}

/// The data port stays where it is.
const fn from_port(command: Command) -> Command {
    Command {
        increment: false,
        ..command
    }
}

fn outside<E>(area: Area, address: u32, bytes: usize, expected: String) -> EthernetError<E> {
    EthernetError::OutsideArea {
        address,
        bytes,
        area,
        expected,
    }
}

#[cfg(test)]
mod tests;
