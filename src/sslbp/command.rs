//! COMMAND: the words that tell a port what to do.

use super::ChannelMask;
use core::fmt;

/// A word for the COMMAND register.
///
/// Only the words that the manuals define can be made: other bits beside DOIT run the transfer but
/// leave COMMAND busy for ever (FACTS 3).
///
/// Manual: 7I77, "COMMAND REGISTER".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Command(u32);

const WRITE: u32 = 1 << 15;
const RESET: u32 = 1 << 14;
const REQUEST: u32 = 1 << 13;
const DOIT: u32 = 1 << 12;
const STOP: u32 = 0x0800;
const START: u32 = 0x0900;
const SETUP_START: u32 = 0x0F00;

impl Command {
    /// Stops all channels and initialises everything: 0800.
    ///
    /// Never write it while COMMAND is not 0: it would stay there for good. Manual: 7I77,
    /// "STOP ALL"; FACTS 3.1 says why the manual's "always" is wrong.
    pub const STOP_ALL: Self = Self(STOP);

    /// The way out of a COMMAND that never clears: 08FF.
    ///
    /// The only word that may be written while COMMAND is not 0. It clears COMMAND in 7 us and does
    /// not stop a transfer that runs. FACTS 3.1, 3.2.
    pub const FREE: Self = Self(STOP | 0xFF);

    /// A word that the register ignores, at any time: bit 31.
    ///
    /// Manual: 7I77, "COMMAND REGISTER WRITE IGNORE".
    pub const IGNORED: Self = Self(1 << 31);

    /// Holds the port's processor in reset: 4000. FACTS 2.5.
    pub const RESET: Self = Self(RESET);

    /// Ends the reset: 0001. FACTS 2.5.
    pub const RELEASE: Self = Self(1);

    /// Stops the channels of `mask`; `None` for no channel, because that word is STOPALL.
    ///
    /// Manual: 7I77, "STOP INDIVIDUAL CHANNELS".
    pub const fn stop(mask: ChannelMask) -> Option<Self> {
        if mask.is_empty() {
            None
        } else {
            Some(Self(STOP | mask.bits() as u32))
        }
    }

    /// Normal START of the channels of `mask`. Manual: 7I77, "NORMAL START".
    pub const fn start(mask: ChannelMask) -> Self {
        Self(START | mask.bits() as u32)
    }

    /// Setup START of the channels of `mask`. Manual: 7I77, "SETUP MODE OPERATION".
    pub const fn setup_start(mask: ChannelMask) -> Self {
        Self(SETUP_START | mask.bits() as u32)
    }

    /// Transfer of process data, or of one pass-through access, on the channels of `mask`.
    ///
    /// Only channels that run belong into the mask (FACTS 5.5). Manual: 7I77, "DOIT".
    pub const fn doit(mask: ChannelMask) -> Self {
        Self(DOIT | mask.bits() as u32)
    }

    /// Read of a byte of the port's own memory. Manual: 7I77, "LOCAL READ OPERATIONS".
    pub const fn local_read(address: LocalAddress) -> Self {
        Self(REQUEST | address.0 as u32)
    }

    /// Write of a byte of the port's own memory. Manual: 7I77, "LOCAL WRITE OPERATIONS".
    pub const fn local_write(address: LocalAddress) -> Self {
        Self(WRITE | REQUEST | address.0 as u32)
    }

    /// The word for the register.
    pub const fn word(self) -> u32 {
        self.0
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = self.0;
        let mask = ChannelMask::from_bits(word as u8);
        let address = word & u32::from(LocalAddress::MAX);
        match word {
            _ if word & (1 << 31) != 0 => f.write_str("an ignored write")?,
            _ if word & RESET != 0 => f.write_str("reset")?,
            _ if word & (WRITE | REQUEST) == WRITE | REQUEST => {
                write!(f, "local write at {address:#05X}")?;
            }
            _ if word & REQUEST != 0 => write!(f, "local read at {address:#05X}")?,
            _ if word & DOIT != 0 => write!(f, "DOIT of channels {mask}")?,
            STOP => f.write_str("STOPALL")?,
            _ if word & !0xFF == STOP => write!(f, "stop of channels {mask}")?,
            _ if word & !0xFF == START => write!(f, "START of channels {mask}")?,
            _ if word & !0xFF == SETUP_START => write!(f, "setup START of channels {mask}")?,
            _ => f.write_str("release from reset")?,
        }
        write!(f, " ({word:04X})")
    }
}

/// Address of a byte in the port's own memory: 12 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LocalAddress(u16);

impl LocalAddress {
    /// Local parameter 3: minor revision of the firmware.
    pub const MINOR: Self = Self(3);

    /// The highest address that COMMAND has room for.
    pub const MAX: u16 = 0x0FFF;

    /// `address`, if it has at most 12 bits.
    pub const fn new(address: u16) -> Option<Self> {
        if address <= Self::MAX {
            Some(Self(address))
        } else {
            None
        }
    }

    /// The address.
    pub const fn get(self) -> u16 {
        self.0
    }
}

impl fmt::Display for LocalAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#05X}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    fn mask(bits: u8) -> ChannelMask {
        ChannelMask::from_bits(bits)
    }

    /// Manual: 7I77, "COMMAND REGISTER", "NORMAL START", "STOP ALL", "STOP INDIVIDUAL CHANNELS",
    /// "NORMAL MODE OPERATION" and "SETUP MODE OPERATION".
    #[test]
    fn the_words_are_those_of_the_manual() {
        assert_eq!(Command::STOP_ALL.word(), 0x800);
        assert_eq!(Command::stop(mask(0x02)).map(Command::word), Some(0x802));
        assert_eq!(Command::start(mask(0x07)).word(), 0x907);
        assert_eq!(Command::setup_start(mask(0x01)).word(), 0xF01);
        assert_eq!(Command::doit(mask(0x03)).word(), 0x1003);
        assert_eq!(Command::IGNORED.word(), 0x8000_0000);
    }

    /// Gateware transcripts t01 (parameter 7, scratch 66, 4000 and 0001) and t18 (baud rate, 9A).
    #[test]
    fn local_words_are_those_of_the_transcripts() {
        let at = |address| LocalAddress::new(address).unwrap();
        assert_eq!(Command::local_read(at(0x007)).word(), 0x2007);
        assert_eq!(Command::local_read(at(0x230)).word(), 0x2230);
        assert_eq!(Command::local_write(at(0x066)).word(), 0xA066);
        assert_eq!(Command::local_write(at(0x09A)).word(), 0xA09A);
        assert_eq!(Command::RESET.word(), 0x4000);
        assert_eq!(Command::RELEASE.word(), 0x0001);
    }

    #[test]
    fn stopping_no_channel_is_not_stopping_all() {
        assert_eq!(Command::stop(ChannelMask::NONE), None);
    }

    #[test]
    fn addresses_of_more_than_twelve_bits_are_refused() {
        assert_eq!(LocalAddress::new(0x1000), None);
        assert_eq!(LocalAddress::new(0xFFF).map(LocalAddress::get), Some(0xFFF));
    }

    #[test]
    fn a_command_says_what_it_does() {
        assert_eq!(
            Command::doit(mask(5)).to_string(),
            "DOIT of channels 0,2 (1005)"
        );
        assert_eq!(Command::STOP_ALL.to_string(), "STOPALL (0800)");
        assert_eq!(
            Command::FREE.to_string(),
            "stop of channels 0,1,2,3,4,5,6,7 (08FF)"
        );
        assert_eq!(
            Command::local_read(LocalAddress::new(3).unwrap()).to_string(),
            "local read at 0x003 (2003)"
        );
    }
}
