//! Updating the firmware of a remote, as Mesa's UFLBP and LinuxCNC's `setsserial` do.
//!
//! The card is in setup mode, at 115200 baud, on a serial port or on a channel of the FPGA. Its
//! bootloader has a block of the flash memory for itself, the first, and answers whether or not there
//! is a program behind it, so that an update that was cut off is found and finished.
//!
//! The order of the steps: [`Plan::make`] reads the sizes and compares what is there, which changes
//! nothing; [`Plan::carry_out`] erases, writes and verifies block by block what differs.
//!
//! FACTS 1.6, and what is not confirmed on hardware about it.

use core::error::Error;

use super::Firmware;
use mesa_hal::lbp::flash;
use mesa_hal::lbp::{
    AccessSize, COOKIE, LocalLocation, NonvolatileMemory, RemoteAccess, RemoteLink,
};

/// Sizes that flash memories of microcontrollers have, as powers of two.
const LOG2_WRITE: core::ops::RangeInclusive<u8> = 3..=14;
const LOG2_ERASE: core::ops::RangeInclusive<u8> = 6..=20;

/// So many pages of a block are looked at to see whether reads show the flash memory.
const SAMPLES: u32 = 16;

/// How often a block is erased and written before it is given up.
const ATTEMPTS: u8 = 2;

/// Bytes of one access.
const STEP: usize = 8;

/// Why a remote was not updated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError<E: Error + 'static> {
    /// An access failed.
    #[error("{0}; once the cause is removed, the same command finishes the update")]
    Link(#[from] E),
    /// The remote has no flash memory that is reached like this.
    #[error(
        "the remote says that it erases 2^{erase} and writes 2^{write} bytes at a time, which no flash \
         memory does; its firmware can not be updated over LBP"
    )]
    Sizes {
        /// Base-2 logarithm of what an erase erases.
        erase: u8,
        /// Base-2 logarithm of what a write writes.
        write: u8,
    },
    /// There is nothing to write.
    #[error(
        "the file has {file} bytes, and the first {erase} of the flash memory are the bootloader's, \
         which is not written: it is no firmware for this card"
    )]
    TooShort {
        /// Length of the file.
        file: usize,
        /// Size of a block.
        erase: u32,
    },
    /// What is in the flash memory can not be seen.
    #[error(
        "this remote does not show what is in its flash memory, so that an update can not be verified; \
         `--no-verify` writes without, as LinuxCNC's setsserial does"
    )]
    NotReadable,
    /// The remote did not say its cookie after an erase or a write.
    #[error(
        "offset {offset:#X}: the remote answers {found:02X} after an erase or a write, expected 5A; \
         power it off and on, and give the same command again"
    )]
    OutOfStep {
        /// Where in the flash memory.
        offset: u32,
        /// What it said.
        found: u8,
    },
    /// The flash memory does not hold what was written.
    #[error(
        "offset {offset:#X} of the flash memory reads {read:#018X} after {written:#018X} was written, \
         {ATTEMPTS} times; give the same command again, and if that does not help, the memory is worn \
         out or this offset is protected"
    )]
    NotKept {
        /// Where.
        offset: u32,
        /// What was written, eight bytes, least significant first.
        written: u64,
        /// What is there.
        read: u64,
    },
    /// It was asked to stop.
    #[error(
        "stopped with {left} of {blocks} blocks to be written: the card has no complete program, and \
         waits in its bootloader for the same command again"
    )]
    Stopped {
        /// Blocks that are not written.
        left: usize,
        /// Blocks of the file.
        blocks: usize,
    },
}

/// What is to be written, and what is there already.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Bytes that one erase erases: a block.
    pub erase_size: u32,
    /// Bytes that one write writes: a page.
    pub write_size: u32,
    /// Whether the remote shows its flash memory. If not, everything counts as different.
    pub is_readable: bool,
    /// The blocks that the file has something for, but for the bootloader's, by offset.
    pub blocks: Vec<Block>,
    /// Whether the file begins with the bootloader that the card has; `None` if the card does not show
    /// its flash memory. A file for another card does not, but that those of Mesa do is not confirmed.
    pub has_bootloader: Option<bool>,
    /// Where, behind the end of the file, the card has something still: the file may be cut off, or an
    /// older and shorter version. Of each page the first bytes are looked at, up to the end of the
    /// block after the file's last.
    pub behind_end: Option<u32>,
}

/// A block of the flash memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Where it begins.
    pub offset: u32,
    /// Whether it holds what the file has for it.
    pub is_same: bool,
}

/// How far an update is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub step: Step,
    /// Bytes of this step that are done, over all blocks.
    pub done: u64,
    /// Bytes of this step.
    pub total: u64,
}

/// A step of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// What is there is read.
    Compare,
    /// Blocks are erased and written.
    Write,
    /// What was written is read back.
    Verify,
}

/// Asked again and again how far it is; `false` stops it.
pub type OnProgress<'a> = &'a mut dyn FnMut(Progress) -> bool;

impl Plan {
    /// Reads the sizes of the flash memory, and compares what is there with the file. Changes nothing.
    ///
    /// # Errors
    /// [`UpdateError`].
    pub fn make<L: RemoteLink>(
        link: &mut L,
        firmware: &Firmware,
        progress: OnProgress<'_>,
    ) -> Result<Self, UpdateError<L::Error>> {
        in_flash(link, |link| Self::look(link, firmware, progress))
    }

    fn look<L: RemoteLink>(
        link: &mut L,
        firmware: &Firmware,
        progress: OnProgress<'_>,
    ) -> Result<Self, UpdateError<L::Error>> {
        let mut log2 = |address| -> Result<u8, L::Error> {
            let size = AccessSize::Byte;
            Ok(link.exchange(RemoteAccess::Read { address, size })? as u8)
        };
        let (erase, write) = (log2(flash::LOG2_ERASE_SIZE)?, log2(flash::LOG2_WRITE_SIZE)?);
        if !LOG2_ERASE.contains(&erase) || !LOG2_WRITE.contains(&write) || write > erase {
            return Err(UpdateError::Sizes { erase, write });
        }
        let mut plan = Self {
            erase_size: 1 << erase,
            write_size: 1 << write,
            is_readable: false,
            blocks: Vec::new(),
            has_bootloader: None,
            behind_end: None,
        };
        let (file, erase) = (firmware.bytes().len(), plan.erase_size);
        if file <= erase as usize {
            return Err(UpdateError::TooShort { file, erase });
        }
        plan.is_readable = plan.shows_flash(link)?;
        let offsets = (1..).map(|block| block * erase);
        for offset in offsets.take_while(|&offset| (offset as usize) < file) {
            // What setsserial leaves alone, and what no erased or written memory holds.
            if firmware.block(offset, erase).any(|byte| byte != 0) {
                let is_same = false;
                plan.blocks.push(Block { offset, is_same });
            }
        }
        if plan.blocks.is_empty() {
            return Err(UpdateError::TooShort { file, erase });
        }
        if plan.is_readable {
            plan.compare(link, firmware, progress)?;
            plan.has_bootloader = Some(plan.difference(link, firmware, 0)?.is_none());
            plan.behind_end = plan.behind_end(link, file as u32)?;
        }
        Ok(plan)
    }

    fn compare<L: RemoteLink>(
        &mut self,
        link: &mut L,
        firmware: &Firmware,
        progress: OnProgress<'_>,
    ) -> Result<(), UpdateError<L::Error>> {
        let (erase, blocks) = (self.erase_size, self.blocks.len());
        for index in 0..blocks {
            let told = Progress {
                step: Step::Compare,
                done: index as u64 * u64::from(erase),
                total: blocks as u64 * u64::from(erase),
            };
            if !progress(told) {
                return Err(UpdateError::Stopped {
                    left: blocks,
                    blocks,
                });
            }
            let Some(block) = self.blocks.get(index).copied() else {
                break;
            };
            let difference = self.difference(link, firmware, block.offset)?;
            if let Some(block) = self.blocks.get_mut(index) {
                block.is_same = difference.is_none();
            }
        }
        Ok(())
    }

    /// The blocks that are to be written.
    pub fn different(&self) -> impl Iterator<Item = u32> {
        let blocks = self.blocks.iter().filter(|block| !block.is_same);
        blocks.map(|block| block.offset)
    }

    /// Bytes that are to be written.
    pub fn bytes(&self) -> u64 {
        self.different().count() as u64 * u64::from(self.erase_size)
    }

    /// Erases, writes and, if `is_verified`, reads back what differs.
    ///
    /// # Errors
    /// [`UpdateError`]: the card has no complete program then, and the update can be made again.
    pub fn carry_out<L: RemoteLink>(
        &self,
        link: &mut L,
        firmware: &Firmware,
        is_verified: bool,
        progress: OnProgress<'_>,
    ) -> Result<(), UpdateError<L::Error>> {
        if is_verified && !self.is_readable {
            return Err(UpdateError::NotReadable);
        }
        let blocks = self.blocks.len();
        for (index, offset) in self.different().enumerate() {
            let left = self.different().count() - index;
            let mut on_page = |step, page: u32| {
                let done = index as u64 * u64::from(self.erase_size) + u64::from(page);
                let total = self.bytes();
                if progress(Progress { step, done, total }) {
                    Ok(())
                } else {
                    Err(UpdateError::Stopped { left, blocks })
                }
            };
            self.replace(link, firmware, offset, is_verified, &mut on_page)?;
        }
        Ok(())
    }

    fn replace<L: RemoteLink>(
        &self,
        link: &mut L,
        firmware: &Firmware,
        offset: u32,
        is_verified: bool,
        on_page: &mut OnPage<'_, L::Error>,
    ) -> Result<(), UpdateError<L::Error>> {
        let mut wrong = None;
        for _ in 0..ATTEMPTS {
            // As setsserial: the memory is selected anew for each of the two.
            in_flash(link, |link| commit(link, offset, flash::COMMIT_ERASE))?;
            in_flash(link, |link| self.write(link, firmware, offset, on_page))?;
            if !is_verified {
                return Ok(());
            }
            on_page(Step::Verify, 0)?;
            wrong = in_flash(link, |link| self.difference(link, firmware, offset))?;
            if wrong.is_none() {
                return Ok(());
            }
        }
        let Mismatch {
            offset,
            written,
            read,
        } = wrong.unwrap_or_default();
        Err(UpdateError::NotKept {
            offset,
            written,
            read,
        })
    }

    fn write<L: RemoteLink>(
        &self,
        link: &mut L,
        firmware: &Firmware,
        block: u32,
        on_page: &mut OnPage<'_, L::Error>,
    ) -> Result<(), UpdateError<L::Error>> {
        for page in self.pages() {
            on_page(Step::Write, page)?;
            let offset = block + page;
            set_offset(link, offset)?;
            for (address, value) in firmware.doubles(offset, self.write_size) {
                link.exchange(RemoteAccess::Write {
                    address,
                    size: AccessSize::Double,
                    value,
                })?;
            }
            commit(link, offset, flash::COMMIT_WRITE)?;
        }
        Ok(())
    }

    /// The first difference between a block and the file.
    fn difference<L: RemoteLink>(
        &self,
        link: &mut L,
        firmware: &Firmware,
        block: u32,
    ) -> Result<Option<Mismatch>, UpdateError<L::Error>> {
        for page in self.pages() {
            set_offset(link, block + page)?;
            for (address, written) in firmware.doubles(block + page, self.write_size) {
                let read = read_double(link, address)?;
                if read != written {
                    let offset = block + page + u32::from(address);
                    return Ok(Some(Mismatch {
                        offset,
                        written,
                        read,
                    }));
                }
            }
        }
        Ok(None)
    }

    /// Offsets of the pages in a block.
    fn pages(&self) -> impl Iterator<Item = u32> + use<> {
        (0..self.erase_size).step_by(self.write_size as usize)
    }

    /// Whether reads show the flash memory: then they differ from page to page. The bootloader's block
    /// is looked at first, which is never empty.
    fn shows_flash<L: RemoteLink>(&self, link: &mut L) -> Result<bool, L::Error> {
        let mut first = None;
        for block in [0, self.erase_size] {
            for page in self.pages().take(SAMPLES as usize) {
                set_offset(link, block + page)?;
                let read = read_double(link, 0)?;
                if *first.get_or_insert(read) != read {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }
}

/// What erased memory reads.
const ERASED: u64 = u64::MAX;

impl Plan {
    /// Where the card has something behind the end of a file of so many bytes.
    fn behind_end<L: RemoteLink>(&self, link: &mut L, file: u32) -> Result<Option<u32>, L::Error> {
        let begin = file.next_multiple_of(self.write_size);
        let end = file.next_multiple_of(self.erase_size) + self.erase_size;
        set_offset(link, 0)?;
        let first = read_double(link, 0)?;
        for offset in (begin..end).step_by(self.write_size as usize) {
            set_offset(link, offset)?;
            let read = read_double(link, 0)?;
            // Behind its end the memory may begin anew.
            if offset % self.erase_size == 0 && read == first {
                break;
            }
            if read != ERASED {
                return Ok(Some(offset));
            }
        }
        Ok(None)
    }
}

/// Eight bytes that are not those of the file.
#[derive(Clone, Copy, Debug, Default)]
struct Mismatch {
    offset: u32,
    written: u64,
    read: u64,
}

/// Told before each page; fails if it shall stop.
type OnPage<'a, E> = dyn FnMut(Step, u32) -> Result<(), UpdateError<E>> + 'a;

impl Firmware {
    /// The bytes of a block, with those of erased memory behind the end of the file.
    fn block(&self, offset: u32, size: u32) -> impl Iterator<Item = u8> {
        let bytes = self.bytes().iter().copied().skip(offset as usize);
        bytes.take(size as usize)
    }

    /// The accesses that a page takes: address in the page, and eight bytes. Behind the end of the file
    /// is what erased memory holds.
    fn doubles(&self, offset: u32, size: u32) -> impl Iterator<Item = (u16, u64)> {
        (0..size).step_by(STEP).map(move |at| {
            let mut eight = [0xFF; STEP];
            let bytes = self.bytes().iter().skip((offset + at) as usize);
            for (to, from) in eight.iter_mut().zip(bytes) {
                *to = *from;
            }
            (at as u16, u64::from_le_bytes(eight))
        })
    }
}

/// Does something while accesses reach the flash memory, and ends that whatever happens.
fn in_flash<L: RemoteLink, T>(
    link: &mut L,
    work: impl FnOnce(&mut L) -> Result<T, UpdateError<L::Error>>,
) -> Result<T, UpdateError<L::Error>> {
    let select = |code| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, code);
    link.exchange(select(NonvolatileMemory::Flash as u8))?;
    let result = work(link);
    let closed = link.exchange(select(0));
    let done = result?;
    closed?;
    Ok(done)
}

fn set_offset<L: RemoteLink>(link: &mut L, offset: u32) -> Result<(), L::Error> {
    link.exchange(RemoteAccess::Write {
        address: flash::OFFSET,
        size: AccessSize::Long,
        value: offset.into(),
    })
    .map(drop)
}

fn read_double<L: RemoteLink>(link: &mut L, address: u16) -> Result<u64, L::Error> {
    let size = AccessSize::Double;
    link.exchange(RemoteAccess::Read { address, size })
}

/// Erases or writes at `offset`, and waits until the remote answers again.
fn commit<L: RemoteLink>(link: &mut L, offset: u32, what: u8) -> Result<(), UpdateError<L::Error>> {
    set_offset(link, offset)?;
    link.exchange(RemoteAccess::Write {
        address: flash::COMMIT,
        size: AccessSize::Byte,
        value: what.into(),
    })?;
    match link.exchange(RemoteAccess::ReadLocal(LocalLocation::COOKIE))? as u8 {
        COOKIE => Ok(()),
        found => Err(UpdateError::OutOfStep { offset, found }),
    }
}
