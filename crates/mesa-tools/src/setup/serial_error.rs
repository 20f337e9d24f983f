//! Errors of LBP over a serial port of the host, with advice.

use core::fmt;
use std::io;

use crate::counted::Counted;
use mesa_hal::MesaError;
use mesa_hal::lbp::{LbpError, RemoteAccess, RemoteLinkError, RemoteLinkErrorKind};

/// Error of an operation over a serial port.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SerialError {
    /// The serial port itself failed.
    #[error(
        "the serial port failed: {0}; check that its adapter is plugged in, and that no other program \
         has it open"
    )]
    Port(#[from] io::Error),
    /// No character arrived.
    #[error(
        "{asked}: no answer, asked {}; check in this order: the card has power; it is in \
         setup mode (7I77: W12 for field I/O, W4 for analog, to the right; 7I72: W6 down), and was \
         switched off and on since; this port has the card's baud rate (115200 in setup mode); RX and \
         TX are not swapped, and the adapter is RS-422",
        Counted(u64::from(*attempts), "time")
    )]
    NoReply {
        /// The request.
        asked: SerialRequest,
        /// Number of attempts.
        attempts: u8,
    },
    /// Characters arrived, but no valid reply.
    #[error(
        "{asked}: what answers is damaged, asked {} ({source}); the baud rate is another \
         one than the card's (115200 in setup mode, whatever NVBaudRate says), or the cable is bad",
        Counted(u64::from(*attempts), "time")
    )]
    Damaged {
        /// The request.
        asked: SerialRequest,
        /// Number of attempts.
        attempts: u8,
        /// Defect of the last reply.
        source: LbpError,
    },
    /// The device answers, but is not an LBP remote.
    #[error(
        "what answers is no remote: its cookie is {found:02X}, expected 5A; check what is connected to \
         this port"
    )]
    NotARemote {
        /// Cookie of the device.
        found: u8,
    },
    /// Characters arrive without a request.
    #[error(
        "characters come in without end on this serial port; check the baud rate, and that a single \
         card, and nothing else, is connected to it"
    )]
    NeverQuiet,
}

impl MesaError for SerialError {}

impl From<SerialError> for RemoteLinkError {
    fn from(error: SerialError) -> Self {
        let kind = match error {
            SerialError::NoReply { .. } | SerialError::Damaged { .. } => {
                RemoteLinkErrorKind::NoReply
            }
            _ => RemoteLinkErrorKind::Port,
        };
        Self::new(kind, &error).advising(error.advice())
    }
}

/// Request to a remote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SerialRequest {
    /// An access to its memory, or to a local location.
    Access(RemoteAccess),
    /// A remote procedure call, by its command byte.
    Rpc(u8),
    /// Another request, by its command byte.
    Command(u8),
}

impl fmt::Display for SerialRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Access(access) => access.fmt(f),
            Self::Rpc(command) => write!(f, "remote procedure call {command:02X}"),
            Self::Command(command) => write!(f, "command {command:02X}"),
        }
    }
}
