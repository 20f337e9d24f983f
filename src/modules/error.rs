//! Why a module can not be used.

use crate::bus::process_image::ImageError;
use crate::hal::PinError;
use crate::hostmot2::{IoPinError, LocateError, MissingModule, ModuleError};

/// Why a module was not registered.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// The firmware does not have it, or has one that is not known.
    #[error(transparent)]
    Locate(#[from] LocateError),
    /// An I/O pin can not be used as asked for.
    #[error(transparent)]
    IoPin(#[from] IoPinError),
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
    /// More encoders were asked for than the firmware has.
    #[error(
        "{count} encoders were asked for, and this firmware has {all}; ask for at most {all} \
         (`EncoderSetup::count`), or load a firmware that has more"
    )]
    TooManyEncoders {
        /// How many were asked for.
        count: u8,
        /// How many there are.
        all: u8,
    },
}

impl From<ModuleError> for RegisterError {
    fn from(error: ModuleError) -> Self {
        Self::Locate(error.into())
    }
}

impl From<MissingModule> for RegisterError {
    fn from(error: MissingModule) -> Self {
        Self::Locate(error.into())
    }
}
