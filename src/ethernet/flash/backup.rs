//! Backup and restoration of a whole chip.

use alloc::vec::Vec;

use super::{Area, Flash, PACKET, Padding, SECTOR_BYTES};
use crate::ethernet::spartan6::BootBlock;
use crate::ethernet::{Bitfile, EthernetError, FlashChip, FlashStep};
use crate::lbp16::registers::flash::{PAGE, SECTOR};

/// Sectors in which a chip differs from a backup, and which are written together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct FlashDifference {
    /// The area; `None` for sectors that no configuration uses.
    pub area: Option<Area>,
    /// Its first address.
    pub start: u32,
    /// The address behind its end.
    pub end: u32,
}

/// The named areas, in the order of restoration. A chip that can start from its user configuration
/// may lose the others.
const AREAS: [Area; 4] = [
    Area::User,
    Area::Application,
    Area::Fallback,
    Area::BootBlock,
];

impl<C: FlashChip> Flash<C> {
    /// Reads the whole chip. `progress` receives the number of bytes read, and cancels by returning
    /// `false`; the result is then `None`.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn backup(
        &mut self,
        mut progress: impl FnMut(usize) -> bool,
    ) -> Result<Option<Vec<u8>>, EthernetError> {
        let size = self.layout.size as usize;
        let mut bytes = Vec::with_capacity(size);
        let mut part = [0; PACKET];
        while bytes.len() < size {
            self.read(bytes.len() as u32, &mut part)?;
            bytes.extend_from_slice(&part);
            if !progress(bytes.len()) {
                return Ok(None);
            }
        }
        Ok(Some(bytes))
    }

    /// Checks that a file can be a backup of this chip, from which the board would start.
    ///
    /// A backup has no header: the board that it was made from cannot be determined.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`] if its size is wrong, [`EthernetError::NoBootBlock`], and
    /// [`EthernetError::NoUserConfiguration`] if it has neither a user configuration nor a
    /// fallback.
    pub fn check_backup(&self, backup: &[u8]) -> Result<(), EthernetError> {
        self.check(Area::Whole, 0, backup.len(), true)?;
        let (address, _) = self.layout.boot_block;
        let head = self.of(Area::BootBlock, backup).get(..PAGE);
        if head.is_none_or(|head| head.iter().all(|&byte| byte == 0xFF)) {
            return Err(EthernetError::NoBootBlock { address });
        }
        let begins = |area| {
            let head = self.of(area, backup).get(..Bitfile::SYNC_WITHIN);
            head.is_some_and(Bitfile::has_sync)
        };
        if !begins(Area::User) && !begins(Area::Fallback) {
            let (address, _) = self.layout.user;
            return Err(EthernetError::NoUserConfiguration { address });
        }
        Ok(())
    }

    /// Checks that the boot block of a backup may be written: it is as
    /// [`check_boot_block`](Self::check_boot_block) demands.
    ///
    /// # Errors
    /// [`EthernetError::NoBootBlock`] and [`EthernetError::OtherBootBlock`].
    pub fn check_backup_boot_block(&self, backup: &[u8]) -> Result<(), EthernetError> {
        let head = self.of(Area::BootBlock, backup).get(..BootBlock::BYTES);
        self.check_boot_head(head.unwrap_or_default())
    }

    /// Differences between the chip and a backup, in the order in which they should be [written
    /// back](Self::restore): the user area first, the boot block last.
    ///
    /// A difference in an area starts at the beginning of the area, so that an incomplete
    /// configuration has no beginning, and ends with the last sector that differs. `progress`
    /// receives the number of bytes compared, and cancels by returning `false`; the result is then
    /// `None`.
    ///
    /// # Errors
    /// [`EthernetError::OutsideArea`] if the size of the backup is wrong, and errors of the bus.
    pub fn differences(
        &mut self,
        backup: &[u8],
        progress: impl FnMut(usize) -> bool,
    ) -> Result<Option<Vec<FlashDifference>>, EthernetError> {
        self.check(Area::Whole, 0, backup.len(), true)?;
        let Some(found) = self.backup(progress)? else {
            return Ok(None);
        };
        let sectors = || backup.chunks(SECTOR).zip(found.chunks(SECTOR));
        let differs: Vec<u32> = (0..)
            .step_by(SECTOR)
            .zip(sectors())
            .filter_map(|(start, (wanted, found))| (wanted != found).then_some(start))
            .collect();
        let mut differences = Vec::new();
        for area in AREAS {
            let range = self.layout.addresses(area);
            let last = differs.iter().rev().find(|start| range.contains(start));
            differences.extend(last.map(|last| FlashDifference {
                area: Some(area),
                start: range.start,
                end: last.saturating_add(SECTOR_BYTES),
            }));
        }
        let named = |start: &u32| {
            AREAS
                .iter()
                .any(|&area| self.layout.addresses(area).contains(start))
        };
        let others = differs.iter().filter(|start| !named(start));
        let others = others.map(|&start| FlashDifference {
            area: None,
            start,
            end: start.saturating_add(SECTOR_BYTES),
        });
        // Behind the user area, before the areas that the board may need to start.
        let at = differences
            .partition_point(|one| matches!(one.area, Some(Area::User | Area::Application)));
        differences.splice(at..at, others);
        Ok(Some(differences))
    }

    /// Performs the checks of [`restore`](Self::restore) that precede the erasing.
    ///
    /// # Errors
    /// Errors of [`check_backup`](Self::check_backup), for the boot block errors of
    /// [`check_backup_boot_block`](Self::check_backup_boot_block), [`EthernetError::NoFallback`]
    /// for the user area while the chip has no fallback, [`EthernetError::NoUserConfiguration`] for
    /// the fallback or the boot block while it has no user configuration, and errors of the bus.
    pub fn check_restore(
        &mut self,
        backup: &[u8],
        part: &FlashDifference,
    ) -> Result<(), EthernetError> {
        self.check_backup(backup)?;
        if part.area == Some(Area::BootBlock) {
            self.check_backup_boot_block(backup)?;
        }
        part.area.map_or(Ok(()), |area| self.need_other(area))
    }

    /// Writes one of the [differences](Self::differences) back, and verifies it.
    ///
    /// # Errors
    /// Errors of [`check_restore`](Self::check_restore) and of [`write`](Self::write).
    pub fn restore(
        &mut self,
        backup: &[u8],
        part: &FlashDifference,
        mut progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        self.check_restore(backup, part)?;
        let bytes = part.start as usize..part.end as usize;
        let expected = || alloc::format!("whole sectors up to 0x{:06X}", self.layout.size);
        let data = backup
            .get(bytes)
            .ok_or_else(|| EthernetError::OutsideArea {
                address: part.start,
                bytes: part.end.saturating_sub(part.start) as usize,
                area: Area::Whole,
                expected: expected(),
            })?;
        self.put(part.start, data, Padding::Erased, &mut progress)
    }

    /// The bytes of an area in a backup.
    fn of<'b>(&self, area: Area, backup: &'b [u8]) -> &'b [u8] {
        let range = self.layout.addresses(area);
        let bytes = backup.get(range.start as usize..range.end as usize);
        bytes.unwrap_or_default()
    }
}
