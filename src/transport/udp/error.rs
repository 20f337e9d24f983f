//! Errors between the host and an Ethernet board.

use core::time::Duration;

#[cfg(feature = "std")]
use super::SocketError;
use crate::Rounded;
use crate::advice::Advice;
use crate::bus::{Access, BusAdvice, BusError, BusErrorKind};

/// An exchange with an Ethernet board failed. `E` is the error of its
/// [link](super::PacketLink::Error).
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UdpError<#[cfg(feature = "std")] E = SocketError, #[cfg(not(feature = "std"))] E> {
    /// No reply at all within the deadline.
    #[error(
        "request {request}: no reply within {}",
        Rounded(.waited)
    )]
    Lost {
        /// Number of the request.
        request: u32,
        /// Time waited.
        waited: Duration,
    },
    /// The reply came, but after the deadline.
    #[error(
        "request {request}: the reply came after {}, {} too late; \
         the host was busy with something else, or the network is",
        Rounded(.waited),
        Rounded(.by)
    )]
    Late {
        /// Number of the request.
        request: u32,
        /// Time waited.
        waited: Duration,
        /// Time by which the deadline was missed.
        by: Duration,
    },
    /// Only replies to earlier requests arrived.
    #[error(
        "request {request}: within {} came only the reply to request {got}; \
         the network delays packets by more than the deadline",
        Rounded(.waited)
    )]
    Stale {
        /// Number of the request.
        request: u32,
        /// Number that the reply carries.
        got: u32,
        /// Time waited.
        waited: Duration,
    },
    /// An exchange of set-up was repeated, and none of its tries got a reply in time.
    #[error(
        "request {request}: no reply in time in {tries} tries within {}, at the last {last}",
        Rounded(.within)
    )]
    GaveUp {
        /// Number of the last request.
        request: u32,
        /// Number of tries.
        tries: u32,
        /// Time from the first try to the end of the last.
        within: Duration,
        /// Result of the last try: [`BusErrorKind::Lost`], [`BusErrorKind::Late`] or
        /// [`BusErrorKind::Stale`].
        last: BusErrorKind,
    },
    /// Datagrams arrived, but none was a reply to any request.
    #[error(
        "request {request}: no reply among the datagrams that came within {} ({datagrams}): they are not from a \
         Mesa board, or were changed on their way",
        Rounded(.waited)
    )]
    Foreign {
        /// Number of the request.
        request: u32,
        /// Number of datagrams.
        datagrams: u64,
        /// Time waited.
        waited: Duration,
    },
    /// Only replies of a wrong size arrived.
    #[error(
        "request {request}: within {} came only a reply of {got} bytes, expected {expected}",
        Rounded(.waited)
    )]
    Short {
        /// Number of the request.
        request: u32,
        /// Expected number of bytes.
        expected: usize,
        /// Received number of bytes.
        got: usize,
        /// Time waited.
        waited: Duration,
    },
    /// The board receives packets that are not ours.
    #[error(
        "another program or host drives this board: within {} it received {packets} packets that are \
         not ours",
        Rounded(.within)
    )]
    OtherHost {
        /// Number of such packets.
        packets: u16,
        /// Time in which they were received.
        within: Duration,
    },
    /// The packet could not be sent or received.
    #[error("{error} ({} after the request)", Rounded(.waited))]
    Link {
        /// Error of the link.
        error: E,
        /// Time since the request.
        waited: Duration,
    },
    /// The list cannot be a packet, or does not fit its buffer.
    #[error(transparent)]
    List(#[from] ListError),
    /// The reply was requested of a list that was not started, or another list was run since.
    #[error("there is no reply to this list")]
    NotStarted,
}

/// A list of accesses cannot be a packet, or does not fit its buffer. Nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ListError {
    /// The list needs more than one packet.
    #[error(
        "the list needs a {what} of {bytes} bytes, more than the {limit} that fit into a packet"
    )]
    TooLong {
        /// Request or reply.
        what: &'static str,
        /// Its size.
        bytes: usize,
        /// Size limit.
        limit: usize,
    },
    /// An access names words outside of the buffer, or registers that do not exist.
    #[error(
        "access to {:#06X}, words {:?} of a buffer of {words}: \
         addresses are multiples of 4 up to 0xFFFC, and all words must be in the buffer",
        access.address, access.words()
    )]
    BadAccess {
        /// The access.
        access: Access,
        /// Size of the buffer.
        words: usize,
    },
    /// A bus of another type prepared the list.
    #[error("the list was prepared by a bus of another type")]
    OtherBus,
    /// The limit of the hold exceeds the longest time that a board can wait.
    #[error(
        "the list is to wait for the board's next period for up to {}, and boards wait for \
         65.535 ms at most",
        Rounded(.limit)
    )]
    LongHold {
        /// Longest time that the list was to wait.
        limit: Duration,
    },
}

impl<E: BusError> UdpError<E> {
    /// The next step, if there is one: the [advice of the bus](BusError::advice).
    pub fn advice(&self) -> Option<Advice> {
        BusError::advice(self).map(Advice::Bus)
    }

    /// The error of a packet that could not be sent.
    pub(super) fn of_sending(error: E) -> Self {
        let waited = Duration::ZERO;
        Self::Link { error, waited }
    }

    /// True if a further try cannot succeed: another host drives the board, the list is at fault,
    /// or a firewall of this computer keeps the packet.
    pub(super) fn is_lasting(&self) -> bool {
        matches!(self.kind(), BusErrorKind::Occupied | BusErrorKind::Invalid)
            || BusError::advice(self) == Some(BusAdvice::OpenFirewall)
    }

    /// The error of an exchange whose last of several tries failed with this one.
    pub(super) fn of_tries(self, tries: u32, within: Duration) -> Self {
        match self {
            Self::Lost { request, .. }
            | Self::Late { request, .. }
            | Self::Stale { request, .. }
                if tries > 1 =>
            {
                Self::GaveUp {
                    request,
                    tries,
                    within,
                    last: self.kind(),
                }
            }
            other => other,
        }
    }
}

impl<E: BusError> BusError for UdpError<E> {
    fn kind(&self) -> BusErrorKind {
        match self {
            Self::Lost { .. } | Self::Foreign { .. } => BusErrorKind::Lost,
            Self::GaveUp { last, .. } => *last,
            Self::Late { .. } => BusErrorKind::Late,
            Self::Stale { .. } => BusErrorKind::Stale,
            Self::Short { .. } => BusErrorKind::Short,
            Self::Link { error, .. } => error.kind(),
            Self::OtherHost { .. } => BusErrorKind::Occupied,
            Self::List(_) | Self::NotStarted => BusErrorKind::Invalid,
        }
    }

    fn advice(&self) -> Option<BusAdvice> {
        Some(match self {
            // A board whose replies are late has power and a cable.
            Self::Late { .. }
            | Self::Stale { .. }
            | Self::GaveUp {
                last: BusErrorKind::Late | BusErrorKind::Stale,
                ..
            } => BusAdvice::CheckHost,
            Self::Lost { .. } | Self::GaveUp { .. } => BusAdvice::CheckBoard,
            Self::Foreign { .. } => BusAdvice::CheckAddressAndWay,
            Self::Short { .. } => BusAdvice::FindOtherProgram,
            Self::OtherHost { .. } => BusAdvice::EndOtherProgram,
            Self::Link { error, .. } => return error.advice(),
            Self::NotStarted => BusAdvice::StartList,
            Self::List(ListError::TooLong { .. }) => BusAdvice::ShortenList,
            Self::List(ListError::BadAccess { .. }) => return None,
            Self::List(ListError::OtherBus) => BusAdvice::PrepareList,
            Self::List(ListError::LongHold { .. }) => BusAdvice::ShortenPeriod,
        })
    }
}
