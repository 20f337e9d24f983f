//! Errors of LBP over a serial port of the host.

use core::fmt;
use std::io;

use super::advice;
use crate::counted::Counted;
use mesa_hal::lbp::{LbpError, RemoteAccess, RemoteLinkError, RemoteLinkErrorKind};
use mesa_hal::{Advice, MesaError};

/// Error of an operation over a serial port.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SerialError {
    /// The serial port itself failed.
    #[error("the serial port failed: {0}")]
    Port(#[from] io::Error),
    /// No character arrived.
    #[error(
        "{asked}: no reply, asked {}",
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
        "{asked}: the replies are damaged, asked {} ({source})",
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
    #[error("the reply is not from a smart-serial card: its cookie is {found:02X}, expected 5A")]
    NotARemote {
        /// Cookie of the device.
        found: u8,
    },
    /// Characters arrive without a request.
    #[error("characters arrive without a request on this serial port")]
    NeverQuiet,
}

impl MesaError for SerialError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::Port(_) => advice::CHECK_ADAPTER,
            Self::NoReply { .. } => advice::CHECK_SETUP_MODE,
            Self::Damaged { .. } => advice::CHECK_SETUP_BAUD,
            Self::NotARemote { .. } => advice::CHECK_DEVICE,
            Self::NeverQuiet => advice::CHECK_SINGLE_CARD,
        })
    }
}

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
