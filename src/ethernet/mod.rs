//! Ethernet boards beside their registers: who they are, their EEPROM, their flash memory.
mod bitfile;
pub use bitfile::{Bitfile, BitfileError};
