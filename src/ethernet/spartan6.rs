//! Configuration packets of a Spartan-6: the boot block, and a multiboot file that excludes it.
//!
//! Source: Xilinx UG380, "Configuration Packets" and "Configuration Registers"; manual 7I97,
//! "FALLBACK" and "BITFILE FORMAT". The words of the boot block are those that mesaflash 3.4.6
//! writes to a simulated board (FACTS 10.2).

use core::fmt;

use crate::boards::FlashLayout;
use crate::lbp16::registers::flash::PAGE;

/// Configuration registers.
mod register {
    pub const CMD: u16 = 0x05;
    pub const CWDT: u16 = 0x0F;
    pub const HC_OPT: u16 = 0x10;
    pub const GENERAL1: u16 = 0x13;
    pub const GENERAL2: u16 = 0x14;
    pub const GENERAL3: u16 = 0x15;
    pub const GENERAL4: u16 = 0x16;
    pub const MODE: u16 = 0x18;
}

/// Values of the CMD register.
mod command {
    pub const NULL: u16 = 0x00;
    pub const DESYNC: u16 = 0x0D;
    pub const IPROG: u16 = 0x0E;
}

/// Fast read command of the flash memory, the high byte of an address in a pair of GENERAL
/// registers.
const FAST_READ: u32 = 0x0B;
const NO_OPERATION: u16 = 0x2000;
const DUMMY: u16 = 0xFFFF;
/// Synchronisation word: packets begin behind it.
const SYNC: [u16; 2] = [0xAA99, 0x5566];
/// A write of one word to register 0.
const WRITE_ONE: u16 = 0x3001;

/// Words of the boot block that the FPGA reads.
const WORDS: usize = BootBlock::BYTES / 2;

/// The boot block of a memory: it makes the FPGA load the user configuration, and the fallback if
/// that cannot be loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BootBlock([u8; BootBlock::BYTES]);

impl BootBlock {
    /// Bytes that the FPGA reads, and that mesaflash compares.
    pub(super) const BYTES: usize = 64;
    /// Bytes of the page that it is written with.
    pub(super) const PAGE: usize = PAGE;

    pub(super) fn of(layout: &FlashLayout) -> Self {
        let [user, fallback] = [layout.user.0, layout.fallback.0].map(|address| {
            let high = FAST_READ << 8 | address >> 16;
            (address as u16, high as u16)
        });
        let writes = [
            (register::CWDT, 0xFFFF),
            (register::GENERAL1, user.0),
            (register::GENERAL2, user.1),
            (register::GENERAL3, fallback.0),
            (register::GENERAL4, fallback.1),
            (register::CMD, command::NULL),
            (register::MODE, 0x2100),
            (register::HC_OPT, 0x001F),
            (register::CMD, command::IPROG),
        ];
        let writes = writes.map(|(register, value)| [WRITE_ONE | register << 5, value]);
        let words = [DUMMY; 5]
            .into_iter()
            .chain(SYNC)
            .chain(writes.into_iter().flatten());
        let mut bytes = [0; Self::BYTES];
        let words = words.chain([NO_OPERATION; WORDS]);
        for (bytes, word) in bytes.chunks_mut(2).zip(words) {
            bytes.copy_from_slice(&word.to_be_bytes());
        }
        Self(bytes)
    }

    pub(super) const fn bytes(&self) -> &[u8; Self::BYTES] {
        &self.0
    }

    /// The page as it is written: zeros behind the words.
    pub(super) fn page(&self) -> [u8; PAGE] {
        let mut page = [0; PAGE];
        for (to, from) in page.iter_mut().zip(self.0) {
            *to = from;
        }
        page
    }
}

/// Feature of a file for several configurations, which the boot block excludes: it does the same
/// itself, with its own addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Multiboot {
    /// Offset in the configuration.
    pub(super) at: usize,
    /// The feature, as a verb phrase.
    pub(super) what: MultibootFeature,
}

/// Kind of a multiboot feature. `Display` writes it as a verb phrase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MultibootFeature {
    /// The command IPROG: the FPGA loads another configuration.
    Jump,
    /// An address of another configuration, in a GENERAL register.
    Address,
    /// A second configuration follows the first.
    Second,
}

impl fmt::Display for MultibootFeature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Jump => "makes the FPGA load another configuration (IPROG)",
            Self::Address => "sets the address of another configuration (GENERAL1 to GENERAL4)",
            Self::Second => "begins a second configuration",
        })
    }
}

impl Multiboot {
    /// The first multiboot feature of a configuration, as far as its packets can be read: up to the
    /// frame data, and a synchronisation word behind those.
    pub(super) fn find(configuration: &[u8]) -> Option<Self> {
        let mut packets = Packets::new(configuration)?;
        for packet in packets.by_ref() {
            let at = packet.at;
            match (packet.register, packet.value) {
                (register::CMD, command::IPROG) => {
                    let what = MultibootFeature::Jump;
                    return Some(Self { at, what });
                }
                (register::CMD, command::DESYNC) => break,
                (register::GENERAL1..=register::GENERAL4, _) if packet.address() != 0 => {
                    let what = MultibootFeature::Address;
                    return Some(Self { at, what });
                }
                _ => {}
            }
        }
        let behind = packets.behind_data?;
        let second = sync_at(configuration.get(behind..)?)?;
        Some(Self {
            at: behind.saturating_add(second),
            what: MultibootFeature::Second,
        })
    }
}

/// Offset of the first synchronisation word.
pub(super) fn sync_at(bytes: &[u8]) -> Option<usize> {
    let [[a, b], [c, d]] = SYNC.map(u16::to_be_bytes);
    let sync = [a, b, c, d];
    bytes.windows(sync.len()).position(|window| window == sync)
}

/// A write of one word to a configuration register.
#[derive(Clone, Copy, Debug)]
struct Packet {
    at: usize,
    register: u16,
    value: u16,
}

impl Packet {
    /// The part of an address in a GENERAL register: the high byte of GENERAL2 and GENERAL4 is the
    /// read command of the flash memory.
    const fn address(&self) -> u16 {
        match self.register {
            register::GENERAL2 | register::GENERAL4 => self.value & 0x00FF,
            _ => self.value,
        }
    }
}

/// The packets of a configuration up to its frame data, or to a word that is no packet.
struct Packets<'a> {
    configuration: &'a [u8],
    at: usize,
    /// Offset behind the frame data, once these were reached.
    behind_data: Option<usize>,
}

impl<'a> Packets<'a> {
    /// Starts behind the synchronisation word.
    fn new(configuration: &'a [u8]) -> Option<Self> {
        Some(Self {
            configuration,
            at: sync_at(configuration)?.saturating_add(size_of_val(&SYNC)),
            behind_data: None,
        })
    }

    fn word(&mut self) -> Option<u16> {
        let bytes = self.configuration.get(self.at..)?.first_chunk()?;
        self.at = self.at.saturating_add(2);
        Some(u16::from_be_bytes(*bytes))
    }
}

impl Iterator for Packets<'_> {
    type Item = Packet;

    fn next(&mut self) -> Option<Packet> {
        const WRITE: u16 = 2;
        while self.behind_data.is_none() {
            let at = self.at;
            let header = self.word()?;
            let (kind, operation) = (header >> 13, header >> 11 & 3);
            let (register, count) = (header >> 5 & 0x3F, usize::from(header & 0x1F));
            match (kind, operation) {
                _ if header == DUMMY => {}
                (1, 0 | 1) => {}
                (1, WRITE) => {
                    let rest = count.checked_sub(1)?.saturating_mul(2);
                    let value = self.word()?;
                    self.at = self.at.saturating_add(rest);
                    return Some(Packet {
                        at,
                        register,
                        value,
                    });
                }
                (2, WRITE) => {
                    let (high, low) = (self.word()?, self.word()?);
                    let words = usize::from(high) << 16 | usize::from(low);
                    let bytes = words.saturating_mul(2);
                    self.behind_data = Some(self.at.saturating_add(bytes));
                }
                _ => return None,
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec::Vec;
    use proptest::prelude::*;

    /// The first 64 bytes of the memory after mesaflash 3.4.6 has written a boot block into a
    /// simulated 7I97. FACTS 10.2.
    #[rustfmt::skip]
    const OF_7I97: [u8; 64] = [
        0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xAA, 0x99, 0x55, 0x66, 0x31, 0xE1,
        0xFF, 0xFF, 0x32, 0x61, 0x00, 0x00, 0x32, 0x81, 0x0B, 0x10, 0x32, 0xA1, 0x00, 0x00, 0x32, 0xC1,
        0x0B, 0x01, 0x30, 0xA1, 0x00, 0x00, 0x33, 0x01, 0x21, 0x00, 0x32, 0x01, 0x00, 0x1F, 0x30, 0xA1,
        0x00, 0x0E, 0x20, 0x00, 0x20, 0x00, 0x20, 0x00, 0x20, 0x00, 0x20, 0x00, 0x20, 0x00, 0x20, 0x00,
    ];

    #[test]
    fn boot_block_matches_mesaflash_and_rest_of_its_page_is_zero() {
        let block = BootBlock::of(&FlashLayout::I7I97);
        assert_eq!(block.bytes(), &OF_7I97);
        let page = block.page();
        let (head, rest) = page.split_at(64);
        assert_eq!(head, OF_7I97);
        assert!(rest.iter().all(|&byte| byte == 0));
    }

    /// The packets of a configuration before its frame data, the data, and the end.
    fn standard(header: &[u16]) -> Vec<u8> {
        let data = 300_u16;
        let mut words = vec![DUMMY; 8];
        words.extend(SYNC);
        // Reset of the CRC, IDCODE of a 6SLX9, no operation.
        words.extend([0x30A1, 0x0007, 0x31C2, 0x0400, 0x1093, NO_OPERATION]);
        words.extend(header);
        // WCFG, and frame data by a packet of type 2.
        words.extend([0x30A1, 0x0001, 0x5060, 0, data]);
        words.extend((0..data).map(|n| n.wrapping_mul(40_503)));
        words.extend([0x30A1, command::DESYNC, NO_OPERATION]);
        words.into_iter().flat_map(u16::to_be_bytes).collect()
    }

    fn found(configuration: &[u8]) -> Option<MultibootFeature> {
        Multiboot::find(configuration).map(|found| found.what)
    }

    #[test]
    fn standard_configuration_has_no_multiboot_feature() {
        assert_eq!(found(&standard(&[])), None);
        // Registers of the next configuration that are written, with address 0.
        let zeros = [0x3261, 0, 0x3281, 0x0B00, 0x32A1, 0, 0x32C1, 0];
        assert_eq!(found(&standard(&zeros)), None);
        // The words of IPROG inside of frame data.
        let mut inside = standard(&[]);
        let end = inside.len() - 100;
        inside[end..end + 4].copy_from_slice(&[0x30, 0xA1, 0x00, 0x0E]);
        assert_eq!(found(&inside), None);
        assert_eq!(found(&[0xFF; 300]), None);
    }

    #[test]
    fn each_multiboot_feature_is_found_at_its_place() {
        let jump = standard(&[0x30A1, 0x000E]);
        let first = Multiboot::find(&jump).expect("it is there");
        assert_eq!((first.what, first.at), (MultibootFeature::Jump, 32));
        for address in [[0x3261, 1], [0x3281, 0x0B10], [0x32A1, 2], [0x32C1, 0x0B01]] {
            let found = found(&standard(&address));
            assert_eq!(found, Some(MultibootFeature::Address), "{address:X?}");
        }
        let one = standard(&[]);
        let two = [&one[..], &one[..]].concat();
        let second = Multiboot::find(&two).expect("it is there");
        assert_eq!(second.what, MultibootFeature::Second);
        assert_eq!(second.at, one.len() + 16);
        // An image of the memory begins with the boot block.
        let image = [&OF_7I97[..], &one].concat();
        assert_eq!(found(&image), Some(MultibootFeature::Address));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let _ = Multiboot::find(&bytes);
            let mut words: Vec<u8> = SYNC.into_iter().flat_map(u16::to_be_bytes).collect();
            words.extend(bytes);
            if let Some(found) = Multiboot::find(&words) {
                prop_assert!(found.at < words.len());
            }
        }
    }
}
