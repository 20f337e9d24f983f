//! The operations of a port: their register words and durations.

use super::line::{DEFAULT_BAUD_RATE, USUAL_REMOTE_LATENCY};
use super::{Channel, ChannelMask, RemoteAccess};
use core::{fmt, time::Duration};

const WRITE: u32 = 1 << 15;
const RESET: u32 = 1 << 14;
const REQUEST: u32 = 1 << 13;
const DOIT: u32 = 1 << 12;
const STOP: u32 = 0x0800;
const START: u32 = 0x0900;
const SETUP_START: u32 = 0x0F00;

/// A word that COMMAND ignores, at any time: bit 31.
///
/// Manual: 7I77, "COMMAND REGISTER WRITE IGNORE".
pub const COMMAND_IGNORED: u32 = 1 << 31;

/// Highest address of the port's own memory that fits into COMMAND.
pub(super) const LAST_LOCAL: u16 = 0x0FFF;

/// Kind of START.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StartMode {
    /// For process data. Manual: 7I77, "NORMAL START".
    Normal,
    /// For pass-through accesses. Manual: 7I77, "SETUP MODE OPERATION".
    Setup,
}

/// An operation of a port: a command, with the registers that belong to it.
///
/// Only the commands that the manuals define can be made: other bits beside DOIT run the transfer
/// but leave COMMAND busy permanently (FACTS 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortOperation {
    /// Stops all channels and initialises everything, baud rates included: 0800.
    ///
    /// Not allowed while COMMAND is not 0, because it would then stay there permanently. Manual:
    /// 7I77, "STOP ALL"; FACTS 3.1 explains why the manual's "always" is wrong.
    StopAll,
    /// Stops these channels. An empty mask stops nothing, although its word would be STOPALL.
    ///
    /// Manual: 7I77, "STOP INDIVIDUAL CHANNELS".
    Stop(ChannelMask),
    /// Starts these channels, which are stopped; CS of each contains its software mode.
    Start(StartMode, ChannelMask),
    /// Transfers the process data of these channels, which run in normal mode (FACTS 5.5).
    ///
    /// Manual: 7I77, "DOIT".
    Transfer(ChannelMask),
    /// Performs one access to the remote on a channel that runs in setup mode.
    Access(Channel, RemoteAccess),
    /// Reads a byte of the port's own memory, which has 12 bits of address.
    ///
    /// Manual: 7I77, "LOCAL READ OPERATIONS".
    ReadLocal(u16),
    /// Writes a byte, which is in DATA, to the port's own memory. Manual: 7I77, "LOCAL WRITE
    /// OPERATIONS".
    WriteLocal(u16),
    /// Frees a port that is stuck: ends the waiting, but not the operation that is waited for.
    /// 08FF, the only word that may be written while COMMAND is not 0; clears COMMAND in 7 us.
    /// FACTS 3.1, 3.2.
    Free,
    /// Holds the port's processor in reset: 4000. FACTS 2.5.
    Reset,
    /// Ends the reset: 0001. FACTS 2.5.
    Release,
    /// An unknown command in COMMAND, written by another host or by an earlier run of this one.
    Foreign,
}

/// Durations of an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OperationTimes {
    /// Until COMMAND is 0, without errors.
    pub usual: Duration,
    /// Limit after which COMMAND is considered stuck.
    pub longest: Duration,
    /// From COMMAND = 0 until all registers have their final values.
    pub settle: Duration,
}

/// Firmware time of one access, which takes 39 us in all for a byte (FACTS 6.2).
const FIRMWARE: Duration = Duration::from_micros(7);

impl PortOperation {
    /// Durations of the operation. A port with a clock of 33 MHz takes three times as long as the
    /// recorded ones.
    ///
    /// Source: FACTS 2.5, 3, 3.3, 4.2, 5.2, 6.2; `tests/protocol/sslbp_stepped.rs` checks the
    /// longest times against all recordings.
    pub(super) fn times(&self) -> OperationTimes {
        let (usual, longest, settle) = match self {
            // The registers are wiped 1 to 6 us after COMMAND is 0.
            Self::StopAll => (125, 5_000, 50),
            Self::Stop(_) => (7, 5_000, 50),
            // 17 ms for an absent remote, which corresponds to 20 errors of one kind; there are
            // seven kinds.
            Self::Start(StartMode::Normal, _) => (1_000, 120_000, 0),
            // 55 ms for an absent remote.
            Self::Start(StartMode::Setup, _) => (1_800, 400_000, 0),
            Self::Transfer(_) => (50, 20_000, 0),
            // 49.8 ms without a reply.
            Self::Access(_, access) => (usual_time(*access).as_micros() as u64, 200_000, 0),
            Self::ReadLocal(_) | Self::WriteLocal(_) => (1, 5_000, 0),
            // Detected twice: soon after COMMAND is 0 the word is treated as invalid and cleared
            // once more, and a command written in between is lost.
            Self::Free => (7, 5_000, 20),
            Self::Reset => (20, 5_000, 0),
            // The initialisation takes 142 us.
            Self::Release => (500, 5_000, 0),
            Self::Foreign => (0, 120_000, 0),
        };
        OperationTimes {
            usual: Duration::from_micros(usual),
            longest: Duration::from_micros(longest),
            settle: Duration::from_micros(settle),
        }
    }

    /// Time until COMMAND is 0, without errors. A port with a clock of 33 MHz takes three times as
    /// long.
    pub fn usual_time(&self) -> Duration {
        self.times().usual
    }

    /// Limit of that time: a COMMAND that is busy for longer is stuck.
    pub fn longest_time(&self) -> Duration {
        self.times().longest
    }

    /// The word for COMMAND; a word that the register ignores if there is nothing to do.
    pub fn command(&self) -> u32 {
        match *self {
            Self::StopAll => STOP,
            Self::Stop(ChannelMask::NONE) | Self::Foreign => COMMAND_IGNORED,
            Self::Stop(mask) => STOP | u32::from(mask.bits()),
            Self::Start(StartMode::Normal, mask) => START | u32::from(mask.bits()),
            Self::Start(StartMode::Setup, mask) => SETUP_START | u32::from(mask.bits()),
            Self::Transfer(mask) => DOIT | u32::from(mask.bits()),
            Self::Access(channel, _) => DOIT | u32::from(channel.mask().bits()),
            Self::ReadLocal(address) => local(REQUEST, address),
            Self::WriteLocal(address) => local(WRITE | REQUEST, address),
            Self::Free => STOP | 0xFF,
            Self::Reset => RESET,
            Self::Release => 1,
        }
    }

    /// The channels concerned.
    pub const fn channels(&self) -> ChannelMask {
        match self {
            Self::StopAll => ChannelMask::first(u8::MAX),
            Self::Stop(mask) | Self::Start(_, mask) | Self::Transfer(mask) => *mask,
            Self::Access(channel, _) => channel.mask(),
            _ => ChannelMask::NONE,
        }
    }

    /// True if COMMAND may be written regardless of its content (FACTS 2.5, 3.1).
    pub(super) const fn interrupts(&self) -> bool {
        matches!(self, Self::Free | Self::Reset | Self::Release)
    }
}

/// The request, or an ignored word for an address that would be truncated to another one.
fn local(request: u32, address: u16) -> u32 {
    if address <= LAST_LOCAL {
        return request | u32::from(address);
    }
    debug_assert!(false, "the port's memory has no {address:#X}");
    COMMAND_IGNORED
}

impl fmt::Display for PortOperation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StopAll => f.write_str("STOPALL"),
            Self::Stop(mask) => write!(f, "stop of channels {mask}"),
            Self::Start(StartMode::Normal, mask) => write!(f, "START of channels {mask}"),
            Self::Start(StartMode::Setup, mask) => write!(f, "setup START of channels {mask}"),
            Self::Transfer(mask) => write!(f, "DOIT of channels {mask}"),
            Self::Access(channel, access) => write!(f, "DOIT of channel {channel}: {access}"),
            Self::ReadLocal(address) => write!(f, "local read at {address:#05X}"),
            Self::WriteLocal(address) => write!(f, "local write at {address:#05X}"),
            Self::Free => f.write_str("the way out"),
            Self::Reset => f.write_str("reset"),
            Self::Release => f.write_str("release from reset"),
            Self::Foreign => return f.write_str("another program's command"),
        }?;
        write!(f, " ({:04X})", self.command())
    }
}

/// Word for CS of a channel before START: its software mode in the top byte.
///
/// Manual: 7I77, "REMOTE MODES".
pub const fn software_mode_word(mode: u8) -> u32 {
    (mode as u32) << 24
}

/// Encoding of an access in a port's registers.
///
/// Manual: 7I77, "REMOTE READ EXAMPLE", "REMOTE WRITE EXAMPLE"; FACTS 6.1.
pub trait PortAccess {
    /// The word for CS: the LBP command in the top byte, the address in the low word.
    fn cs_word(self) -> u32;

    /// The words for interface registers 0 and 1, for a write.
    fn data_words(self) -> Option<[u32; 2]>;

    /// The value in interface registers 0 and 1 after a read.
    fn value(self, words: [u32; 2]) -> u64;
}

impl PortAccess for RemoteAccess {
    fn cs_word(self) -> u32 {
        let address = match self {
            Self::Read { address, .. } | Self::Write { address, .. } => address,
            Self::ReadLocal(_) | Self::WriteLocal(..) => 0,
        };
        u32::from(self.command()) << 24 | u32::from(address)
    }

    fn data_words(self) -> Option<[u32; 2]> {
        let value = self.written()?;
        Some([value as u32, (value >> 32) as u32])
    }

    fn value(self, [low, high]: [u32; 2]) -> u64 {
        let value = u64::from(high) << 32 | u64::from(low);
        match self {
            Self::Read { size, .. } | Self::Write { size, .. } => value & size.mask(),
            Self::ReadLocal(_) | Self::WriteLocal(..) => value & 0xFF,
        }
    }
}

/// Duration of an access without errors, at the default baud rate.
fn usual_time(access: RemoteAccess) -> Duration {
    let bits = u64::from(access.characters()) * 10;
    let line = Duration::from_nanos(bits * 1_000_000_000 / u64::from(DEFAULT_BAUD_RATE));
    line + USUAL_REMOTE_LATENCY + FIRMWARE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sslbp::{AccessSize, LocalLocation};
    use alloc::string::ToString;
    use proptest::prelude::*;

    const SIZES: [AccessSize; 4] = [
        AccessSize::Byte,
        AccessSize::Word,
        AccessSize::Long,
        AccessSize::Double,
    ];

    fn mask(bits: u8) -> ChannelMask {
        ChannelMask::from_bits(bits)
    }

    /// Manual: 7I77, "COMMAND REGISTER", "NORMAL START", "STOP ALL", "STOP INDIVIDUAL CHANNELS",
    /// "NORMAL MODE OPERATION" and "SETUP MODE OPERATION". Gateware transcripts t01 (parameter 7,
    /// scratch 66, 4000 and 0001) and t18 (baud rate, 9A).
    #[test]
    fn words_are_those_of_the_manual_and_of_the_transcripts() {
        use PortOperation as O;
        let words = [
            (O::StopAll, 0x800),
            (O::Stop(mask(0x02)), 0x802),
            (O::Start(StartMode::Normal, mask(0x07)), 0x907),
            (O::Start(StartMode::Setup, mask(0x01)), 0xF01),
            (O::Transfer(mask(0x03)), 0x1003),
            (O::ReadLocal(0x007), 0x2007),
            (O::ReadLocal(0x230), 0x2230),
            (O::WriteLocal(0x066), 0xA066),
            (O::WriteLocal(0x09A), 0xA09A),
            (O::Reset, 0x4000),
            (O::Release, 0x0001),
            (O::Foreign, 0x8000_0000),
        ];
        for (operation, word) in words {
            assert_eq!(operation.command(), word, "{operation}");
        }
    }

    #[test]
    fn stopping_no_channel_is_not_stopping_all() {
        let nothing = PortOperation::Stop(ChannelMask::NONE);
        assert_eq!(nothing.command(), COMMAND_IGNORED);
    }

    #[test]
    fn operation_is_shown_with_its_command_word() {
        let doit = PortOperation::Transfer(mask(5)).to_string();
        assert_eq!(doit, "DOIT of channels 0,2 (1005)");
        assert_eq!(PortOperation::StopAll.to_string(), "STOPALL (0800)");
        assert_eq!(PortOperation::Free.to_string(), "the way out (08FF)");
        let read = PortOperation::ReadLocal(3).to_string();
        assert_eq!(read, "local read at 0x003 (2003)");
    }

    /// Manual: 7I77, "REMOTE READ EXAMPLE" (45, and 44, 46, 47 for the other sizes), "REMOTE WRITE
    /// EXAMPLE" (65, and 64, 66, 67).
    #[test]
    fn accesses_are_those_of_the_manual() {
        let reads = SIZES.map(|size| {
            RemoteAccess::Read {
                address: 0x1234,
                size,
            }
            .cs_word()
        });
        assert_eq!(reads, [0x4400_1234, 0x4500_1234, 0x4600_1234, 0x4700_1234]);
        let writes = SIZES.map(|size| {
            RemoteAccess::Write {
                address: 0x1234,
                size,
                value: 0,
            }
            .cs_word()
        });
        assert_eq!(writes, [0x6400_1234, 0x6500_1234, 0x6600_1234, 0x6700_1234]);
    }

    /// Gateware transcript t05.
    #[test]
    fn recorded_accesses_have_these_words() {
        let value = 0xFEDC_BA98_89AB_CDEF;
        let write = RemoteAccess::Write {
            address: 0x308,
            size: AccessSize::Double,
            value,
        };
        assert_eq!(write.cs_word(), 0x6700_0308);
        assert_eq!(write.data_words(), Some([0x89AB_CDEF, 0xFEDC_BA98]));
        let read = RemoteAccess::Read {
            address: 0x308,
            size: AccessSize::Double,
        };
        assert_eq!(read.value([0x89AB_CDEF, 0xFEDC_BA98]), value);
        let cookie = RemoteAccess::ReadLocal(LocalLocation::COOKIE);
        assert_eq!(cookie.cs_word(), 0xDF00_0000);
        let select = RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 1);
        assert_eq!(select.cs_word(), 0xEC00_0000);
    }

    #[test]
    fn size_is_the_smallest_that_holds_the_bits() {
        let bits = [0, 1, 8, 9, 16, 17, 32, 33, 64, 65];
        let bytes = bits.map(|bits| AccessSize::for_bits(bits).map_or(0, AccessSize::bytes));
        assert_eq!(bytes, [0, 1, 1, 2, 2, 4, 4, 8, 8, 0]);
    }

    proptest! {
        #[test]
        fn no_access_is_one_that_the_gateware_rejects(address: u16, value: u64, index in 0u8..64) {
            let mut accesses = std::vec::Vec::new();
            if let Some(location) = LocalLocation::new(index) {
                accesses.push(RemoteAccess::ReadLocal(location));
                accesses.push(RemoteAccess::WriteLocal(location, value as u8));
            }
            for size in SIZES {
                accesses.push(RemoteAccess::Read { address, size });
                accesses.push(RemoteAccess::Write { address, size, value });
            }
            for access in accesses {
                prop_assert_ne!(access.cs_word() & 0x4000_0000, 0);
            }
        }

        #[test]
        fn value_comes_back_as_it_was_written(address: u16, value: u64, n in 0usize..4) {
            let size = SIZES[n];
            let words = RemoteAccess::Write { address, size, value }.data_words().unwrap();
            let read = RemoteAccess::Read { address, size };
            prop_assert_eq!(read.value(words), value & size.mask());
        }
    }
}
