//! Bytes of a remote's memory, fetched with as few accesses as possible.

use super::RemoteMemory;
use crate::sslbp::AccessSize;
use alloc::collections::BTreeMap;

/// Limits on what one remote can make discovery do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DiscoveryLimits {
    /// Accesses to the remote's memory.
    pub accesses: u32,
    /// Addresses that can not be read. Each costs some hundred milliseconds.
    pub failures: u32,
    /// Entries of a table of contents.
    pub entries: u16,
    /// Characters of a string, its end not counted.
    pub string: u16,
}

impl Default for DiscoveryLimits {
    fn default() -> Self {
        Self {
            accesses: 4096,
            failures: 4,
            entries: 255,
            string: 255,
        }
    }
}

/// Why a byte is not to be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unreadable {
    /// The access failed.
    Failed(u16),
    /// A limit has been reached; nothing more is read.
    GaveUp,
}

/// Reads ahead in doubles, and reads no byte twice.
pub(super) struct Reader<'m, M: RemoteMemory> {
    memory: &'m mut M,
    limits: DiscoveryLimits,
    /// What has been read. Never larger than eight bytes for each access.
    known: BTreeMap<u16, u8>,
    /// The largest access that works with this remote.
    size: AccessSize,
    accesses: u32,
    failures: u32,
    error: Option<M::Error>,
}

impl<'m, M: RemoteMemory> Reader<'m, M> {
    pub fn new(memory: &'m mut M, limits: DiscoveryLimits) -> Self {
        Self {
            memory,
            limits,
            known: BTreeMap::new(),
            size: AccessSize::Double,
            accesses: 0,
            failures: 0,
            error: None,
        }
    }

    pub fn limits(&self) -> DiscoveryLimits {
        self.limits
    }

    /// Accesses so far.
    pub fn accesses(&self) -> u32 {
        self.accesses
    }

    /// The last access that failed.
    pub fn into_error(self) -> Option<M::Error> {
        self.error
    }

    pub fn byte(&mut self, address: u16) -> Result<u8, Unreadable> {
        if let Some(&byte) = self.known.get(&address) {
            return Ok(byte);
        }
        self.fetch(address)?;
        let byte = self.known.get(&address);
        byte.copied().ok_or(Unreadable::Failed(address))
    }

    /// Reads ahead from `address` on; with smaller accesses if a large one fails, because the
    /// remote's memory may end there.
    fn fetch(&mut self, address: u16) -> Result<(), Unreadable> {
        if self.failures >= self.limits.failures {
            return Err(Unreadable::GaveUp);
        }
        loop {
            if self.accesses >= self.limits.accesses {
                return Err(Unreadable::GaveUp);
            }
            self.accesses += 1;
            let size = self.size;
            let first = address.min(u16::MAX - u16::from(size.bytes() - 1));
            match self.memory.read(first, size) {
                Ok(value) => {
                    self.keep(first, size, value);
                    return Ok(());
                }
                Err(error) => self.error = Some(error),
            }
            let Some(smaller) = smaller(size) else {
                self.failures += 1;
                self.size = AccessSize::Double;
                return Err(Unreadable::Failed(address));
            };
            self.size = smaller;
        }
    }

    fn keep(&mut self, first: u16, size: AccessSize, value: u64) {
        let bytes = value.to_le_bytes();
        for (address, byte) in (first..=u16::MAX).zip(bytes).take(size.bytes().into()) {
            self.known.insert(address, byte);
        }
    }
}

const fn smaller(size: AccessSize) -> Option<AccessSize> {
    match size {
        AccessSize::Double => Some(AccessSize::Word),
        AccessSize::Long | AccessSize::Word => Some(AccessSize::Byte),
        AccessSize::Byte => None,
    }
}
