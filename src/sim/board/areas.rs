//! The info areas of the board's spaces.

use crate::lbp16::{ElementSize, InfoArea, MemoryRanges, MemorySizes, MemoryType, Space};

/// What a space is; `None` for the one that does not exist.
///
/// Manual: 7I97, "INFO AREA" and "7I97 SUPPORTED MEMORY SPACES".
pub(super) const fn info_area(space: Space) -> Option<InfoArea> {
    use MemoryType::{Eeprom, Flash, Memory, Register};
    let (kind, writable, ranges, name) = match space {
        Space::HostMot2 => (Register, true, MemoryRanges::new(0, 0, 16), *b"HostMot2"),
        Space::EthernetChip => (Register, true, MemoryRanges::new(0, 0, 8), *b"KSZ8851R"),
        Space::Eeprom => (Eeprom, true, MemoryRanges::new(0, 0, 7), *b"EtherEEP"),
        Space::Flash => (Flash, true, MemoryRanges::new(16, 8, 21), *b"FPGAFlsh"),
        Space::Timer => (Memory, true, MemoryRanges::new(0, 0, 5), *b"Timers\0\0"),
        Space::Unused => return None,
        Space::Control => (Memory, true, MemoryRanges::new(0, 0, 5), *b"LBP16RW\0"),
        Space::ReadOnly => (Memory, false, MemoryRanges::new(0, 0, 5), *b"LBP16RO\0"),
    };
    let size = match space {
        Space::HostMot2 | Space::Flash => ElementSize::Double,
        _ => ElementSize::Word,
    };
    Some(InfoArea {
        space,
        sizes: MemorySizes::new(kind, size, writable),
        ranges,
        pointer: 0,
        name,
    })
}

/// One past the last byte address of a space's registers.
pub(super) const fn end(space: Space) -> u32 {
    match space {
        // Four registers in front of the flash.
        Space::Flash => 0x10,
        _ => match info_area(space) {
            Some(area) => area.ranges.range() as u32,
            None => 0,
        },
    }
}
