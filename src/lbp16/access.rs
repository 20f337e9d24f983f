//! Whether a space takes an access.

#[cfg(feature = "std")]
use super::{Command, ElementSize, Lbp16Error, MemorySizes};

/// Checks a command against what its space allows (its MEMSIZES word); `None`: there is no such
/// space.
///
/// Info areas are read only and 16 bits wide, whatever their space is. Manual: 7I97, "INFO AREA".
#[cfg(feature = "std")]
pub fn check_access(command: Command, sizes: Option<MemorySizes>) -> Result<(), Lbp16Error> {
    let (space, size) = (command.space, command.size);
    let sizes = sizes.ok_or(Lbp16Error::NoSpace { space })?;
    let allowed = if command.info {
        size == ElementSize::Word
    } else {
        sizes.allows(size)
    };
    if !allowed {
        let info = command.info;
        return Err(Lbp16Error::Size { space, info, size });
    }
    if command.write && (command.info || !sizes.writable()) {
        return Err(Lbp16Error::ReadOnly {
            space,
            info: command.info,
        });
    }
    Ok(())
}

pub(super) const fn area(info: bool) -> &'static str {
    if info { " (its info area)" } else { "" }
}

#[cfg(test)]
mod tests {
    use super::super::Space;
    use super::*;
    use crate::lbp16::MemoryType;

    const RW32: MemorySizes = MemorySizes::new(MemoryType::Memory, ElementSize::Double, true);
    const RO16: MemorySizes = MemorySizes::new(MemoryType::Memory, ElementSize::Word, false);

    #[test]
    fn size_direction_and_existence_are_checked() {
        let space = Space::HostMot2;
        let read = Command::read(space, 1).unwrap();
        let write = Command::write(space, 1).unwrap();
        assert_eq!(check_access(read, Some(RW32)), Ok(()));
        assert_eq!(check_access(write, Some(RW32)), Ok(()));
        let size = ElementSize::Double;
        assert_eq!(
            check_access(read, Some(RO16)),
            Err(Lbp16Error::Size {
                space,
                info: false,
                size
            })
        );
        assert_eq!(
            check_access(write.with_size(ElementSize::Word), Some(RO16)),
            Err(Lbp16Error::ReadOnly { space, info: false })
        );
        assert_eq!(check_access(read, None), Err(Lbp16Error::NoSpace { space }));
    }

    #[test]
    fn info_areas_are_read_only_and_16_bits() {
        let space = Space::HostMot2;
        let info = Command::read_info(space, 1).unwrap();
        assert_eq!(check_access(info, Some(RW32)), Ok(()));
        let size = ElementSize::Double;
        assert_eq!(
            check_access(info.with_size(size), Some(RW32)),
            Err(Lbp16Error::Size {
                space,
                info: true,
                size
            })
        );
        let mut write = info;
        write.write = true;
        assert_eq!(
            check_access(write, Some(RW32)),
            Err(Lbp16Error::ReadOnly { space, info: true })
        );
    }
}
