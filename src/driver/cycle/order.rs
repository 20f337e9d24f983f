//! What the cycle asks the driver to exchange, and the outcome.

use crate::bus::{BusError, CycleWrites, Instant};
use crate::driver::CycleError;

/// The next step of an operation of the cycle.
#[derive(Debug)]
#[must_use = "the operation is not complete"]
pub(in crate::driver) enum Next {
    /// An exchange.
    Order(Order),
    /// The end of the operation, with its result.
    End(Result<(), CycleError>),
}

impl Next {
    pub(super) const fn order(exchange: Exchange, then: Then) -> Self {
        Self::Order(Order { exchange, then })
    }

    pub(super) const fn separate(exchange: Separate, then: Then) -> Self {
        Self::order(Exchange::Separate(exchange), then)
    }
}

/// An order to do an [exchange](Self::exchange). Only the cycle makes one, and its outcome
/// [consumes](super::BoardCycle::after) it.
#[derive(Debug)]
#[must_use = "the operation waits for its outcome"]
pub(in crate::driver) struct Order {
    exchange: Exchange,
    pub(super) then: Then,
}

impl Order {
    /// The ordered exchange.
    pub const fn exchange(&self) -> Exchange {
        self.exchange
    }
}

/// An exchange with the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::driver) enum Exchange {
    /// The read of a cycle; `extra`: with the extra evidence registers, unless it has been
    /// requested ahead.
    Read { extra: bool },
    /// The write of a cycle.
    Write(CycleWrite),
    /// An exchange of its own, after the reply that was requested ahead.
    Separate(Separate),
}

/// An exchange that is neither the read nor the write of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::driver) enum Separate {
    /// Reads all evidence registers.
    Evidence,
    /// Reads all registers.
    Everything,
    /// Reads the status registers.
    Status,
    /// Compares board and firmware with those that the driver was started with.
    Firmware,
    /// Writes the changed settings that drive pins.
    Guarded,
    /// Makes all pins inputs.
    Quiesce,
    /// Writes the whole set-up, then reads the evidence.
    SetUp,
    /// Writes the set-up of a board that still has it, then reads the evidence.
    Renewal,
}

/// Form of a cycle's write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::driver) struct CycleWrite {
    /// The next read includes the extra registers.
    pub extra: bool,
    /// What is written besides the registers of every cycle.
    pub writes: CycleWrites,
}

/// Outcome of an exchange.
#[derive(Clone, Copy, Debug)]
pub(in crate::driver) struct Outcome {
    /// Time of the request.
    pub from: Instant,
    /// For the read of a cycle: time of arrival; the cycle may begin later.
    pub at: Instant,
    /// For the read of a cycle: the extra registers were read.
    pub extra: bool,
    /// For a comparison: board and firmware are those that the driver was started with.
    pub is_same: bool,
    pub result: Result<(), BusError>,
}

impl Outcome {
    /// The outcome of an exchange that was begun at `from`.
    pub const fn new(from: Instant, result: Result<(), BusError>) -> Self {
        Self {
            from,
            at: from,
            extra: false,
            is_same: true,
            result,
        }
    }
}

/// How an operation continues after an exchange.
#[derive(Debug)]
pub(super) enum Then {
    /// The read of a cycle ends.
    Read,
    /// The write of a cycle ends.
    Write,
    /// The write of a cycle ends with nothing written but the release of all pins.
    Release,
    /// The write of a cycle continues, with settings that drive pins.
    Guard(Guard),
    /// A board that waits to be re-armed has been read.
    Follow,
    /// The set-up continues.
    SetUp(SetUp),
}

/// A step of writing settings that drive pins.
#[derive(Debug)]
pub(super) enum Guard {
    /// The evidence before it.
    Before,
    /// The settings.
    Settings,
    /// The evidence after it.
    After,
}

/// A set-up of a board that has lost it, or the part before it: the identification.
#[derive(Debug)]
pub(super) struct SetUp {
    /// Time at which it was begun.
    pub begun: Instant,
    pub purpose: Purpose,
    pub step: SetUpStep,
}

/// The operation of which a set-up is a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Only to identify the board that answers.
    Identification,
    /// To re-arm: the set-up is the whole operation.
    Rearming,
    /// A write, which continues after it.
    Write,
}

/// A step of a set-up.
#[derive(Debug)]
pub(super) enum SetUpStep {
    /// The status, which indicates that a board answers.
    Status { is_repeated: bool },
    /// The comparison of board and firmware.
    Firmware { is_repeated: bool },
    /// All registers as they are before the set-up.
    Survey,
    /// The set-up of a board that still has it.
    Renewal,
    /// The whole set-up.
    Whole,
    /// The release of all pins after a set-up with this result, which the board does not show.
    Release(Result<(), BusError>),
}
