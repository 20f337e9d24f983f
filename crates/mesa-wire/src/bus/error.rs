//! Bus errors, common to all buses.

use core::fmt;
use core::time::Duration;

use super::{Access, PciAddress, advice};
use crate::{Advice, MesaError, Rounded};

/// An exchange of a [`RegisterBus`](super::RegisterBus) failed. No word that it reads has changed.
///
/// `Display` names the failure, its place and the time waited; [`advice`](Self::advice) is the next
/// step. A bus outside of this crate uses the variants that fit its failures, and
/// [`custom`](Self::custom) for all others:
///
/// ```
/// use mesa_wire::bus::{BusError, BusErrorKind, CustomError};
///
/// let error = BusError::custom(BusErrorKind::Lost, "the bridge does not acknowledge");
/// assert_eq!(error.kind(), BusErrorKind::Lost);
/// assert_eq!(error.to_string(), "the bridge does not acknowledge");
///
/// let status = 0x13;
/// let error = CustomError::new(BusErrorKind::Device, "the bridge reports").with_code(status);
/// assert_eq!(BusError::from(error).to_string(), "the bridge reports (code 0x13)");
/// ```
///
/// # Real time
/// Made, copied and formatted without allocation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
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
        "request {request}: the reply came after {}, {} too late",
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
        "request {request}: within {} only the reply to request {got} came",
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
    /// An exchange was repeated, and none of its tries got a reply in time.
    #[error(
        "request {request}: no reply in time in {tries} tries within {}, the last: {last}",
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
        "request {request}: no reply among the datagrams that came within {} ({datagrams}): they are \
         not from a Mesa board, or were changed on their way",
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
        "request {request}: within {} only a reply of {got} bytes came, expected {expected}",
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
        "another program or host drives this board: {packets} foreign packets within {}",
        Rounded(.within)
    )]
    OtherHost {
        /// Number of such packets.
        packets: u16,
        /// Time in which they were received.
        within: Duration,
    },
    /// A packet could not be sent or received.
    #[error("{error} ({} after the request)", Rounded(.waited))]
    Link {
        /// Error of the link.
        error: LinkError,
        /// Time since the request.
        waited: Duration,
    },
    /// A board on the PCI bus does not answer any more: its registers read as all ones.
    #[error(
        "{board}: the board does not answer: its registers read as all ones, the cookie as {cookie:08X}"
    )]
    Vanished {
        /// Address of the board.
        board: PciAddress,
        /// The word in place of the cookie.
        cookie: u32,
    },
    /// The simulator behind a simulated board on the PCI bus does not answer.
    #[error("{board}: the simulator behind this board does not answer")]
    Unanswered {
        /// Address of the board.
        board: PciAddress,
    },
    /// The list needs more than one packet. Nothing was sent.
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
    /// An access names words outside of the buffer, or registers that do not exist. Nothing was
    /// accessed.
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
    /// The reply was requested of a list that was not started, or another list was run since.
    #[error("the list was not started, or another one was run since")]
    NotStarted,
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
    /// A [fault](super::Fault) that a test has injected.
    #[error("exchange {exchange}: {kind:?}, injected by the test set-up")]
    Injected {
        /// The injected kind.
        kind: BusErrorKind,
        /// Number of the exchange, from 0 on.
        exchange: u64,
    },
    /// A failure of another kind of bus, in its own words.
    #[error(transparent)]
    Custom(#[from] CustomError),
}

impl BusError {
    /// A failure in words of one's own. [`CustomError`] also takes a number and an advice.
    pub const fn custom(kind: BusErrorKind, text: &'static str) -> Self {
        Self::Custom(CustomError::new(kind, text))
    }

    /// The kind of error, for code that treats all buses alike.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub const fn kind(&self) -> BusErrorKind {
        match self {
            Self::Lost { .. }
            | Self::Foreign { .. }
            | Self::Vanished { .. }
            | Self::Unanswered { .. } => BusErrorKind::Lost,
            Self::GaveUp { last: kind, .. } | Self::Injected { kind, .. } => *kind,
            Self::Late { .. } => BusErrorKind::Late,
            Self::Stale { .. } => BusErrorKind::Stale,
            Self::Short { .. } => BusErrorKind::Short,
            Self::OtherHost { .. } => BusErrorKind::Occupied,
            Self::Link { error, .. } => error.kind(),
            Self::TooLong { .. }
            | Self::BadAccess { .. }
            | Self::OtherBus
            | Self::NotStarted
            | Self::LongHold { .. } => BusErrorKind::Invalid,
            Self::Custom(error) => error.kind,
        }
    }
}

impl MesaError for BusError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            // A board whose replies are late has power and a cable.
            Self::Late { .. }
            | Self::Stale { .. }
            | Self::GaveUp {
                last: BusErrorKind::Late | BusErrorKind::Stale,
                ..
            } => advice::CHECK_HOST,
            Self::Lost { .. } | Self::GaveUp { .. } | Self::Unanswered { .. } => {
                advice::CHECK_BOARD
            }
            Self::Foreign { .. } => advice::CHECK_ADDRESS_AND_WAY,
            Self::Short { .. } => advice::FIND_OTHER_PROGRAM,
            Self::OtherHost { .. } => advice::END_OTHER_PROGRAM,
            Self::Link { error, .. } => return error.advice(),
            Self::Vanished { .. } => advice::CHECK_SLOT,
            Self::TooLong { .. } => advice::SHORTEN_LIST,
            Self::OtherBus => advice::PREPARE_LIST,
            Self::NotStarted => advice::START_LIST,
            Self::LongHold { .. } => advice::SHORTEN_PERIOD,
            Self::Custom(error) => return error.advice(),
            Self::BadAccess { .. } | Self::Injected { .. } => return None,
        })
    }
}

/// A datagram could not be sent or received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The host at the address refuses.
    #[error("no program listens at this address and port (a board listens at 27181)")]
    Refused,
    /// There is no route to the address.
    #[error("no route to this address")]
    Unreachable,
    /// The firewall of this computer refuses to send.
    #[error("the firewall of this computer blocks packets to this address")]
    Blocked,
    /// Another error of the operating system.
    #[error("the operating system reports{}", OfSystem(*.0))]
    System(
        /// Its number, `errno` on Linux; 0 if there is none.
        i32,
    ),
    /// An error of another network stack, in its own words.
    #[error(transparent)]
    Custom(#[from] CustomError),
}

impl LinkError {
    /// The kind of error.
    pub const fn kind(&self) -> BusErrorKind {
        match self {
            Self::Refused => BusErrorKind::Refused,
            Self::Unreachable => BusErrorKind::Unreachable,
            Self::Blocked | Self::System(_) => BusErrorKind::Other,
            Self::Custom(error) => error.kind,
        }
    }
}

impl MesaError for LinkError {
    fn advice(&self) -> Option<Advice> {
        match self {
            // Another host answers, so that the cable is good.
            Self::Refused => Some(advice::CHECK_ADDRESS),
            Self::Unreachable => Some(advice::CHECK_INTERFACE),
            Self::Blocked => Some(advice::OPEN_FIREWALL),
            Self::System(_) => None,
            Self::Custom(error) => error.advice(),
        }
    }
}

#[cfg(feature = "std")]
impl From<std::io::Error> for LinkError {
    fn from(error: std::io::Error) -> Self {
        use std::io::ErrorKind;
        match error.kind() {
            ErrorKind::ConnectionRefused => Self::Refused,
            ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::NetworkDown
            | ErrorKind::AddrNotAvailable => Self::Unreachable,
            ErrorKind::PermissionDenied => Self::Blocked,
            _ => Self::System(error.raw_os_error().unwrap_or(0)),
        }
    }
}

/// The error of a link that could not be opened, or of a packet that could not be sent.
impl From<LinkError> for BusError {
    fn from(error: LinkError) -> Self {
        let waited = Duration::ZERO;
        Self::Link { error, waited }
    }
}

/// An error of the operating system by its number, with words where the system has them.
struct OfSystem(i32);

impl fmt::Display for OfSystem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 {
            return f.write_str(" an error without a number");
        }
        #[cfg(feature = "std")]
        {
            // The text of the kind: that of the number would be allocated.
            let kind = std::io::Error::from_raw_os_error(self.0).kind();
            write!(f, ": {kind} (error {})", self.0)
        }
        #[cfg(not(feature = "std"))]
        write!(f, " error {}", self.0)
    }
}

/// A failure of a bus or a link outside of this crate, in its own words.
///
/// ```
/// use mesa_wire::bus::{BusErrorKind, CustomError, LinkError};
///
/// let error = CustomError::new(BusErrorKind::Unreachable, "the stack has no route to the board");
/// assert_eq!(LinkError::from(error).kind(), BusErrorKind::Unreachable);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text}{}", OfCode(.has_code.then_some(*.code)))]
pub struct CustomError {
    kind: BusErrorKind,
    text: &'static str,
    /// Not an `Option`, so that errors stay small.
    code: u32,
    has_code: bool,
    /// A reference, so that errors stay small.
    advice: Option<&'static Advice>,
}

impl CustomError {
    /// A failure of this kind; `text` names it.
    pub const fn new(kind: BusErrorKind, text: &'static str) -> Self {
        Self {
            kind,
            text,
            code: 0,
            has_code: false,
            advice: None,
        }
    }

    /// Adds a number to the text: a status, an address, the error of a driver below.
    #[must_use]
    pub const fn with_code(self, code: u32) -> Self {
        Self {
            code,
            has_code: true,
            ..self
        }
    }

    /// Sets the next step, which [`MesaError::advice`] returns.
    #[must_use]
    pub const fn advising(self, advice: &'static Advice) -> Self {
        Self {
            advice: Some(advice),
            ..self
        }
    }

    /// The kind of error.
    pub const fn kind(&self) -> BusErrorKind {
        self.kind
    }

    /// The failure in words, without its number.
    pub const fn text(&self) -> &'static str {
        self.text
    }

    /// The number of the failure, if it has one.
    pub const fn code(&self) -> Option<u32> {
        if self.has_code { Some(self.code) } else { None }
    }
}

impl MesaError for CustomError {
    fn advice(&self) -> Option<Advice> {
        self.advice.copied()
    }
}

/// A number behind a text, if there is one.
struct OfCode(Option<u32>);

impl fmt::Display for OfCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |code| write!(f, " (code {code:#X})"))
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
            Self::Late => "late reply",
            Self::Lost => "no reply",
            Self::Stale => "only a reply to an earlier request",
            Self::Refused => "no program listens at the address",
            Self::Unreachable => "no route to the board",
            Self::Short => "reply of the wrong size",
            Self::Invalid => "invalid access list",
            Self::Occupied => "another program or host drives the board",
            Self::Device => "the board reported an error",
            Self::Other => "the bus failed",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn error_of_operating_system_has_its_words_and_number() {
        let too_long = LinkError::System(90).to_string();
        let begin = "the operating system reports: ";
        assert!(too_long.starts_with(begin), "{too_long}");
        assert!(too_long.ends_with(" (error 90)"), "{too_long}");
        let unknown = LinkError::System(0).to_string();
        assert_eq!(
            unknown,
            "the operating system reports an error without a number"
        );
    }

    #[test]
    fn errors_of_a_socket_have_the_advice_of_their_kind() {
        use std::io::{Error, ErrorKind};
        for (kind, advice) in [
            (ErrorKind::ConnectionRefused, Some(advice::CHECK_ADDRESS)),
            (ErrorKind::HostUnreachable, Some(advice::CHECK_INTERFACE)),
            (ErrorKind::PermissionDenied, Some(advice::OPEN_FIREWALL)),
            (ErrorKind::OutOfMemory, None),
        ] {
            let error = LinkError::from(Error::from(kind));
            assert_eq!(error.advice(), advice);
            assert_eq!(BusError::from(error).advice(), advice);
        }
    }

    #[test]
    fn error_is_small_enough_to_be_returned_by_value() {
        assert!(size_of::<BusError>() <= 48);
    }
}
