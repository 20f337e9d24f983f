//! Why an inventory was not taken.

use mesa_hal::bus::BusError;
use mesa_hal::hostmot2::{HostMot2Error, IdentifyError};
use mesa_hal::sslbp::PortError;

/// Why an inventory was not taken.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InventoryError<E: BusError> {
    /// What answers is no board with HostMot2, or none answers.
    #[error(transparent)]
    Identify(#[from] IdentifyError<E>),
    /// The firmware lacks what every board has, or has a module that is not known.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
    /// A serial port failed.
    #[error(transparent)]
    Port(#[from] PortError<E>),
    /// The bus failed.
    #[error(transparent)]
    Bus(E),
    /// A software mode is asked for on a port that is not there.
    #[error("no serial port {port}, the firmware has {ports}; leave the mode out, or correct it")]
    NoSuchPort {
        /// The port.
        port: u8,
        /// How many there are.
        ports: u8,
    },
    /// A software mode is asked for on a channel that is not there.
    #[error(
        "no channel {channel} on serial port {port}, which has {channels}; leave the mode out, or \
         correct it"
    )]
    NoSuchChannel {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
        /// How many there are.
        channels: u8,
    },
}
