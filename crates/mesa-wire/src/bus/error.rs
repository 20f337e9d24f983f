//! Bus errors, common to all buses.

use super::BusAdvice;
use core::fmt;

/// An error of a [`RegisterBus`](super::RegisterBus).
///
/// `Display` names the failure, its place and the time waited.
pub trait BusError: core::error::Error + 'static {
    /// The kind of error, for code that treats all buses alike.
    fn kind(&self) -> BusErrorKind;

    /// The next step, if there is one; `None` by default.
    fn advice(&self) -> Option<BusAdvice> {
        None
    }
}

/// Kinds of bus errors, as far as all buses share them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum BusErrorKind {
    /// The reply arrived after the deadline.
    Late,
    /// No reply arrived.
    Lost,
    /// Only a reply to an earlier request arrived.
    Stale,
    /// The host refuses: no board at this address and port.
    Refused,
    /// There is no route to the board.
    Unreachable,
    /// The reply has the wrong size.
    Short,
    /// The access list is too long for a packet, or exceeds its buffer.
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
