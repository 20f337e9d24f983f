//! The part of a pin that every cycle accesses.

use crate::hal::{AnyValue, Role};

/// No rule, and no parameter.
pub(super) const NONE: u32 = u32::MAX;

/// The part of a pin that every cycle accesses, kept small because there are hundreds of them and a
/// cycle finds them out of the cache. Values are kept as bits: see [`Value::to_bits`].
#[derive(Clone, Copy, Debug)]
pub(super) struct PinSlot {
    pub bits: u64,
    pub group: u16,
    /// Index of the part within the store.
    pub part: u16,
    /// Index of its [`Rule`]; `NONE` without one.
    pub rule: u32,
    /// The parameter that inverts it; `NONE` without one.
    pub invert: u32,
    /// The last value published for an input was not finite, or is withheld; or the pin is an
    /// output of a group that is not armed.
    pub bad: bool,
    /// An output that faults do not affect, such as `run`.
    pub exempt: bool,
    /// Every value of its type is allowed: its [`Rule`] need not be looked up.
    pub is_free: bool,
    pub role: Role,
}

impl PinSlot {
    /// Takes a value of the driver. One that is not finite is not taken: the pin keeps its last
    /// value, and is not valid. Returns true if the value was taken.
    #[inline]
    pub fn accept(&mut self, value: AnyValue) -> bool {
        self.bad = !value.is_finite();
        if !self.bad {
            self.bits = value.bits;
        }
        !self.bad
    }

    /// Takes a value that is finite.
    #[inline]
    pub fn take(&mut self, value: AnyValue) {
        (self.bits, self.bad) = (value.bits, false);
    }
}
