//! What can go wrong with a port, and what to do then.

use super::{Channel, ChannelMask, CsStatus, PortState};
use crate::Rounded;
use crate::bus::BusError;
use alloc::{boxed::Box, string::String};
use core::time::Duration;
use thiserror::Error;

/// Why an operation on a port failed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PortError<E: BusError> {
    /// The bus could not reach the registers.
    #[error(transparent)]
    Bus(#[from] E),
    /// A bounded wait came to its end.
    #[error(
        "SSLBP port {port}: waited {} for {waiting_for}; {registers}: {hint}",
        Rounded(.waited)
    )]
    Timeout {
        /// The port.
        port: u8,
        /// What was waited for.
        waiting_for: String,
        /// How long.
        waited: Duration,
        /// COMMAND, DATA and CS at the end.
        registers: String,
        /// What to do.
        hint: &'static str,
    },
    /// What the port has, or what was asked of it, is not as it must be: a firmware that is not
    /// known; a channel or an address that the port does not have; memory of the port, or
    /// non-volatile memory of a remote, that did not keep what was written.
    #[error("SSLBP port {port}: {what} is {found}, expected {expected}: {hint}")]
    Unexpected {
        /// The port.
        port: u8,
        /// What differs.
        what: Box<str>,
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
        /// What to do.
        hint: &'static str,
    },
    /// The operation needs another state of the port.
    #[error(
        "SSLBP port {port}: {needed} needed, but the port is {state} (channels that run: {running})"
    )]
    WrongState {
        /// The port.
        port: u8,
        /// What the operation needs, and how to get there.
        needed: String,
        /// What the port is in.
        state: PortState,
        /// The channels that run.
        running: ChannelMask,
    },
    /// A channel, or the remote on it, did not do what it was to do.
    #[error("SSLBP port {port}, channel {channel}: {failed} ({cs}): {hint}")]
    Channel {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// What failed.
        failed: String,
        /// Its CS afterwards.
        cs: CsStatus,
        /// What to do.
        hint: &'static str,
    },
}
