//! Outcomes of commands.

use alloc::boxed::Box;
use core::fmt;
use core::sync::atomic::{AtomicU64, Ordering};

/// Outcome of a command: [`CommandSender::outcome`](super::CommandSender::outcome). `Display` is
/// the rest of a sentence about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum CommandOutcome {
    /// The cycle has not executed it yet.
    Waiting,
    /// It was executed. A group that was to be armed [as soon as it
    /// runs](super::CommandSender::rearm_when_running) may still be awaited.
    Done,
    /// Refused: the group of the output is not armed, so that the output has its safe value.
    NotArmed,
    /// Refused: a fault came after it was sent.
    AfterFault,
    /// Refused: the group to arm does not run.
    NotRunning,
    /// Refused: the port of the group to arm is switched off.
    PortOff,
    /// Refused: the board does not have its set-up, and did not get it back.
    NoSetUp,
    /// Refused: the command belongs to another driver.
    OtherDriver,
    /// Not executed: the cycle has ended.
    Ended,
    /// No longer known, because as many commands as the queue holds have been taken since; or never
    /// sent.
    Unknown,
}

impl CommandOutcome {
    const ALL: [Self; 10] = [
        Self::Waiting,
        Self::Done,
        Self::NotArmed,
        Self::AfterFault,
        Self::NotRunning,
        Self::PortOff,
        Self::NoSetUp,
        Self::OtherDriver,
        Self::Ended,
        Self::Unknown,
    ];

    /// True if the command had, and will have, no effect.
    pub const fn is_refused(self) -> bool {
        !matches!(self, Self::Waiting | Self::Done | Self::Unknown)
    }
}

impl fmt::Display for CommandOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Waiting => "waits for the cycle",
            Self::Done => "done",
            Self::NotArmed => "refused: the output is not armed",
            Self::AfterFault => "refused: a fault came after it was sent",
            Self::NotRunning => "refused: the group does not run",
            Self::PortOff => "refused: the port is switched off",
            Self::NoSetUp => "refused: the board did not get its set-up back",
            Self::OtherDriver => "refused: it was sent for another driver",
            Self::Ended => "refused: the cycle has ended",
            Self::Unknown => "not known any more",
        })
    }
}

/// The outcomes of the last commands, one for each slot of the queue.
#[derive(Debug)]
pub(super) struct Outcomes(Box<[AtomicU64]>);

/// Bits of an outcome in its word; the others are the number of its command, from 1 on.
const BITS: u32 = 4;

impl Outcomes {
    pub(super) fn new(capacity: usize) -> Self {
        Self((0..capacity).map(|_| AtomicU64::new(0)).collect())
    }

    /// Stores the outcome of a command.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub(super) fn store(&self, number: u64, outcome: CommandOutcome) {
        if let Some(slot) = self.slot(number) {
            let word = number.wrapping_add(1) << BITS | outcome as u64;
            slot.store(word, Ordering::Release);
        }
    }

    pub fn load(&self, number: u64) -> Option<CommandOutcome> {
        let word = self.slot(number)?.load(Ordering::Acquire);
        let is_own = word >> BITS == number.wrapping_add(1);
        let code = word & ((1 << BITS) - 1);
        CommandOutcome::ALL
            .get(code as usize)
            .copied()
            .filter(|_| is_own)
    }

    fn slot(&self, number: u64) -> Option<&AtomicU64> {
        let index = number.checked_rem(self.0.len() as u64)?;
        self.0.get(index as usize)
    }
}
