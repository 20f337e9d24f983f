//! What a bus error says, whatever the bus.

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

impl BusError for core::convert::Infallible {
    fn kind(&self) -> BusErrorKind {
        match *self {}
    }
}
