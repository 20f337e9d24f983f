//! What a port can be told, which words that takes, and how long it lasts.

use core::time::Duration;

use super::super::{
    Channel, ChannelMask, Command, CsStatus, DEFAULT_BAUD_RATE, LocalAddress, PortState,
    RemoteAccess, USUAL_REMOTE_LATENCY,
};

/// Which START.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StartMode {
    /// For process data. Manual: 7I77, "NORMAL START".
    Normal,
    /// For pass-through accesses. Manual: 7I77, "SETUP MODE OPERATION".
    Setup,
}

impl StartMode {
    /// What a port is in when a channel has come through this START.
    pub const fn state(self) -> PortState {
        match self {
            Self::Normal => PortState::Normal,
            Self::Setup => PortState::Setup,
        }
    }
}

/// One operation of a port: a command, with the registers that belong to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Stops all channels and initialises everything, baud rates included.
    StopAll,
    /// Stops these channels; none of them stops nothing.
    Stop(ChannelMask),
    /// Starts these channels, which are stopped; CS of each holds its software mode.
    Start(StartMode, ChannelMask),
    /// Transfers the process data of these channels, which run in normal mode.
    Transfer(ChannelMask),
    /// One access to the remote on a channel that runs in setup mode.
    Access(Channel, RemoteAccess),
    /// Reads a byte of the port's own memory.
    ReadLocal(LocalAddress),
    /// Writes a byte of the port's own memory.
    WriteLocal(LocalAddress, u8),
    /// Frees a port that is stuck: ends the waiting, and not what it waits for (FACTS 3.2).
    Free,
    /// Holds the port's processor in reset.
    Reset,
    /// Ends the reset.
    Release,
    /// Whatever another host, or an earlier run of this one, has written to COMMAND.
    Foreign,
}

/// How long an operation takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// Until COMMAND is 0, where all is well.
    pub usual: Duration,
    /// After this time COMMAND is stuck.
    pub longest: Duration,
    /// From COMMAND = 0 until all registers are as the operation leaves them.
    pub settle: Duration,
}

impl Times {
    const fn micros(usual: u64, longest: u64, settle: u64) -> Self {
        Self {
            usual: Duration::from_micros(usual),
            longest: Duration::from_micros(longest),
            settle: Duration::from_micros(settle),
        }
    }
}

/// The firmware's own time for one access: 39 us in all for a byte (FACTS 6.2).
const FIRMWARE: Duration = Duration::from_micros(7);

impl Operation {
    /// How long it takes. A port with a clock of 33 MHz takes three times as long as those that
    /// were recorded.
    ///
    /// Source: FACTS 2.5, 3, 3.3, 4.2, 5.2, 6.2; the longest times against all recordings in
    /// `tests/protocol/sslbp_stepped.rs`.
    pub fn times(&self) -> Times {
        match self {
            // The registers are wiped 1 to 6 us after COMMAND is 0.
            Self::StopAll => Times::micros(125, 5_000, 50),
            Self::Stop(_) => Times::micros(7, 5_000, 50),
            // 17 ms for a remote that is absent, which is 20 errors of one kind; there are seven.
            Self::Start(StartMode::Normal, _) => Times::micros(1_000, 120_000, 0),
            // 55 ms for a remote that is absent.
            Self::Start(StartMode::Setup, _) => Times::micros(1_800, 400_000, 0),
            Self::Transfer(_) => Times::micros(50, 20_000, 0),
            // 49.8 ms without a reply.
            Self::Access(_, access) => Times {
                usual: access_time(*access),
                ..Times::micros(0, 200_000, 0)
            },
            Self::ReadLocal(_) | Self::WriteLocal(..) => Times::micros(1, 5_000, 0),
            // It is found twice: soon after COMMAND is 0 it is taken as invalid and cleared once
            // more, and a command written in between is lost.
            Self::Free => Times::micros(7, 5_000, 20),
            Self::Reset => Times::micros(20, 5_000, 0),
            // The initialisation takes 142 us.
            Self::Release => Times::micros(500, 5_000, 0),
            Self::Foreign => Times::micros(0, 120_000, 0),
        }
    }

    /// The word for COMMAND; one that the register ignores where there is nothing to be told.
    pub fn command(&self) -> Command {
        match *self {
            Self::StopAll => Command::STOP_ALL,
            Self::Stop(mask) => Command::stop(mask).unwrap_or(Command::IGNORED),
            Self::Start(StartMode::Normal, mask) => Command::start(mask),
            Self::Start(StartMode::Setup, mask) => Command::setup_start(mask),
            Self::Transfer(mask) => Command::doit(mask),
            Self::Access(channel, _) => Command::doit(channel.mask()),
            Self::ReadLocal(address) => Command::local_read(address),
            Self::WriteLocal(address, _) => Command::local_write(address),
            Self::Free => Command::FREE,
            Self::Reset => Command::RESET,
            Self::Release => Command::RELEASE,
            Self::Foreign => Command::IGNORED,
        }
    }

    /// The channels that it is about.
    pub const fn channels(&self) -> ChannelMask {
        match self {
            Self::StopAll => ChannelMask::first(u8::MAX),
            Self::Stop(mask) | Self::Start(_, mask) | Self::Transfer(mask) => *mask,
            Self::Access(channel, _) => channel.mask(),
            _ => ChannelMask::NONE,
        }
    }

    /// Whether COMMAND may be written with it whatever it reads (FACTS 2.5, 3.1).
    pub(in crate::sslbp) const fn interrupts(&self) -> bool {
        matches!(self, Self::Free | Self::Reset | Self::Release)
    }
}

fn access_time(access: RemoteAccess) -> Duration {
    let bits = u64::from(access.characters()) * 10;
    let line = Duration::from_nanos(bits * 1_000_000_000 / u64::from(DEFAULT_BAUD_RATE));
    line + USUAL_REMOTE_LATENCY + FIRMWARE
}

/// What CS of a channel is written with before START: its software mode in the top byte.
///
/// Manual: 7I77, "REMOTE MODES".
pub const fn software_mode_word(mode: u8) -> u32 {
    (mode as u32) << 24
}

/// What CS means to the operations.
impl CsStatus {
    /// Whether a channel that was stopped before has come through this START. DATA does not count:
    /// of a START that the network delivered twice it says FF (FACTS 3.3).
    pub(crate) const fn has_started(self, mode: StartMode) -> bool {
        use super::super::ComState::{Chatter, PassThrough, ProcessData7i64};
        let has_arrived = match mode {
            StartMode::Normal => matches!(self.state(), Chatter | ProcessData7i64),
            StartMode::Setup => matches!(self.state(), PassThrough),
        };
        has_arrived && self.is_ready()
    }
}
