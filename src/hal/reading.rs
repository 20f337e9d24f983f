//! What a store says: readings, ages, counts and states.

use core::time::Duration;

/// Values that were not used as they were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Rejections {
    /// Not a number, or infinite.
    pub not_finite: u64,
    /// Outside the limits.
    pub out_of_range: u64,
}

impl Rejections {
    pub(super) fn count(&mut self, rejection: Rejection) {
        let counter = match rejection {
            Rejection::NotFinite => &mut self.not_finite,
            Rejection::OutOfRange => &mut self.out_of_range,
        };
        *counter = counter.saturating_add(1);
    }
}

/// Why a value was not used as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rejection {
    /// NaN or infinite.
    NotFinite,
    /// Below the lower or above the upper limit.
    OutOfRange,
}

/// How long ago the last good transfer was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Age {
    /// In cycles: 0 if the transfer that the last write started was taken by this read.
    pub cycles: u64,
    /// In time, from the start of the transfer up to the start of this cycle. For what the board
    /// itself shows, from the end of the read that brought it: it was read within the time that a
    /// read takes before that.
    pub time: Duration,
}

impl Age {
    /// There was none yet.
    pub const NEVER: Self = Self {
        cycles: u64::MAX,
        time: Duration::MAX,
    };
}

/// What reading a pin gives.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct Reading<T> {
    /// The value: the last good one if `valid` is false, or the type's zero if there never was one.
    pub value: T,
    /// Whether it is from a transfer that succeeded, the group has not failed since, and it is younger
    /// than [`stale_after`](crate::driver::FaultPolicy::stale_after) cycles.
    pub valid: bool,
    /// How long ago that transfer was; [`NEVER`](Age::NEVER) of a value that was none, or is not known
    /// yet.
    pub age: Age,
}

impl<T> Reading<T> {
    /// The value, if it is valid.
    pub fn ok(self) -> Option<T> {
        self.valid.then_some(self.value)
    }

    /// The last good value, if it is at most `cycles` cycles old: of a pin that is not valid, too.
    ///
    /// A wire that is sound loses a reply now and then, which makes a remote's inputs
    /// [not valid](Self::valid) for one cycle. A drive enable, or a limit switch that stops the machine,
    /// must not follow that: it takes the value of the cycle before, and reacts as many cycles later
    /// when the remote is really gone. 3 is a good choice at 1 kHz.
    ///
    /// ```
    /// # use mesa_hal::hal::{Age, Reading};
    /// # use core::time::Duration;
    /// let lost = Reading {
    ///     value: true,
    ///     valid: false, // the wire has lost this cycle's reply
    ///     age: Age { cycles: 1, time: Duration::from_millis(1) },
    /// };
    /// assert_eq!((lost.ok(), lost.within(3), lost.within(0)), (None, Some(true), None));
    /// ```
    pub fn within(self, cycles: u64) -> Option<T> {
        let is_known = self.age.cycles < Age::NEVER.cycles;
        (is_known && self.age.cycles <= cycles).then_some(self.value)
    }
}

/// The state of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct GroupState {
    /// Its last transfer succeeded, and is younger than
    /// [`stale_after`](crate::driver::FaultPolicy::stale_after) cycles.
    pub valid: bool,
    /// Its outputs follow the application; otherwise they have their safe values.
    pub armed: bool,
    /// How long ago the last good transfer was.
    pub age: Age,
    /// How often a fault disarmed it.
    pub faults: u64,
}
