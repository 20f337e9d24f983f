//! The boot block of a chip, checked and written.

use super::{Area, Flash, FlashStep};
use crate::boards::FlashLayout;
use crate::ethernet::spartan6::BootBlock;
use crate::ethernet::{EthernetError, FlashChip};

impl FlashLayout {
    /// The content of a valid boot block, to be written at its start: a header that makes the FPGA
    /// load the user configuration, and the fallback if that cannot be loaded; then zeros.
    ///
    /// Source: Xilinx UG380; FACTS 10.2.
    pub fn boot_page(&self) -> [u8; BootBlock::PAGE] {
        BootBlock::of(self).page()
    }
}

impl<C: FlashChip> Flash<C> {
    /// Checks the boot block as mesaflash does: its first 64 bytes are those of
    /// [`boot_page`](FlashLayout::boot_page).
    ///
    /// # Errors
    /// [`EthernetError::NoBootBlock`] if it is erased, [`EthernetError::OtherBootBlock`] if it
    /// differs, and errors of the bus.
    pub fn check_boot_block(&mut self) -> Result<(), EthernetError> {
        let mut head = [0; BootBlock::BYTES];
        self.read(self.layout.boot_block.0, &mut head)?;
        self.check_boot_head(&head)
    }

    /// Erases the boot block, writes a valid one, and verifies it, on an erased chip too. Until it
    /// is written, the board does not start: a write that is cut off can be repeated only while the
    /// FPGA keeps running.
    ///
    /// # Errors
    /// [`EthernetError::Differs`], and errors of the bus.
    pub fn write_boot_block(
        &mut self,
        progress: impl FnMut(FlashStep, usize),
    ) -> Result<(), EthernetError> {
        let page = self.layout.boot_page();
        self.write(Area::BootBlock, self.layout.boot_block.0, &page, progress)
    }

    /// Checks the first bytes of a boot block.
    pub(super) fn check_boot_head(&self, head: &[u8]) -> Result<(), EthernetError> {
        let (address, _) = self.layout.boot_block;
        if head.iter().all(|&byte| byte == 0xFF) {
            return Err(EthernetError::NoBootBlock { address });
        }
        let block = BootBlock::of(&self.layout);
        let bytes = (address..).zip(head.iter().zip(block.bytes()));
        for (address, (&found, &expected)) in bytes {
            if found != expected {
                return Err(EthernetError::OtherBootBlock {
                    address,
                    expected,
                    found,
                });
            }
        }
        Ok(())
    }
}
