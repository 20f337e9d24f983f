//! What a store says: readings, ages, counts and states.

use core::time::Duration;

/// Values that were not used as they were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    /// Not a number, or infinite.
    pub not_finite: u64,
    /// Outside the limits.
    pub out_of_range: u64,
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
    /// Whether it is from a transfer that succeeded, and the group has not failed since.
    pub valid: bool,
    /// How long ago that transfer was.
    pub age: Age,
}

impl<T> Reading<T> {
    /// The value, if it is valid.
    pub fn ok(self) -> Option<T> {
        self.valid.then_some(self.value)
    }
}

/// What becomes of an output outside its limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OutOfRange {
    /// The nearest limit, as LinuxCNC does.
    ///
    /// The rule for numbers: the command of a servo loop that saturates means "as much as there
    /// is", and dropping it to the safe value at that moment would let the axis go.
    #[default]
    Limit,
    /// The safe value.
    Safe,
}

/// The state of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct GroupState {
    /// Its last transfer succeeded.
    pub valid: bool,
    /// Its outputs follow the application; otherwise they have their safe values.
    pub armed: bool,
    /// How long ago the last good transfer was.
    pub age: Age,
    /// How often a fault disarmed it.
    pub faults: u64,
}

/// A value and its type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnyValue {
    /// A truth value.
    Bit(bool),
    /// A real number.
    Float(f64),
    /// A 32-bit number with sign.
    S32(i32),
    /// A 32-bit number.
    U32(u32),
    /// A 64-bit number with sign.
    S64(i64),
    /// A 64-bit number.
    U64(u64),
}

macro_rules! any_value {
    ($($type:ty => $variant:ident),*) => {
        $(impl From<$type> for AnyValue {
            fn from(value: $type) -> Self {
                Self::$variant(value)
            }
        })*
    };
}

any_value!(bool => Bit, f64 => Float, i32 => S32, u32 => U32, i64 => S64, u64 => U64);

impl core::fmt::Display for AnyValue {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bit(value) => value.fmt(f),
            Self::Float(value) => value.fmt(f),
            Self::S32(value) => value.fmt(f),
            Self::U32(value) => value.fmt(f),
            Self::S64(value) => value.fmt(f),
            Self::U64(value) => value.fmt(f),
        }
    }
}
