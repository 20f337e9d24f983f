//! Permitted values of an output, and the replacement of values that are not permitted.

use super::enabling::Enabling;
use super::slot::{NONE, PinSlot};
use crate::hal::{AnyValue, Rejection, Rejections, Value};

/// Permitted values of a pin, and counts of the values that were not permitted. Outputs have one,
/// and real numbers, which can be NaN; other inputs and parameters have none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    pub safe: u64,
    pub min: u64,
    pub max: u64,
    /// Parameters that limit it; `NONE` without one.
    pub max_limit: u32,
    pub min_limit: u32,
    /// The parameter of its [`FullScale`]; `NONE` without one.
    pub scale: u32,
    /// The ends of the full scale on the wire.
    pub wire: (f64, f64),
    pub rejections: Rejections,
    pub enabling: Enabling,
    /// The state of the parameters from which the fields below were computed.
    pub settings: u64,
    /// The limits as narrowed by the parameters.
    lowest: u64,
    highest: u64,
    /// The current value of the full scale parameter.
    scale_now: f64,
}

impl Rule {
    /// A rule without parameters.
    pub const fn new(safe: u64, (min, max): (u64, u64)) -> Self {
        Self {
            safe,
            min,
            max,
            max_limit: NONE,
            min_limit: NONE,
            scale: NONE,
            wire: (0.0, 0.0),
            rejections: Rejections {
                not_finite: 0,
                out_of_range: 0,
            },
            enabling: Enabling::NONE,
            settings: u64::MAX,
            lowest: min,
            highest: max,
            scale_now: 0.0,
        }
    }

    /// Applies the current values of the parameters. A limit never exceeds the pin's own limits.
    pub fn apply<T: Value>(&mut self, slots: &[PinSlot], settings: u64) {
        let param = |index: u32| Some(f64::from_bits(slots.get(index as usize)?.bits));
        let (min, max) = (T::from_bits(self.min), T::from_bits(self.max));
        let limit = |index: u32, otherwise: T| match param(index).map(T::from_f64) {
            None => otherwise,
            Some(set) if set < min => min,
            Some(set) if set > max => max,
            Some(set) => set,
        };
        self.settings = settings;
        self.lowest = limit(self.min_limit, min).to_bits();
        self.highest = limit(self.max_limit, max).to_bits();
        self.scale_now = param(self.scale).unwrap_or(0.0);
    }

    /// The value that goes out for a value set by the application.
    pub fn sanitise<T: Value>(&self, value: T) -> (T, Option<Rejection>) {
        if !AnyValue::from(value).is_finite() {
            return (T::from_bits(self.safe), Some(Rejection::NotFinite));
        }
        let (min, max) = (T::from_bits(self.lowest), T::from_bits(self.highest));
        if min <= value && value <= max {
            return (value, None);
        }
        let allowed = if min > max {
            // No value is allowed, so neither limit is a sensible replacement.
            self.safe
        } else if value > max {
            self.highest
        } else {
            self.lowest
        };
        (T::from_bits(allowed), Some(Rejection::OutOfRange))
    }

    /// A value in the units of the wire.
    // Exact comparison: the scale is compared with the value it was initialised with, not with a
    // computed one.
    #[allow(clippy::float_cmp)]
    #[inline]
    pub fn on_wire(&self, value: f64) -> (f64, Option<Rejection>) {
        let (end, full) = self.wire;
        let value = if self.scale_now == full {
            value
        } else {
            value / self.scale_now * full
        };
        let (lowest, highest) = if end <= full {
            (end, full)
        } else {
            (full, end)
        };
        if lowest <= value && value <= highest {
            (value, None)
        } else if !value.is_finite() {
            let safe = f64::from_bits(self.safe).clamp(lowest, highest);
            (safe, Some(Rejection::NotFinite))
        } else {
            let nearest = value.clamp(lowest, highest);
            (nearest, Some(Rejection::OutOfRange))
        }
    }
}
