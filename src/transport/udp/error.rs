//! Errors of exchanges with several tries.

use core::time::Duration;

use crate::advice::{self, MesaError};
use crate::bus::{BusError, BusErrorKind};

/// True if a further try cannot succeed: another host drives the board, the list is at fault, or a
/// firewall of this computer keeps the packet.
pub(super) fn is_lasting(error: BusError) -> bool {
    matches!(error.kind(), BusErrorKind::Occupied | BusErrorKind::Invalid)
        || error.advice() == Some(advice::OPEN_FIREWALL)
}

/// The error of an exchange whose last of several tries failed with `last`.
pub(super) fn of_tries(last: BusError, tries: u32, within: Duration) -> BusError {
    match last {
        BusError::Lost { request, .. }
        | BusError::Late { request, .. }
        | BusError::Stale { request, .. }
            if tries > 1 =>
        {
            BusError::GaveUp {
                request,
                tries,
                within,
                last: last.kind(),
            }
        }
        other => other,
    }
}
