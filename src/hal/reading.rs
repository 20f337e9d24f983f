//! Results of reading a store: readings, ages, counts and states.

use core::fmt;
use core::time::Duration;

/// Counts of values that were replaced instead of used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
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

/// Reason why a value was replaced instead of used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rejection {
    /// NaN or infinite.
    NotFinite,
    /// Below the lower or above the upper limit.
    OutOfRange,
}

/// Time since the last good transfer.
///
/// With the feature `serde` it is serialized with its time in seconds; [`NEVER`](Self::NEVER) is
/// null.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Age {
    /// In cycles: 0 if this read completed the transfer that the last write started.
    pub cycles: u64,
    /// In time, from the start of the transfer to the start of this cycle. For the board's own
    /// pins, from the end of the read that brought them; the values are older by at most the
    /// duration of that read.
    pub time: Duration,
}

impl Age {
    /// No good transfer yet.
    pub const NEVER: Self = Self {
        cycles: u64::MAX,
        time: Duration::MAX,
    };

    /// Cycles for [`Reading::within`] that tolerate a lost packet, or a lost reply of a remote.
    pub const LOST_PACKET: u64 = 3;
    /// Cycles for [`Reading::within`] that tolerate an attempt to restart another card of the port
    /// as well, which takes up to 20 ms, in cycles of 1 ms or more
    /// ([`neighbours`](crate::guides::neighbours)).
    pub const NEIGHBOUR_RESTART: u64 = 25;
}

/// `3 cycles, 3.012 ms`, or `never`.
///
/// ```
/// use core::time::Duration;
/// use mesa_hal::hal::Age;
/// let age = Age { cycles: 3, time: Duration::from_micros(3_012) };
/// assert_eq!(age.to_string(), "3 cycles, 3.012 ms");
/// assert_eq!(Age::NEVER.to_string(), "never");
/// ```
impl fmt::Display for Age {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.cycles == Self::NEVER.cycles {
            return f.write_str("never");
        }
        let plural = if self.cycles == 1 { "" } else { "s" };
        let millis = self.time.as_secs_f64() * 1e3;
        write!(f, "{} cycle{plural}, {millis:.3} ms", self.cycles)
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for Age {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(serde::Serialize)]
        struct KnownAge {
            cycles: u64,
            time: f64,
        }
        let known = KnownAge {
            cycles: self.cycles,
            time: self.time.as_secs_f64(),
        };
        let is_known = self.cycles != Self::NEVER.cycles;
        is_known.then_some(known).serialize(serializer)
    }
}

/// Result of reading a pin.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[must_use]
pub struct Reading<T> {
    /// The value: the last good one if `valid` is false, or the type's zero if there was none yet.
    pub value: T,
    /// True if the value comes from a transfer that succeeded, the group has not failed since, and
    /// the value is younger than [`stale_after`](crate::driver::FaultPolicy::stale_after) cycles.
    pub valid: bool,
    /// Age of that transfer; [`NEVER`](Age::NEVER) if there was none or the value is not known yet.
    pub age: Age,
}

impl<T> Reading<T> {
    /// The value, if it is valid.
    pub fn ok(self) -> Option<T> {
        self.valid.then_some(self.value)
    }

    /// The last good value, if it is at most `cycles` cycles old, also for a pin that is not valid.
    ///
    /// A sound wire occasionally loses a reply, which makes a remote's inputs [not
    /// valid](Self::valid) for one cycle. A drive enable, or a limit switch that stops the machine,
    /// must not follow that: with this function it keeps the value of the cycle before, and reacts
    /// `cycles` cycles later when the remote is really gone. [`Age::LOST_PACKET`] tolerates no more
    /// than that; with [`Age::NEIGHBOUR_RESTART`] attempts to restart another card of the port do
    /// not stop the machine either.
    ///
    /// ```
    /// # use mesa_hal::hal::{Age, Reading};
    /// # use core::time::Duration;
    /// let lost = Reading {
    ///     value: true,
    ///     valid: false, // the wire has lost this cycle's reply
    ///     age: Age { cycles: 1, time: Duration::from_millis(1) },
    /// };
    /// assert_eq!((lost.ok(), lost.within(Age::LOST_PACKET), lost.within(0)), (None, Some(true), None));
    /// ```
    pub fn within(self, cycles: u64) -> Option<T> {
        let is_known = self.age.cycles < Age::NEVER.cycles;
        (is_known && self.age.cycles <= cycles).then_some(self.value)
    }
}

/// The state of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct GroupState {
    /// The last transfer succeeded, and is younger than
    /// [`stale_after`](crate::driver::FaultPolicy::stale_after) cycles.
    pub valid: bool,
    /// The outputs follow the application; otherwise they have their safe values.
    pub armed: bool,
    /// Time since the last good transfer.
    pub age: Age,
    /// Number of times that a fault has disarmed the group.
    pub faults: u64,
    /// The group is armed as soon as it runs, unless a fault comes before:
    /// [`Driver::rearm_when_running`](crate::Driver::rearm_when_running).
    pub rearm_pending: bool,
}
