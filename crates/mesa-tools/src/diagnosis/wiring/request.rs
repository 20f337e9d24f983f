//! State of a request for an input.

use mesa_hal::bus::Instant;
use mesa_hal::hal::AnyValue;

/// The input that is requested, and what was seen of it.
#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub(super) struct InputRequest {
    pub point: usize,
    /// Time since when the input can be actuated.
    pub ready: Option<Instant>,
    /// True once the invalid value has been reported.
    pub is_invalid: bool,
    /// True once the held level has been reported.
    pub is_held: bool,
    pub has_changed: bool,
    pub dithers: bool,
    pub others: Vec<usize>,
    pub latch: IndexLatch,
}

/// State of a requested index.
#[derive(Debug, Default)]
pub(super) struct IndexLatch {
    /// Time of the last arming request.
    pub requested: Option<Instant>,
    /// Position of the encoder when the latch was armed.
    pub from: Option<AnyValue>,
}
