//! What can go wrong with a port, and what to do then.

use super::{Channel, ChannelMask, CsStatus, PortState};
use crate::bus::BusError;
use alloc::string::String;
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
    #[error("SSLBP port {port}: waited {waited:?} for {waiting_for}; {registers}: {hint}")]
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
    /// The local parameters of the port are not those of a firmware that is known.
    #[error("SSLBP port {port}: {what} is {found}, expected {expected}: {hint}")]
    Firmware {
        /// The port.
        port: u8,
        /// What differs.
        what: &'static str,
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
        /// What to do.
        hint: &'static str,
    },
    /// The port does not have these channels.
    #[error(
        "SSLBP port {port} has only {channels} channels; it has no channel {missing}; leave it out"
    )]
    NoSuchChannel {
        /// The port.
        port: u8,
        /// Those that were asked for and do not exist.
        missing: ChannelMask,
        /// Number of channels.
        channels: u8,
    },
    /// The port's own memory does not have this address.
    #[error("SSLBP port {port} has no local address {address:#X}; the last is {last:#X}")]
    NoSuchAddress {
        /// The port.
        port: u8,
        /// What was asked for.
        address: u16,
        /// The highest that there is.
        last: u16,
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
    /// Memory of the port, or non-volatile memory of a remote, did not keep what was written.
    #[error(
        "SSLBP port {port}: {place} reads {read:#04X} after {written:#04X} was written: {hint}"
    )]
    NotKept {
        /// The port.
        port: u8,
        /// Which memory, and where.
        place: String,
        /// What was written.
        written: u64,
        /// What was read last.
        read: u64,
        /// What to do.
        hint: &'static str,
    },
}
