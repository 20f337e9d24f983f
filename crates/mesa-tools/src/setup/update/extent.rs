//! Extent of a remote's flash memory, which it does not report: found by reads.

use super::{SAMPLES, UpdateError, UpdatePlan, read_double, set_offset};
use mesa_hal::lbp::{LbpStatus, LocalLocation, RemoteAccess, RemoteLink, RemoteLinkError};

/// Contents of erased memory.
const ERASED: u64 = u64::MAX;

impl UpdatePlan {
    /// Checks that a file of `file` bytes fits into the flash memory, as far as reads show its end.
    /// The memory ends where the remote reports an invalid address or does not answer (FACTS 1.5),
    /// or where its beginning appears again.
    pub(super) fn check_fits<L: RemoteLink>(
        &self,
        link: &mut L,
        file: usize,
    ) -> Result<(), UpdateError> {
        let end = match self.repeats_at(link, file)? {
            Some(end) => Some(end),
            None => self.ends_at(link, file)?,
        };
        match end {
            Some(flash) => Err(UpdateError::TooLong { file, flash }),
            None => Ok(()),
        }
    }

    /// The first offset below `file` at which the first block appears again.
    fn repeats_at<L: RemoteLink>(
        &self,
        link: &mut L,
        file: usize,
    ) -> Result<Option<u32>, UpdateError> {
        if !self.is_readable {
            return Ok(None);
        }
        let first = self.samples(link, 0)?;
        let sizes = core::iter::successors(Some(self.erase_size), |size| size.checked_mul(2));
        for size in sizes.take_while(|&size| (size as usize) < file) {
            if self.samples(link, size)? == first {
                return Ok(Some(size));
            }
        }
        Ok(None)
    }

    /// The first words of the pages of a block.
    fn samples<L: RemoteLink>(
        &self,
        link: &mut L,
        block: u32,
    ) -> Result<Vec<u64>, RemoteLinkError> {
        let pages = self.pages().take(SAMPLES as usize);
        let samples = pages.map(|page| {
            set_offset(link, block + page)?;
            read_double(link, 0)
        });
        samples.collect()
    }

    /// The end of the last block that exists, if the last one of the file does not.
    fn ends_at<L: RemoteLink>(
        &self,
        link: &mut L,
        file: usize,
    ) -> Result<Option<u32>, UpdateError> {
        let last = (file.saturating_sub(1) / self.erase_size as usize) as u32;
        let (mut exists, mut ends) = (0, last);
        if self.exists(link, last)? {
            return Ok(None);
        }
        while ends - exists > 1 {
            let middle = exists.midpoint(ends);
            if self.exists(link, middle)? {
                exists = middle;
            } else {
                ends = middle;
            }
        }
        Ok(Some(ends * self.erase_size))
    }

    /// True if the flash memory has the block with this number.
    fn exists<L: RemoteLink>(&self, link: &mut L, block: u32) -> Result<bool, UpdateError> {
        link.exchange(RemoteAccess::WriteLocal(LocalLocation::STATUS, 0))?;
        set_offset(link, block * self.erase_size)?;
        if read_double(link, 0).is_err() {
            // A lost reply, or a remote that is silent at an address that it does not have.
            set_offset(link, 0)?;
            read_double(link, 0)?;
            set_offset(link, block * self.erase_size)?;
            return Ok(read_double(link, 0).is_ok());
        }
        let status = link.exchange(RemoteAccess::ReadLocal(LocalLocation::STATUS))? as u8;
        link.exchange(RemoteAccess::WriteLocal(LocalLocation::STATUS, 0))?;
        Ok(!LbpStatus::from_bits_retain(status).contains(LbpStatus::INVALID_ADDRESS))
    }

    /// Offset of the first data behind the end of a file of `file` bytes.
    pub(super) fn behind_end<L: RemoteLink>(
        &self,
        link: &mut L,
        file: u32,
    ) -> Result<Option<u32>, UpdateError> {
        let begin = file.next_multiple_of(self.write_size);
        let end = file.next_multiple_of(self.erase_size) + self.erase_size;
        set_offset(link, 0)?;
        let first = read_double(link, 0)?;
        for offset in (begin..end).step_by(self.write_size as usize) {
            let begins_block = offset % self.erase_size == 0;
            if begins_block && !self.exists(link, offset / self.erase_size)? {
                break;
            }
            set_offset(link, offset)?;
            let read = read_double(link, 0)?;
            // Behind its end the memory may wrap around to its beginning.
            if begins_block && read == first {
                break;
            }
            if read != ERASED {
                return Ok(Some(offset));
            }
        }
        Ok(None)
    }

    /// True if reads show the flash memory: the data then differ between pages. The bootloader's
    /// block, which is never empty, is read first.
    pub(super) fn shows_flash<L: RemoteLink>(&self, link: &mut L) -> Result<bool, RemoteLinkError> {
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
