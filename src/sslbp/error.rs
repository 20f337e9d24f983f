//! Errors of a port.

use super::{Channel, ChannelMask, CsStatus, PortState};
use crate::Rounded;
use crate::advice::{Advice, MesaError};
use crate::bus::BusError;
use crate::lbp::{RemoteLinkError, RemoteLinkErrorKind};
use alloc::{boxed::Box, string::String};
use core::time::Duration;
use thiserror::Error;

/// Reason why an operation on a port failed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PortError {
    /// The bus could not reach the registers.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A bounded wait has ended without result.
    #[error(
        "serial port {port}: waited {} for {waiting_for}; {registers}",
        Rounded(.waited)
    )]
    Timeout {
        /// The port.
        port: u8,
        /// The awaited condition.
        waiting_for: String,
        /// Time waited.
        waited: Duration,
        /// COMMAND, DATA and CS at the end.
        registers: String,
        /// The next step, if there is one.
        advice: Option<Advice>,
    },
    /// The port's state or the request is unexpected: an unsupported firmware; a channel or an
    /// address that the port does not have; memory of the port, or non-volatile memory of a remote,
    /// that did not keep the written value.
    #[error("serial port {port}: {what} is {found}, expected {expected}")]
    Unexpected {
        /// The port.
        port: u8,
        /// The unexpected item.
        what: Box<str>,
        /// Its actual value.
        found: String,
        /// Its expected value.
        expected: String,
        /// The next step, if there is one.
        advice: Option<Advice>,
    },
    /// The operation needs another state of the port.
    #[error(
        "serial port {port}: {needed} needed, but the port is {state} (running channels: {running})"
    )]
    WrongState {
        /// The port.
        port: u8,
        /// Requirement of the operation, and how to fulfil it.
        needed: String,
        /// Present state of the port.
        state: PortState,
        /// The running channels.
        running: ChannelMask,
        /// The next step, if there is one.
        advice: Option<Advice>,
    },
    /// An operation on a channel, or on the remote there, failed.
    #[error("serial port {port}, channel {channel}: {failed} ({cs})")]
    Channel {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// The operation that failed.
        failed: String,
        /// CS of the channel afterwards.
        cs: CsStatus,
        /// The next step, if there is one.
        advice: Option<Advice>,
    },
}

impl MesaError for PortError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Bus(error) => error.advice(),
            Self::Timeout { advice, .. }
            | Self::Unexpected { advice, .. }
            | Self::WrongState { advice, .. }
            | Self::Channel { advice, .. } => *advice,
        }
    }
}

impl From<PortError> for RemoteLinkError {
    fn from(error: PortError) -> Self {
        let kind = match error {
            PortError::Bus(error) => RemoteLinkErrorKind::Bus(error),
            PortError::Channel { .. } => RemoteLinkErrorKind::NoReply,
            _ => RemoteLinkErrorKind::Port,
        };
        Self::new(kind, &error).advising(error.advice())
    }
}
