//! Memory that is shared with a device or with another process. The only unsafe code of this crate.

#![expect(
    unsafe_code,
    reason = "mapped memory; each block has its reason, and a test counts the blocks"
)]

use core::ptr::NonNull;
use core::sync::atomic::AtomicU32;
use std::os::fd::AsFd;

use rustix::io::{Errno, Result};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

/// 32-bit words of a file, mapped shared.
#[derive(Debug)]
pub(crate) struct Mapping {
    words: NonNull<u32>,
    len: usize,
}

// SAFETY: the mapping belongs to the value, is valid in all threads, and is accessed by volatile or
// atomic operations only. Without `Sync` only one thread uses it at a time.
unsafe impl Send for Mapping {}

impl Mapping {
    /// Maps the first `len` words of a file.
    ///
    /// # Errors
    /// Those of the kernel, and `INVAL` if the file is shorter: an access behind its end would end
    /// the process.
    pub(crate) fn new(file: impl AsFd, len: usize) -> Result<Self> {
        let bytes = len.saturating_mul(4);
        let size = rustix::fs::fstat(&file)?.st_size;
        if bytes == 0 || usize::try_from(size).unwrap_or(0) < bytes {
            return Err(Errno::INVAL);
        }
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: the kernel chooses a free range, so that no other memory of the process is
        // replaced. The file has all of its bytes.
        let start = unsafe {
            mmap(
                core::ptr::null_mut(),
                bytes,
                access,
                MapFlags::SHARED,
                file,
                0,
            )?
        };
        // The kernel maps whole pages, whose addresses are multiples of 4.
        let words = NonNull::new(start.cast::<u32>()).ok_or(Errno::INVAL)?;
        Ok(Self { words, len })
    }

    /// Reads a word with one load of 32 bits. An index behind the end reads as all ones, like an
    /// address without a device.
    pub(crate) fn read(&self, index: usize) -> u32 {
        if index >= self.len {
            return u32::MAX;
        }
        // SAFETY: the index is within the mapping, which is valid and aligned until `drop`. A
        // volatile access is made once and as written, also where another party changes the word.
        unsafe { self.words.add(index).read_volatile() }
    }

    /// Writes a word with one store of 32 bits. An index behind the end has no effect.
    pub(crate) fn write(&mut self, index: usize, value: u32) {
        if index < self.len {
            // SAFETY: as in `read`.
            unsafe { self.words.add(index).write_volatile(value) }
        }
    }

    /// A word that both parties access atomically; `None` behind the end.
    pub(crate) fn atomic(&self, index: usize) -> Option<&AtomicU32> {
        (index < self.len).then(|| {
            // SAFETY: as in `read`. The reference lives no longer than the mapping.
            unsafe { AtomicU32::from_ptr(self.words.add(index).as_ptr()) }
        })
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: exactly this range was mapped by `new`, and no reference to it is left.
        let result = unsafe { munmap(self.words.as_ptr().cast(), self.len.saturating_mul(4)) };
        debug_assert_eq!(result, Ok(()), "the range is mapped");
    }
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::Ordering;
    use std::os::fd::OwnedFd;

    use rustix::fs::{MemfdFlags, ftruncate, memfd_create};

    use super::*;

    fn memory(bytes: u64) -> OwnedFd {
        let file = memfd_create("registers", MemfdFlags::CLOEXEC).expect("a memfd");
        ftruncate(&file, bytes).expect("a size");
        file
    }

    #[test]
    fn two_mappings_of_one_file_are_the_same_memory() {
        let file = memory(0x1_0000);
        let mut device = Mapping::new(&file, 0x4000).expect("mapped");
        let host = Mapping::new(&file, 0x4000).expect("mapped");
        device.write(0x3FFF, 0x55AA_CAFE);
        assert_eq!(host.read(0x3FFF), 0x55AA_CAFE);
        let word = host.atomic(0x3FFF).expect("a word");
        word.store(7, Ordering::Release);
        assert_eq!(device.read(0x3FFF), 7);
    }

    #[test]
    fn behind_the_end_there_is_nothing() {
        let file = memory(0x2000);
        let mut mapping = Mapping::new(&file, 0x400).expect("mapped");
        mapping.write(0x400, 1);
        assert_eq!(mapping.read(0x400), u32::MAX);
        assert!(mapping.atomic(0x400).is_none());
        let other = Mapping::new(&file, 0x800).expect("mapped");
        assert_eq!(other.read(0x400), 0, "not written");
    }

    #[test]
    fn file_that_is_too_short_is_not_mapped() {
        let file = memory(0xFFFF);
        assert_eq!(Mapping::new(&file, 0x4000).err(), Some(Errno::INVAL));
        assert_eq!(Mapping::new(&file, 0).err(), Some(Errno::INVAL));
    }
}
