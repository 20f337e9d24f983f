//! Why a module can not be used.

use alloc::string::String;

use crate::bus::ImageError;
use crate::hal::PinError;
use crate::hostmot2::HostMot2Error;

/// Why a module was not registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// The firmware does not have it, or has one that is not known, or an I/O pin can not be used as
    /// asked for.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
    /// A pin can not be made.
    #[error("a pin of the board: {0}")]
    Pin(#[from] PinError),
    /// A register can not be part of a cycle.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A register was not read.
    #[error("register {address:#06X} was not read, because the bus failed")]
    Peek {
        /// The register.
        address: u16,
    },
    /// A setting that this firmware can not follow.
    #[error("{what}: {found}, expected {expected}")]
    Setting {
        /// What is set, and where.
        what: &'static str,
        /// What was asked for.
        found: String,
        /// What is possible, and what to do otherwise.
        expected: String,
    },
}
