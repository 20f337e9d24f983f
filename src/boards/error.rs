//! Why pins were not made.

use crate::hal::PinError;
use crate::process_data::PlanError;

/// Why the pins of a remote or a board were not made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardError {
    /// Its process data can not be packed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A pin of it can not be made.
    #[error("element {element} of the process data: {source}")]
    Element {
        /// The place of the record in the descriptor's `process_data`.
        element: usize,
        /// Why.
        source: PinError,
    },
    /// A parameter of it can not be made.
    #[error("parameter {parameter}: {source}")]
    Parameter {
        /// The place of the record in the descriptor's `parameters`.
        parameter: usize,
        /// Why.
        source: PinError,
    },
    /// A pin that belongs to this kind of board is not there, or is of another kind.
    #[error("a pin of this board: {0} (does the remote's description differ from the table?)")]
    Pin(#[from] PinError),
}
