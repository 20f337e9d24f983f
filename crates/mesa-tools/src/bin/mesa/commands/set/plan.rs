//! A jog to do, and its progress.

use std::time::Duration;

use mesa_hal::hal::{AnyValue, PinId};

/// Progress of a jog, as far as it is confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The output does not have its value yet.
    Waiting,
    /// The output has its value, for the time that is left.
    Set { left: Duration },
    /// The output has its safe value again.
    Safe,
}

/// A jog to do.
#[derive(Clone, Copy, Debug)]
pub struct JogPlan {
    /// The output, its value, and its safe value.
    pub output: Step,
    /// Time for which the output has its value.
    pub time: Duration,
    /// Time within which it must be possible to set the output; else it is not set at all.
    pub patience: Duration,
}

/// A pin that is set for the time.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    pub pin: PinId,
    /// Value during the time.
    pub value: AnyValue,
    /// Value before and after it.
    pub safe: AnyValue,
}
