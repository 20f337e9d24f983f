//! Firmware update of a remote, as by Mesa's UFLBP and LinuxCNC's `setsserial`.
//!
//! The card is in setup mode, at 115200 baud, on a serial port or on a channel of the FPGA. Its
//! bootloader occupies the first block of the flash memory, and answers with or without a program
//! behind it, so that an interrupted update is detected and completed.
//!
//! Order of the steps: [`UpdatePlan::make`] reads the sizes and compares the contents, which
//! changes nothing; [`UpdatePlan::carry_out`] erases, writes and verifies the differing blocks one
//! by one.
//!
//! FACTS 1.6, including the points that are not confirmed on hardware.

mod extent;

use super::{FirmwareFile, advice};
use mesa_hal::{Advice, MesaError};

use mesa_hal::lbp::flash;
use mesa_hal::lbp::{
    AccessSize, COOKIE, LocalLocation, NonvolatileMemory, RemoteAccess, RemoteLink, RemoteLinkError,
};

/// Plausible sizes for the flash memory of a microcontroller, as powers of two.
const LOG2_WRITE: core::ops::RangeInclusive<u8> = 3..=14;
const LOG2_ERASE: core::ops::RangeInclusive<u8> = 6..=20;

/// Number of pages in a block that are read to detect whether reads show the flash memory.
const SAMPLES: u32 = 16;

/// Number of attempts to erase and write a block.
const ATTEMPTS: u8 = 2;

/// Bytes of one access.
const STEP: usize = 8;

/// Error of a firmware update.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// An access failed.
    #[error(transparent)]
    Link(#[from] RemoteLinkError),
    /// The remote has no flash memory that is accessible in this way.
    #[error(
        "the remote reports that it erases 2^{erase} and writes 2^{write} bytes at a time, which no flash \
         memory does: its firmware cannot be updated over LBP"
    )]
    Sizes {
        /// Base-2 logarithm of the bytes that an erase erases.
        erase: u8,
        /// Base-2 logarithm of the bytes that a write writes.
        write: u8,
    },
    /// The file contains nothing to write.
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
    /// The file is longer than the flash memory.
    #[error(
        "the file has {file} bytes, and the flash memory of this card ends after {flash}: it is for \
         another card, or for a later version of it; nothing was erased"
    )]
    TooLong {
        /// Length of the file.
        file: usize,
        /// Offset of the first block that the memory does not have.
        flash: u32,
    },
    /// The contents of the flash memory are not visible.
    #[error(
        "the remote does not show the contents of its flash memory, so that an update cannot be verified"
    )]
    NotReadable,
    /// The remote did not return its cookie after an erase or a write.
    #[error(
        "offset {offset:#X}: the remote answers {found:02X} after an erase or a write, expected 5A"
    )]
    OutOfStep {
        /// Offset in the flash memory.
        offset: u32,
        /// Value in place of the cookie.
        found: u8,
    },
    /// The flash memory does not retain the written data.
    #[error(
        "offset {offset:#X} of the flash memory reads {read:#018X} after {written:#018X} was written, \
         {ATTEMPTS} times"
    )]
    NotKept {
        /// Offset in the flash memory.
        offset: u32,
        /// Eight bytes that were written, least significant first.
        written: u64,
        /// Eight bytes that were read.
        read: u64,
    },
    /// The progress callback stopped the update.
    #[error(
        "stopped with {left} of {blocks} blocks to be written: the card has no complete program, and \
         waits in its bootloader for the same command again"
    )]
    Stopped {
        /// Blocks not yet written.
        left: usize,
        /// Blocks of the file.
        blocks: usize,
    },
}

impl MesaError for UpdateError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Link(error) => error.advice(),
            Self::NotReadable => Some(advice::UPDATE_BLINDLY),
            Self::OutOfStep { .. } => Some(advice::POWER_CYCLE_AND_UPDATE),
            Self::NotKept { .. } => Some(advice::UPDATE_ONCE_MORE),
            Self::Sizes { .. }
            | Self::TooShort { .. }
            | Self::TooLong { .. }
            | Self::Stopped { .. } => None,
        }
    }

    fn further_advice(&self) -> Option<Advice> {
        matches!(self, Self::Link(_)).then_some(advice::UPDATE_AGAIN)
    }
}

/// Blocks to write, and the present contents of the flash memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpdatePlan {
    /// Bytes of a block, the unit of an erase.
    pub erase_size: u32,
    /// Bytes of a page, the unit of a write.
    pub write_size: u32,
    /// True if reads show the flash memory. If false, every block counts as different.
    pub is_readable: bool,
    /// Blocks for which the file contains data, by offset, without the bootloader's.
    pub blocks: Vec<UpdateBlock>,
    /// True if the file begins with the card's bootloader; `None` if reads do not show the flash
    /// memory. A file for another card does not begin with it. Mesa's own files are not confirmed
    /// to do so.
    pub has_bootloader: Option<bool>,
    /// Offset at which the card has data behind the end of the file: the file may be truncated, or
    /// an older and shorter version. Only the first bytes of each page are read, up to the end of
    /// the block after the file's last.
    pub behind_end: Option<u32>,
}

/// A block of the flash memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateBlock {
    /// Offset of the block.
    pub offset: u32,
    /// True if the block contains the file's data.
    pub is_same: bool,
}

/// Progress of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateProgress {
    /// Current step.
    pub step: UpdateStep,
    /// Bytes done in this step, over all blocks.
    pub done: u64,
    /// Total bytes of this step.
    pub total: u64,
}

/// A step of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateStep {
    /// Reads and compares the contents.
    Compare,
    /// Erases and writes blocks.
    Write,
    /// Reads back the written data.
    Verify,
}

/// Progress callback, called repeatedly; returning `false` stops the update.
pub type OnProgress<'a> = &'a mut dyn FnMut(UpdateProgress) -> bool;

impl UpdatePlan {
    /// Reads the sizes of the flash memory and compares its contents with the file. Changes
    /// nothing.
    ///
    /// # Errors
    /// [`UpdateError`].
    pub fn make<L: RemoteLink>(
        link: &mut L,
        firmware: &FirmwareFile,
        progress: OnProgress<'_>,
    ) -> Result<Self, UpdateError> {
        in_flash(link, |link| Self::look(link, firmware, progress))
    }

    fn look<L: RemoteLink>(
        link: &mut L,
        firmware: &FirmwareFile,
        progress: OnProgress<'_>,
    ) -> Result<Self, UpdateError> {
        let mut log2 = |address| -> Result<u8, RemoteLinkError> {
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
        plan.check_fits(link, file)?;
        let offsets = (1..).map(|block| block * erase);
        for offset in offsets.take_while(|&offset| (offset as usize) < file) {
            // All-zero blocks are skipped, as by setsserial; erased or written memory does not
            // contain them.
            if firmware.block(offset, erase).any(|byte| byte != 0) {
                let is_same = false;
                plan.blocks.push(UpdateBlock { offset, is_same });
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
        firmware: &FirmwareFile,
        progress: OnProgress<'_>,
    ) -> Result<(), UpdateError> {
        let (erase, blocks) = (self.erase_size, self.blocks.len());
        for index in 0..blocks {
            let told = UpdateProgress {
                step: UpdateStep::Compare,
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

    /// Offsets of the blocks to write.
    pub fn different(&self) -> impl Iterator<Item = u32> {
        let blocks = self.blocks.iter().filter(|block| !block.is_same);
        blocks.map(|block| block.offset)
    }

    /// Number of bytes to write.
    pub fn bytes(&self) -> u64 {
        self.different().count() as u64 * u64::from(self.erase_size)
    }

    /// Erases and writes the differing blocks and, if `is_verified`, reads them back.
    ///
    /// # Errors
    /// [`UpdateError`]: the card then has no complete program, and the update can be repeated.
    pub fn carry_out<L: RemoteLink>(
        &self,
        link: &mut L,
        firmware: &FirmwareFile,
        is_verified: bool,
        progress: OnProgress<'_>,
    ) -> Result<(), UpdateError> {
        if is_verified && !self.is_readable {
            return Err(UpdateError::NotReadable);
        }
        let blocks = self.blocks.len();
        for (index, offset) in self.different().enumerate() {
            let left = self.different().count() - index;
            let mut on_page = |step, page: u32| {
                let done = index as u64 * u64::from(self.erase_size) + u64::from(page);
                let total = self.bytes();
                if progress(UpdateProgress { step, done, total }) {
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
        firmware: &FirmwareFile,
        offset: u32,
        is_verified: bool,
        on_page: &mut OnPage<'_>,
    ) -> Result<(), UpdateError> {
        let mut wrong = None;
        for _ in 0..ATTEMPTS {
            // As in setsserial, the memory is selected anew for the erasure and for the write.
            in_flash(link, |link| commit(link, offset, flash::COMMIT_ERASE))?;
            in_flash(link, |link| self.write(link, firmware, offset, on_page))?;
            if !is_verified {
                return Ok(());
            }
            on_page(UpdateStep::Verify, 0)?;
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
        firmware: &FirmwareFile,
        block: u32,
        on_page: &mut OnPage<'_>,
    ) -> Result<(), UpdateError> {
        for page in self.pages() {
            on_page(UpdateStep::Write, page)?;
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

    /// Returns the first difference between a block and the file.
    fn difference<L: RemoteLink>(
        &self,
        link: &mut L,
        firmware: &FirmwareFile,
        block: u32,
    ) -> Result<Option<Mismatch>, UpdateError> {
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
}

/// Eight bytes that differ from those of the file.
#[derive(Clone, Copy, Debug, Default)]
struct Mismatch {
    offset: u32,
    written: u64,
    read: u64,
}

/// Callback before each page; fails to stop the update.
type OnPage<'a> = dyn FnMut(UpdateStep, u32) -> Result<(), UpdateError> + 'a;

impl FirmwareFile {
    /// The bytes of a block, as far as the file contains them.
    fn block(&self, offset: u32, size: u32) -> impl Iterator<Item = u8> {
        let bytes = self.bytes().iter().copied().skip(offset as usize);
        bytes.take(size as usize)
    }

    /// The accesses for a page: address in the page, and eight bytes. Behind the end of the file
    /// the bytes are those of erased memory.
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

/// Runs `work` while accesses reach the flash memory, and deselects the memory after a failure too.
fn in_flash<L: RemoteLink, T>(
    link: &mut L,
    work: impl FnOnce(&mut L) -> Result<T, UpdateError>,
) -> Result<T, UpdateError> {
    let select = |code| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, code);
    link.exchange(select(NonvolatileMemory::Flash as u8))?;
    let result = work(link);
    let closed = link.exchange(select(0));
    let done = result?;
    closed?;
    Ok(done)
}

fn set_offset<L: RemoteLink>(link: &mut L, offset: u32) -> Result<(), RemoteLinkError> {
    link.exchange(RemoteAccess::Write {
        address: flash::OFFSET,
        size: AccessSize::Long,
        value: offset.into(),
    })
    .map(drop)
}

fn read_double<L: RemoteLink>(link: &mut L, address: u16) -> Result<u64, RemoteLinkError> {
    let size = AccessSize::Double;
    link.exchange(RemoteAccess::Read { address, size })
}

/// Erases or writes at `offset`, and waits until the remote answers again.
fn commit<L: RemoteLink>(link: &mut L, offset: u32, what: u8) -> Result<(), UpdateError> {
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
