//! Why pins were not made.

use super::IdentityError;
use crate::hal::PinError;
use crate::hostmot2::{Gtag, LocateError, Name8};

/// Why the pins of a remote or a board were not made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardError {
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
    /// The firmware is for another board.
    #[error("this is a {found}, and a {expected} was asked for (is the address another board's?)")]
    OtherBoard {
        /// The board asked for.
        expected: &'static str,
        /// What the firmware says it is for.
        found: Name8,
    },
    /// The firmware lacks a module of this kind of board.
    #[error(transparent)]
    Module(#[from] LocateError),
    /// The driver uses fewer instances of a module than this kind of board has.
    #[error(
        "{gtag}: the board has {expected}, and {found} are in use (does the firmware lack some, or          did the driver's builder leave them out?)"
    )]
    TooFew {
        /// The module.
        gtag: Gtag,
        /// How many the board has.
        expected: usize,
        /// How many are in use.
        found: usize,
    },
    /// It is another remote, or another part of the card.
    #[error(transparent)]
    Identity(#[from] IdentityError),
    /// A pin that belongs to this kind of board is not there, or is of another kind.
    #[error("a pin of this board: {0} (does the remote's description differ from the table?)")]
    Pin(#[from] PinError),
}
