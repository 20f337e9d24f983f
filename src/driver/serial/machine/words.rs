//! What a read shows, what COMMAND is told, and what both mean.

use core::time::Duration;

use crate::bus::Instant;
use crate::sslbp::{Channel as Number, ChannelMask, Command, MAX_CHANNELS};

/// For each channel of a port.
pub(crate) type PerChannel<T> = [T; MAX_CHANNELS as usize];

/// What one read showed of a port.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Observation {
    pub command: u32,
    pub data: u32,
    pub cs: PerChannel<u32>,
    /// Interface registers 0 to 2; only looked at when START is complete.
    pub start: PerChannel<[u32; 3]>,
}

/// What a read means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Outcome {
    /// Channels whose data is new and sound.
    pub good: ChannelMask,
    /// Channels with a transfer whose data must not be used.
    pub failed: ChannelMask,
    /// Channels that were set aside just now.
    pub set_aside: ChannelMask,
    /// The transfer was not complete in time.
    pub too_short: bool,
    /// When the transfer was started that `good` and `failed` are about, and how many reads could
    /// not take it before.
    pub started: Instant,
    pub reads_before: u32,
}

/// What COMMAND was told last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Transfer(ChannelMask),
    Stop(ChannelMask),
    Start(ChannelMask),
    Free,
}

/// A command that is not known to be complete.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pending {
    pub asked: Asked,
    pub issued: Instant,
    /// It is known that the board got it.
    pub sure: bool,
    pub busy_reads: u32,
    /// Reads since it was written that did not show it complete, failed ones included.
    pub reads_before: u32,
    /// Its time has been counted.
    pub measured: bool,
}

/// How far the restart of channels is. They are restarted together, because every attempt takes
/// the others' transfers away for a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Restart {
    None,
    /// Stopped; the others get a transfer before the START, which takes long.
    Stopped {
        mask: ChannelMask,
        others_served: bool,
    },
    Starting,
}

/// What to write next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Next {
    pub command: Command,
    /// Output data belongs to it; otherwise what was written before must be repeated unchanged,
    /// because a transfer that still runs may be reading it.
    pub with_data: bool,
}

impl Asked {
    /// How long it may take. FACTS 3, 5.2; START is allowed what setup START needs.
    pub const fn limit(self) -> Duration {
        match self {
            Self::Transfer(_) => Duration::from_millis(20),
            Self::Start(_) => Duration::from_millis(60),
            Self::Stop(_) | Self::Free => Duration::from_millis(5),
        }
    }

    pub fn command(self) -> Command {
        match self {
            Self::Transfer(mask) => Command::doit(mask),
            Self::Stop(mask) => Command::stop(mask).unwrap_or(Command::IGNORED),
            Self::Start(mask) => Command::start(mask),
            Self::Free => Command::FREE,
        }
    }
}

/// What belongs to one channel.
pub(super) fn at<T: Copy + Default>(all: &PerChannel<T>, number: Number) -> T {
    all.get(usize::from(number.index()))
        .copied()
        .unwrap_or_default()
}
