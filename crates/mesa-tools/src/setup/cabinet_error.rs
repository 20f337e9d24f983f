//! Error of a cabinet that is a board or a serial port.

use mesa_hal::{Advice, DriverError, MesaError};

use super::SerialCabinetError;

/// Error of reading or writing a parameter: of a board, or of a card on a serial port.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CabinetError {
    /// An access to a remote of the board failed.
    #[error(transparent)]
    Board(#[from] DriverError),
    /// An access to the card on the serial port failed.
    #[error(transparent)]
    Serial(#[from] SerialCabinetError),
}

impl MesaError for CabinetError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Board(error) => error.advice(),
            Self::Serial(error) => error.advice(),
        }
    }
}
