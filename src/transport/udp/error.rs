//! Errors between the host and an Ethernet board.

use core::time::Duration;
use std::io::{self, ErrorKind};

use crate::Rounded;
use crate::bus::{Access, BusError, BusErrorKind};

/// An exchange with an Ethernet board failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UdpError {
    /// No reply at all within the deadline.
    #[error(
        "request {request}: no reply within {}; \
         check the board's power, cable, IP address and jumpers, or allow a longer deadline",
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
         the host was busy with something else, or the network is: look for its interrupts, \
         power saving and other traffic, or allow a longer deadline",
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
        "request {request}: no reply in time in {tries} tries within {}, at the last {last}; \
         check the board's power, cable, IP address and jumpers, or allow a longer deadline",
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
        "request {request}: within {} came {datagrams} datagrams, and none is a reply: \
         something else than a board answers at this address and port; check both",
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
        "request {request}: within {} came only a reply of {got} bytes, expected {expected}; \
         does another program talk to this board?",
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
        "somebody else drives this board: within {} it received {packets} packets that are \
         not ours; end the other program (LinuxCNC, mesaflash, another driver), also on other hosts",
        Rounded(.within)
    )]
    OtherHost {
        /// Number of such packets.
        packets: u16,
        /// Time in which they were received.
        within: Duration,
    },
    /// The packet could not be sent or received.
    #[error("{} ({} after the request); {}", reason(*kind), Rounded(.waited), advice(*kind))]
    Link {
        /// Error of the operating system.
        kind: ErrorKind,
        /// Time since the request.
        waited: Duration,
    },
    /// The list needs more than one packet.
    #[error(
        "the list needs a {what} of {bytes} bytes, more than the {limit} that fit into a packet; \
         use shorter lists"
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
    /// The reply was requested of a list that was not started, or another list was run since.
    #[error(
        "there is no reply to this list: start it, and run nothing else before its reply is taken"
    )]
    NotStarted,
    /// A bus of another type prepared the list.
    #[error("the list was prepared by a bus of another type; prepare it on this one")]
    OtherBus,
    /// The limit of the hold exceeds the longest time that a board can wait.
    #[error(
        "the list is to wait for the board's next period for up to {}, and boards wait for \
         65.535 ms at most; use a shorter period, or let the host pace the cycle",
        Rounded(.limit)
    )]
    LongHold {
        /// Longest time that the list was to wait.
        limit: Duration,
    },
}

impl From<io::Error> for UdpError {
    /// The error of a failed send.
    fn from(error: io::Error) -> Self {
        Self::Link {
            kind: error.kind(),
            waited: Duration::ZERO,
        }
    }
}

impl UdpError {
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

impl BusError for UdpError {
    fn kind(&self) -> BusErrorKind {
        match self {
            Self::Lost { .. } | Self::Foreign { .. } => BusErrorKind::Lost,
            Self::GaveUp { last, .. } => *last,
            Self::Late { .. } => BusErrorKind::Late,
            Self::Stale { .. } => BusErrorKind::Stale,
            Self::Short { .. } => BusErrorKind::Short,
            Self::Link { kind, .. } => link_kind(*kind),
            Self::OtherHost { .. } => BusErrorKind::Occupied,
            Self::TooLong { .. }
            | Self::BadAccess { .. }
            | Self::NotStarted
            | Self::OtherBus
            | Self::LongHold { .. } => BusErrorKind::Invalid,
        }
    }
}

fn link_kind(kind: ErrorKind) -> BusErrorKind {
    match kind {
        ErrorKind::ConnectionRefused => BusErrorKind::Refused,
        ErrorKind::HostUnreachable
        | ErrorKind::NetworkUnreachable
        | ErrorKind::NetworkDown
        | ErrorKind::AddrNotAvailable => BusErrorKind::Unreachable,
        _ => BusErrorKind::Other,
    }
}

fn reason(kind: ErrorKind) -> String {
    match link_kind(kind) {
        BusErrorKind::Refused => {
            "nobody listens at this address and port (a board listens at 27181)".into()
        }
        BusErrorKind::Unreachable => {
            "no way to this address: is the network interface up and in the same network?".into()
        }
        _ if is_blocked(kind) => "this computer lets no packets out to this address".into(),
        _ => format!("the operating system reports: {kind}"),
    }
}

fn advice(kind: ErrorKind) -> &'static str {
    if is_blocked(kind) {
        BLOCKED
    } else {
        "check the board's IP address and its cable"
    }
}

/// True if the firewall of this computer refuses to send: a retry does not help.
pub(super) fn is_blocked(kind: ErrorKind) -> bool {
    kind == ErrorKind::PermissionDenied
}

/// Advice for a computer whose firewall blocks packets to a board.
pub const BLOCKED: &str = "LinuxCNC on this computer keeps its board for itself: end it. If it has \
    ended and left its firewall behind: `sudo iptables -F hm2-eth-rules-output`; else it is another \
    rule of `sudo iptables -S`";
