//! The command of an encoder for one cycle.

use crate::modules::latch::LatchRequest;

/// The command of an encoder for one cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EncoderCommand {
    pub reset: bool,
    pub homed: bool,
    pub request: LatchRequest,
    /// The pins ask for a probe that the firmware does not have: counted as a refused value.
    pub refuses_probe: bool,
}
