//! What goes wrong on a serial port of the host, and what to do then.

use core::fmt;
use std::io;

use mesa_hal::lbp::{LbpError, RemoteAccess};

/// Why something was not done over a serial port.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SerialError {
    /// The serial port itself failed.
    #[error(
        "the serial port failed: {0}; check that its adapter is plugged in, and that no other program \
         has it open"
    )]
    Port(#[from] io::Error),
    /// Not a single character came.
    #[error(
        "{asked}: no answer, asked {attempts} times; check in this order: the card has power; it is in \
         setup mode (7I77: W12 for field I/O, W4 for analog, to the right; 7I72: W6 down), and was \
         switched off and on since; this port has the card's baud rate (115200 in setup mode); RX and \
         TX are not swapped, and the adapter is RS-422"
    )]
    NoReply {
        /// What was asked.
        asked: Asked,
        /// How often.
        attempts: u8,
    },
    /// Something came, and not what a remote answers.
    #[error(
        "{asked}: what answers is damaged, asked {attempts} times ({source}); the baud rate is another \
         one than the card's (115200 in setup mode, whatever NVBaudRate says), or the cable is bad"
    )]
    Damaged {
        /// What was asked.
        asked: Asked,
        /// How often.
        attempts: u8,
        /// What is wrong with the last reply.
        source: LbpError,
    },
    /// It answers, and is no LBP remote.
    #[error(
        "what answers is no remote: its cookie is {found:02X}, expected 5A; check what is connected to \
         this port"
    )]
    NotARemote {
        /// Its cookie.
        found: u8,
    },
    /// Somebody talks without being asked.
    #[error(
        "characters come in without end on this serial port; check the baud rate, and that a single \
         card, and nothing else, is connected to it"
    )]
    NeverQuiet,
    /// Access to non-volatile memory could not be switched off again.
    #[error(
        "access to non-volatile memory could not be switched off ({0}); power the card off and on \
         before anything else is written to it"
    )]
    StillSelected(Box<SerialError>),
    /// Non-volatile memory does not keep a value.
    #[error(
        "{access}: non-volatile memory reads {read:#04X} after {written:#04X} was written; it may be \
         write-protected (see the card's jumpers) or worn out"
    )]
    NotKept {
        /// The access.
        access: RemoteAccess,
        /// What was written.
        written: u64,
        /// What was read last.
        read: u64,
    },
}

/// What was asked of a remote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// An access to its memory, or to a local location.
    Access(RemoteAccess),
    /// A remote procedure call, by its command byte.
    Rpc(u8),
}

impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Access(access) => access.fmt(f),
            Self::Rpc(command) => write!(f, "remote procedure call {command:02X}"),
        }
    }
}
