//! Ethernet boards apart from their registers: identity, EEPROM and flash memory.
//!
//! An [`EthernetBoard`] is made from a bus that executes LBP16 packets ([`Lbp16Board`]), for
//! example [`UdpBus`](crate::transport::udp::UdpBus). All of it is for set-up and maintenance; the
//! cycle uses [`RegisterBus`](crate::bus::RegisterBus).

// A wrong sum would write to a wrong address.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod area;
mod bitfile;
mod error;
mod flash;
mod identity;
mod info;
mod memory;
mod packets;
mod restart;
mod spartan6;

pub use area::Area;
pub use bitfile::{Bitfile, BitfileError};
pub use error::EthernetError;
pub use flash::{Flash, FlashChange, FlashChip, FlashDifference, FlashStep, SpiFlash};
pub use identity::{AddressSource, Identity, MacAddress};
pub use info::{Counters, LedMode, LedTime, Timestamps};
pub use packets::{EthernetBoard, Lbp16Board};
pub use spartan6::MultibootFeature;
