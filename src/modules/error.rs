//! Errors of registering a module.

use alloc::string::String;

use crate::advice::{Advice, MesaError};
use crate::bus::ImageError;
use crate::hal::PinError;
use crate::hostmot2::HostMot2Error;

/// The reason why a module was not registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// The firmware lacks the module, has an unknown version of it, or an I/O pin cannot be used as
    /// requested.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
    /// A pin cannot be made.
    #[error("a pin of the board: {0}")]
    Pin(#[from] PinError),
    /// A register cannot be part of a cycle.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A register was not read.
    #[error("register {address:#06X} was not read, because the bus failed")]
    Peek {
        /// The address of the register.
        address: u16,
    },
    /// A setting that this firmware does not support.
    #[error("{what}: {found}, expected {expected}")]
    Setting {
        /// The setting.
        what: &'static str,
        /// The requested value.
        found: String,
        /// The possible values.
        expected: String,
        /// The next step.
        advice: Advice,
    },
}

impl MesaError for RegisterError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Firmware(error) => error.advice(),
            Self::Pin(error) => error.advice(),
            Self::Image(error) => error.advice(),
            Self::Peek { .. } => None,
            Self::Setting { advice, .. } => Some(*advice),
        }
    }
}
