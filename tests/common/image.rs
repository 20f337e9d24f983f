//! The memory of a remote without a port around it: recorded, or made by hand.

use super::replay::{memory_of, recording};
use mesa_hal::lbp::{RemoteAccess, RemoteLink, RemoteLinkError, RemoteLinkErrorKind};
use std::collections::BTreeMap;
use std::time::Duration;

/// A remote's memory. Bytes that are not set read 0; reads that touch a missing range fail.
#[derive(Clone, Debug, Default)]
pub struct Image {
    pub bytes: BTreeMap<u16, u8>,
    pub missing: Option<std::ops::RangeInclusive<u16>>,
    pub accesses: u32,
}

impl Image {
    pub fn recorded(name: &str, remote: u8) -> Self {
        Self {
            bytes: memory_of(&recording(name), remote),
            ..Self::default()
        }
    }

    pub fn put(&mut self, address: u16, bytes: &[u8]) {
        for (n, &byte) in (0..).zip(bytes) {
            self.bytes.insert(address.wrapping_add(n), byte);
        }
    }

    pub fn put_words(&mut self, address: u16, words: &[u16]) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        self.put(address, &bytes);
    }

    fn is_missing(&self, place: u16) -> bool {
        let missing = self.missing.as_ref();
        missing.is_some_and(|gap| gap.contains(&place))
    }
}

impl RemoteLink for Image {
    fn wait(&mut self, _: Duration) {}

    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, RemoteLinkError> {
        let RemoteAccess::Read { address, size } = access else {
            panic!("discovery writes: {access}");
        };
        self.accesses += 1;
        let mut value = 0;
        for n in 0..size.bytes() {
            let place = address + u16::from(n);
            if self.is_missing(place) {
                let text = format_args!("no reply at {place:#06X}");
                return Err(RemoteLinkError::new(RemoteLinkErrorKind::NoReply, text));
            }
            let byte = self.bytes.get(&place).copied().unwrap_or(0);
            value |= u64::from(byte) << (8 * n);
        }
        Ok(value)
    }
}
