//! Ethernet boards beside their registers: who they are, their EEPROM, their flash memory.
mod bitfile;
mod flash;
pub use bitfile::{Bitfile, BitfileError};
pub use flash::{Area, Flash, FlashError, FlashLayout, FlashMemory, PAGE, SECTOR, Stage};
