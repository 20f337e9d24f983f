//! The info areas of the board's spaces.

use mesa_wire::lbp16::{
    Command, ElementSize, ErrorRegister, InfoArea, MemoryRanges, MemorySizes, MemoryType, Space,
};

/// The info area of a space; `None` for the space that does not exist.
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

/// End of a space's registers: the byte address after the last one.
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

/// Checks a command against the sizes of a space; returns the error that the board counts.
///
/// Info areas are read only and 16 bits wide, whatever their space is. Manual: 7I97, "INFO AREA".
pub(super) fn check(sizes: MemorySizes, command: Command) -> Result<(), ErrorRegister> {
    const INFO: MemorySizes = MemorySizes::new(MemoryType::Memory, ElementSize::Word, false);
    let sizes = if command.info { INFO } else { sizes };
    if !sizes.allows(command.size) {
        return Err(ErrorRegister::MEMORY);
    }
    if command.write && !sizes.writable() {
        return Err(ErrorRegister::WRITE);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const RW32: MemorySizes = MemorySizes::new(MemoryType::Memory, ElementSize::Double, true);
    const RO16: MemorySizes = MemorySizes::new(MemoryType::Memory, ElementSize::Word, false);

    #[test]
    fn size_and_direction_are_checked() {
        let read = Command::read(Space::HostMot2, 1);
        let write = Command::write(Space::HostMot2, 1);
        assert_eq!(check(RW32, read), Ok(()));
        assert_eq!(check(RW32, write), Ok(()));
        assert_eq!(check(RO16, read), Err(ErrorRegister::MEMORY));
        let size = ElementSize::Word;
        let write = Command { size, ..write };
        assert_eq!(check(RO16, write), Err(ErrorRegister::WRITE));
    }

    #[test]
    fn info_areas_are_read_only_and_16_bits() {
        let info = Command::read_info(Space::HostMot2, 1);
        assert_eq!(check(RW32, info), Ok(()));
        let size = ElementSize::Double;
        let wide = Command { size, ..info };
        assert_eq!(check(RW32, wide), Err(ErrorRegister::MEMORY));
        let write = Command {
            write: true,
            ..info
        };
        assert_eq!(check(RW32, write), Err(ErrorRegister::WRITE));
    }
}
