//! The error of an access over a line to a remote.

use alloc::boxed::Box;
use alloc::format;
use alloc::string::ToString;
use core::fmt;

use super::{RemoteAccess, advice};
use crate::bus::BusError;
use crate::{Advice, MesaError};

/// An access over a [`RemoteLink`](super::RemoteLink) failed: its kind, the failure in the words of
/// the line, and the next step.
///
/// ```
/// use mesa_wire::lbp::{RemoteLinkError, RemoteLinkErrorKind};
///
/// let error = RemoteLinkError::new(RemoteLinkErrorKind::NoReply, "the bridge got no reply");
/// assert_eq!(error.to_string(), "the bridge got no reply");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.text)]
pub struct RemoteLinkError(Box<Details>);

/// In a box, so that errors that contain one stay small.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Details {
    kind: RemoteLinkErrorKind,
    text: Box<str>,
    advice: Option<Advice>,
}

/// Kind of a [`RemoteLinkError`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RemoteLinkErrorKind {
    /// The bus to the FPGA failed.
    Bus(BusError),
    /// The port of the FPGA or of the host failed.
    Port,
    /// The remote gave no valid reply.
    NoReply,
    /// Access to non-volatile memory could not be switched off again.
    StillSelected,
    /// Non-volatile memory does not keep a value.
    NotKept {
        /// The value written.
        written: u64,
        /// The value read last.
        read: u64,
    },
}

impl RemoteLinkError {
    /// A failure in the words of the line.
    pub fn new(kind: RemoteLinkErrorKind, text: impl fmt::Display) -> Self {
        Self(Box::new(Details {
            kind,
            text: text.to_string().into(),
            advice: None,
        }))
    }

    /// Sets the next step, which [`MesaError::advice`] returns.
    #[must_use]
    pub fn advising(mut self, advice: Option<Advice>) -> Self {
        self.0.advice = advice;
        self
    }

    /// The kind of failure.
    pub fn kind(&self) -> RemoteLinkErrorKind {
        self.0.kind
    }

    /// The failure after which a non-volatile memory stays selected. A failed bus remains one.
    pub(super) fn still_selected(self) -> Self {
        if let RemoteLinkErrorKind::Bus(_) = self.kind() {
            return self;
        }
        let text = format!("access to non-volatile memory could not be switched off ({self})");
        Self::new(RemoteLinkErrorKind::StillSelected, text)
            .advising(Some(advice::POWER_CYCLE_BEFORE_WRITING))
    }

    pub(super) fn not_kept(access: RemoteAccess, written: u64, read: u64) -> Self {
        let text = format!(
            "{access}: non-volatile memory reads {read:#04X} after {written:#04X} was written"
        );
        Self::new(RemoteLinkErrorKind::NotKept { written, read }, text)
            .advising(Some(advice::CHECK_WRITE_PROTECTION))
    }
}

impl MesaError for RemoteLinkError {
    fn advice(&self) -> Option<Advice> {
        self.0.advice
    }
}

impl From<BusError> for RemoteLinkError {
    fn from(error: BusError) -> Self {
        Self::new(RemoteLinkErrorKind::Bus(error), error).advising(error.advice())
    }
}
