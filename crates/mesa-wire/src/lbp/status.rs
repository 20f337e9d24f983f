//! The flag bytes of LBP.

use bitflags::bitflags;
use core::fmt;

/// The value of [`LocalLocation::COOKIE`](super::LocalLocation::COOKIE).
pub const COOKIE: u8 = 0x5A;

bitflags! {
    /// The LBP status of a remote (C1); errors stay until E1 clears them. Unknown bits are kept.
    ///
    /// Manual: 7I77, "LOCAL LBP READ COMMANDS"; FACTS 1.5.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct LbpStatus: u8 {
        /// A command arrived too slowly and was dropped.
        const FRAME_TIMEOUT = 0x40;
        /// A write to a protected area, or to an address that does not exist.
        const INVALID_ADDRESS = 0x20;
        /// A command longer than the remote's buffer.
        const BUFFER_OVERFLOW = 0x10;
        /// The watchdog has bitten.
        const WATCHDOG = 0x08;
        /// A command with a wrong CRC was dropped.
        const CRC_ERROR = 0x01;
        const _ = !0;
    }
}

bitflags! {
    /// Capabilities of a remote (D4). Unknown bits are kept.
    ///
    /// FACTS 1.3.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct Capabilities: u8 {
        /// The remote checks CRCs.
        const CRC = 0x01;
        /// The remote has an EEPROM for its parameters.
        const EEPROM = 0x04;
        /// The remote's program can be updated over LBP.
        const FLASH = 0x08;
        const _ = !0;
    }
}

bitflags! {
    /// The fault byte of a remote: D7, first byte of each process-data reply, byte 3 of CS.
    /// Unknown bits are kept.
    ///
    /// Manual: 7I77, "CS REGISTER AFTER DOIT".
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct RemoteFaults: u8 {
        /// The remote detected errors on the line.
        const COMMUNICATION = 0x80;
        /// START requested a software mode that the remote does not have.
        const ILLEGAL_MODE = 0x40;
        /// Field power is missing or too low.
        const LOW_VOLTAGE = 0x20;
        /// Field power is too high.
        const HIGH_VOLTAGE = 0x10;
        /// An output is overloaded or short-circuited.
        const OVER_CURRENT = 0x08;
        /// An output driver is too hot.
        const OVER_TEMPERATURE = 0x04;
        /// The enable input is not active.
        const NO_ENABLE = 0x02;
        /// No process data for longer than the watchdog time: the outputs are off. Also set after
        /// power-up.
        const WATCHDOG = 0x01;
        const _ = !0;
    }
}

const REMOTE_FAULT_WORDS: [&str; 8] = [
    "watchdog has bitten",
    "enable missing",
    "too hot",
    "output overloaded",
    "field voltage too high",
    "field voltage too low or missing",
    "unknown software mode",
    "errors on its line",
];

impl fmt::Display for RemoteFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_flags(f, self.bits(), &REMOTE_FAULT_WORDS, "no remote fault")
    }
}

/// Writes the words of the set bits, from bit 0 on, or `none`.
pub fn write_flags(
    f: &mut fmt::Formatter<'_>,
    bits: u8,
    words: &[&str; 8],
    none: &str,
) -> fmt::Result {
    if bits == 0 {
        return f.write_str(none);
    }
    let set = (0u8..).zip(words).filter(|&(n, _)| bits & (1 << n) != 0);
    for (count, (_, word)) in set.enumerate() {
        let separator = if count == 0 { "" } else { ", " };
        write!(f, "{separator}{word}")?;
    }
    Ok(())
}

/// Registers of a remote's program flash, reachable while
/// [`NonvolatileMemory::Flash`](super::NonvolatileMemory::Flash) is selected.
///
/// FACTS 1.6.
pub mod flash {
    /// 32 bits: offset in the flash of the block to erase or to write.
    pub const OFFSET: u16 = 0x8000;
    /// One byte: log2 of the size of an erase block.
    pub const LOG2_ERASE_SIZE: u16 = 0x8004;
    /// One byte: log2 of the size of a write block.
    pub const LOG2_WRITE_SIZE: u16 = 0x8005;
    /// One byte: writing it carries out [`COMMIT_ERASE`] or [`COMMIT_WRITE`].
    pub const COMMIT: u16 = 0x8007;
    /// Erases the block at the offset.
    pub const COMMIT_ERASE: u8 = 0xFE;
    /// Writes the buffer at address 0 to the offset.
    pub const COMMIT_WRITE: u8 = 0xFD;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flag_bytes_keep_bits_that_have_no_name() {
        assert_eq!(LbpStatus::from_bits_retain(0xFF).bits(), 0xFF);
        assert_eq!(LbpStatus::from_bits_truncate(0x82).bits(), 0x82);
        assert_eq!(RemoteFaults::from_bits_truncate(0x41).bits(), 0x41);
        assert_eq!(Capabilities::from_bits_truncate(0x05).bits(), 0x05);
    }
}
