//! What a bus error says, whatever the bus.

use core::fmt;

/// An error of a [`RegisterBus`](super::RegisterBus).
///
/// `Display` says what happened, where, how long was waited, and what to do.
pub trait BusError: core::error::Error + 'static {
    /// The kind, for code that treats buses alike.
    fn kind(&self) -> BusErrorKind;
}

/// What happened, as far as all buses have it in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum BusErrorKind {
    /// The reply came after the deadline.
    Late,
    /// No reply came at all.
    Lost,
    /// Only a reply to an earlier request came.
    Stale,
    /// Somebody is there and refuses: no board at this address and port.
    Refused,
    /// There is no way to the board.
    Unreachable,
    /// The reply has not the size that was asked for.
    Short,
    /// The access list does not fit: too long for a packet, or outside of its buffer.
    Invalid,
    /// Another program or host drives the device.
    Occupied,
    /// The device itself reported an error.
    Device,
    /// Anything else; see the message.
    Other,
}

impl fmt::Display for BusErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Late => "the reply came after the deadline",
            Self::Lost => "no reply came",
            Self::Stale => "only a reply to an earlier request came",
            Self::Refused => "somebody is there and refuses",
            Self::Unreachable => "there is no way to the board",
            Self::Short => "the reply has not the size that was asked for",
            Self::Invalid => "the access list does not fit",
            Self::Occupied => "another program or host drives the board",
            Self::Device => "the board reported an error",
            Self::Other => "the bus failed",
        })
    }
}

impl BusError for core::convert::Infallible {
    fn kind(&self) -> BusErrorKind {
        match *self {}
    }
}
