//! Outcomes of commands.

use alloc::boxed::Box;
use core::fmt;
use core::sync::atomic::{AtomicU64, Ordering};

use super::CommandSender;

/// Outcome of a command: [`CommandSender::outcome`]. `Display` is the rest of a sentence about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum CommandOutcome {
    /// The cycle has not executed it yet.
    Waiting,
    /// It was executed. A group that was to be armed [as soon as it
    /// runs](CommandSender::rearm_when_running) may still be awaited.
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

    fn load(&self, number: u64) -> Option<CommandOutcome> {
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

impl CommandSender {
    /// The outcome of a command, by the number that was returned when it was sent. Known until as
    /// many commands as the queue holds have been taken after it.
    ///
    /// ```
    /// use mesa_hal::runner::{CommandOutcome, CommandQueue};
    /// # use mesa_hal::{Driver, Settings};
    /// # use mesa_hal_sim::machines;
    /// # let board = machines::six_axes_7i92(Default::default());
    /// # let mut driver = Driver::start(board, Settings::default())?;
    /// let lamp = driver.pins().output::<bool>("hm2_7i92.0.7i77.0.0.output-00")?;
    /// let mut queue = CommandQueue::new(&driver, 64);
    /// let sender = queue.sender();
    /// driver.restart((0, 0)); // its outputs are safe until they are re-armed
    /// let number = sender.set(lamp, true)?;
    /// assert_eq!(sender.outcome(number), CommandOutcome::Waiting);
    /// queue.take(&mut driver);
    /// assert_eq!(sender.outcome(number), CommandOutcome::NotArmed);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn outcome(&self, number: u64) -> CommandOutcome {
        let shared = &*self.shared;
        // Loaded in this order, so that a command that has been taken since is not taken for one
        // that never will be.
        let has_ended = shared.has_ended.load(Ordering::Acquire);
        let taken = shared.taken.load(Ordering::Acquire);
        if number >= shared.sent.load(Ordering::Acquire) {
            return CommandOutcome::Unknown;
        }
        if let Some(outcome) = shared.outcomes.load(number) {
            return outcome;
        }
        let oldest = taken.saturating_sub(shared.slots.len() as u64);
        match number {
            _ if number >= taken && has_ended => CommandOutcome::Ended,
            // Taken, and about to be executed.
            _ if number >= oldest => CommandOutcome::Waiting,
            _ => CommandOutcome::Unknown,
        }
    }
}
