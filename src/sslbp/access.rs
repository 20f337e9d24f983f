//! Pass-through accesses to a remote: what they are as registers.

use crate::lbp::RemoteAccess;

/// What a port takes for an access, and how it answers.
///
/// Manual: 7I77, "REMOTE READ EXAMPLE", "REMOTE WRITE EXAMPLE"; FACTS 6.1.
impl RemoteAccess {
    /// The word for CS: the LBP command in the top byte, the address in the low word.
    pub const fn cs_word(self) -> u32 {
        let address = match self {
            Self::Read { address, .. } | Self::Write { address, .. } => address,
            Self::ReadLocal(_) | Self::WriteLocal(..) => 0,
        };
        (self.command() as u32) << 24 | address as u32
    }

    /// The words for interface registers 0 and 1, if it writes.
    pub const fn data_words(self) -> Option<[u32; 2]> {
        match self {
            Self::Write { size, value, .. } => {
                let value = value & size.mask();
                Some([value as u32, (value >> 32) as u32])
            }
            Self::WriteLocal(_, value) => Some([value as u32, 0]),
            Self::Read { .. } | Self::ReadLocal(_) => None,
        }
    }

    /// The value that interface registers 0 and 1 hold after a read.
    pub const fn value(self, words: [u32; 2]) -> u64 {
        let [low, high] = words;
        let value = (high as u64) << 32 | low as u64;
        match self {
            Self::Read { size, .. } | Self::Write { size, .. } => value & size.mask(),
            Self::ReadLocal(_) | Self::WriteLocal(..) => value & 0xFF,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lbp::{AccessSize, LocalLocation};
    use proptest::prelude::*;

    const SIZES: [AccessSize; 4] = [
        AccessSize::Byte,
        AccessSize::Word,
        AccessSize::Long,
        AccessSize::Double,
    ];

    fn read(address: u16, size: AccessSize) -> RemoteAccess {
        RemoteAccess::Read { address, size }
    }

    /// Manual: 7I77, "REMOTE READ EXAMPLE" (45, and 44, 46, 47 for the other sizes), "REMOTE WRITE
    /// EXAMPLE" (65, and 64, 66, 67).
    #[test]
    fn commands_are_those_of_the_manual() {
        let reads = SIZES.map(|size| read(0x1234, size).cs_word());
        assert_eq!(reads, [0x4400_1234, 0x4500_1234, 0x4600_1234, 0x4700_1234]);
        let writes = SIZES.map(|size| {
            let (address, value) = (0x1234, 0);
            RemoteAccess::Write {
                address,
                size,
                value,
            }
            .cs_word()
        });
        assert_eq!(writes, [0x6400_1234, 0x6500_1234, 0x6600_1234, 0x6700_1234]);
    }

    /// Gateware transcript t05.
    #[test]
    fn recorded_accesses_have_these_words() {
        let write = RemoteAccess::Write {
            address: 0x308,
            size: AccessSize::Double,
            value: 0xFEDC_BA98_89AB_CDEF,
        };
        assert_eq!(write.cs_word(), 0x6700_0308);
        assert_eq!(write.data_words(), Some([0x89AB_CDEF, 0xFEDC_BA98]));
        assert_eq!(
            read(0x308, AccessSize::Double).value([0x89AB_CDEF, 0xFEDC_BA98]),
            0xFEDC_BA98_89AB_CDEF
        );
        assert_eq!(
            RemoteAccess::ReadLocal(LocalLocation::COOKIE).cs_word(),
            0xDF00_0000
        );
        assert_eq!(
            RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 1).cs_word(),
            0xEC00_0000
        );
    }

    proptest! {
        #[test]
        fn no_access_is_one_that_the_gateware_rejects(address: u16, value: u64, index in 0u8..64) {
            let mut accesses = std::vec::Vec::new();
            for size in SIZES {
                accesses.push(read(address, size));
                accesses.push(RemoteAccess::Write { address, size, value });
            }
            if let Some(location) = LocalLocation::new(index) {
                accesses.push(RemoteAccess::ReadLocal(location));
                accesses.push(RemoteAccess::WriteLocal(location, value as u8));
            }
            for access in accesses {
                prop_assert_ne!(access.cs_word() & 0x4000_0000, 0);
            }
        }

        #[test]
        fn a_value_comes_back_as_it_was_written(address: u16, value: u64, n in 0usize..4) {
            let size = SIZES[n];
            let write = RemoteAccess::Write { address, size, value };
            let words = write.data_words().unwrap();
            prop_assert_eq!(read(address, size).value(words), value & size.mask());
        }
    }
}
