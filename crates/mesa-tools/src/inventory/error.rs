//! Errors of an inventory.

use crate::setup::advice;
use mesa_hal::bus::BusError;
use mesa_hal::hostmot2::{HostMot2Error, IdentifyError};
use mesa_hal::sslbp::PortError;
use mesa_hal::{Advice, MesaError};

/// Result of a step of an inventory.
pub(super) type Taken<T> = Result<T, InventoryError>;

/// Error of an inventory.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InventoryError {
    /// No board with HostMot2 answered.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// The firmware lacks a required module, or contains an unknown one.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
    /// A serial port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A software mode is requested for a serial port that does not exist.
    #[error("serial port {port} does not exist: the firmware has {ports}")]
    NoSuchPort {
        /// The port.
        port: u8,
        /// Number of ports in the firmware.
        ports: u8,
    },
    /// A software mode is requested for a channel that does not exist.
    #[error("channel {channel} of serial port {port} does not exist: the port has {channels}")]
    NoSuchChannel {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
        /// Number of channels on the port.
        channels: u8,
    },
}

impl MesaError for InventoryError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Identify(error) => error.advice(),
            Self::Firmware(error) => error.advice(),
            Self::Port(error) => error.advice(),
            Self::Bus(error) => error.advice(),
            Self::NoSuchPort { .. } | Self::NoSuchChannel { .. } => Some(advice::CORRECT_MODE),
        }
    }
}
