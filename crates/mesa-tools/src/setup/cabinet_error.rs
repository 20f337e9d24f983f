//! Error of a cabinet that is a board or a serial port.

use mesa_hal::remote::ParameterError;
use mesa_hal::{Advice, DriverError, MesaError};

/// Error of reading or writing a parameter: of a board, or of a card on a serial port.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CabinetError {
    /// An access to a remote of the board failed.
    #[error(transparent)]
    Board(#[from] DriverError),
    /// An access to the card on the serial port failed.
    #[error("{name}: {source}")]
    Serial {
        /// Name of the parameter, or the access.
        name: Box<str>,
        /// The cause.
        source: ParameterError,
    },
}

impl MesaError for CabinetError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Board(error) => error.advice(),
            Self::Serial { source, .. } => source.advice(),
        }
    }
}
