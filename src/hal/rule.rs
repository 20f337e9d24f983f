//! What an output may be, and what becomes of values that it may not.

use super::handle::Key;
use super::{HalType, OutOfRange, Output, Param, PinError, Rejection, Rejections, Value};

/// How an output is kept safe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OutputRule<T> {
    /// What it is before the application sets it, while its group is not armed, and when the
    /// application sets it to something that is not finite.
    ///
    /// It is a value of the pin: an `-invert` parameter inverts it like any other, because that
    /// parameter says how the output is wired.
    pub safe: T,
    /// What becomes of a value outside the limits.
    pub out_of_range: OutOfRange,
    /// A fault of the group does not touch it: for switches of the driver itself, such as `run`.
    pub exempt: bool,
}

impl<T: Value> OutputRule<T> {
    /// Safe at `safe`; limited to its limits; silenced by faults.
    pub fn safe_at(safe: T) -> Self {
        Self {
            safe,
            out_of_range: OutOfRange::Limit,
            exempt: false,
        }
    }

    /// A switch of the driver itself, at first at `initial`, which faults do not touch.
    pub fn switch(initial: T) -> Self {
        Self {
            exempt: true,
            ..Self::safe_at(initial)
        }
    }
}

/// What else decides what an output is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OutputModifiers {
    /// `-invert`: a truth value goes out as its opposite.
    pub invert: Option<Invert>,
    /// `-maxlim`: no larger value goes out.
    pub max_limit: Option<Param<f64>>,
    /// `-minlim`: no smaller value goes out.
    pub min_limit: Option<Param<f64>>,
    /// `-scalemax`: the real number goes out in other units.
    pub full_scale: Option<FullScale>,
}

/// What inverts a digital output: a parameter, or a pin that faults do not touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Invert {
    /// As LinuxCNC has it for outputs of remotes and for I/O pins.
    Setting(Param<bool>),
    /// As LinuxCNC has it for SSR and OutM.
    Pin(Output<bool>),
}

impl Invert {
    pub(super) fn key(self) -> Key {
        match self {
            Self::Setting(param) => param.key,
            Self::Pin(pin) => pin.key,
        }
    }
}

/// The range of an output on the wire, and the parameter that says what its end is for the
/// application.
///
/// A value beyond the range goes out as the nearest end, and is counted. A scale that makes no
/// number of it makes the safe value of it, which is counted as not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FullScale {
    /// The value that goes out as `max`.
    pub scale: Param<f64>,
    /// The other end of what goes out.
    pub min: f64,
    /// What goes out for the value of `scale`.
    pub max: f64,
}

/// What every cycle touches of a pin; kept small, because there are hundreds and a cycle finds
/// them cold. Values are kept as bits: see [`Value::to_bits`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub bits: u64,
    pub group: u32,
    /// Of the group.
    pub part: u32,
    /// The parameter that inverts it; `NONE` where there is none.
    pub invert: u32,
    /// The last value published for an input was no number.
    pub bad: bool,
    /// An output that a fault does not silence, such as `run`.
    pub exempt: bool,
    /// Every value of its type is allowed: nothing has to be looked up in its [`Rule`].
    pub is_free: bool,
}

/// What a pin may be, and what became of values that it may not.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    pub safe: u64,
    pub min: u64,
    pub max: u64,
    pub out_of_range: OutOfRange,
    /// Parameters that limit it; `NONE` where there is none.
    pub max_limit: u32,
    pub min_limit: u32,
    /// The parameter of its [`FullScale`]; `NONE` where there is none.
    pub scale: u32,
    /// The ends of that on the wire.
    pub wire: (f64, f64),
    pub rejections: Rejections,
    pub now: Now,
}

/// What the parameters make of a rule.
#[derive(Clone, Copy, Debug)]
pub(super) struct Now {
    /// The state of the parameters that this is of.
    pub settings: u64,
    min: u64,
    max: u64,
    scale: f64,
}

impl Now {
    /// Of no state of the parameters.
    pub const UNKNOWN: Self = Self {
        settings: u64::MAX,
        min: 0,
        max: 0,
        scale: 0.0,
    };
}

impl Rule {
    /// Takes over what the parameters are now. A limit is never beyond the pin's own limits.
    pub fn apply<T: Value>(&mut self, slots: &[Slot], settings: u64) {
        let param = |index: u32| Some(f64::from_bits(slots.get(index as usize)?.bits));
        let (min, max) = (T::from_bits(self.min), T::from_bits(self.max));
        let limit = |index: u32, otherwise: T| match param(index).map(T::from_f64) {
            None => otherwise,
            Some(set) if set < min => min,
            Some(set) if set > max => max,
            Some(set) => set,
        };
        self.now = Now {
            settings,
            min: limit(self.min_limit, min).to_bits(),
            max: limit(self.max_limit, max).to_bits(),
            scale: param(self.scale).unwrap_or(0.0),
        };
    }

    /// What becomes of a value that the application has set.
    pub fn sanitise<T: Value>(&self, value: T) -> (T, Option<Rejection>) {
        if !value.is_finite() {
            return (T::from_bits(self.safe), Some(Rejection::NotFinite));
        }
        let (min, max) = (T::from_bits(self.now.min), T::from_bits(self.now.max));
        if min <= value && value <= max {
            return (value, None);
        }
        let allowed = match self.out_of_range {
            // Nothing is allowed: neither limit is a value that anybody meant.
            _ if min > max => self.safe,
            OutOfRange::Safe => self.safe,
            OutOfRange::Limit if value > max => self.now.max,
            OutOfRange::Limit => self.now.min,
        };
        (T::from_bits(allowed), Some(Rejection::OutOfRange))
    }

    /// A value in the units of the wire, if it has any.
    // The scale is compared with what it was made with: nothing was computed.
    #[allow(clippy::float_cmp)]
    pub fn on_wire(&self, value: f64) -> (f64, Option<Rejection>) {
        if self.scale == NONE {
            return (value, None);
        }
        let (end, full) = self.wire;
        let value = if self.now.scale == full {
            value
        } else {
            value / self.now.scale * full
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
        } else if value > highest {
            (highest, Some(Rejection::OutOfRange))
        } else {
            (lowest, Some(Rejection::OutOfRange))
        }
    }
}

pub(super) const NONE: u32 = u32::MAX;

/// The slot and the rule of a new pin.
pub(super) fn make_slot<T: Value>(
    (group, part): (u32, u32),
    initial: T,
    limits: Option<(f64, f64)>,
) -> Result<(Slot, Rule), PinError> {
    if !initial.is_finite() {
        return Err(PinError::BadLimits);
    }
    let (min, max) = match limits {
        None => T::bounds(),
        Some((min, max)) if min.is_finite() && max.is_finite() => {
            (T::from_f64(min), T::from_f64(max))
        }
        Some(_) => return Err(PinError::BadLimits),
    };
    if !(min <= initial && initial <= max) {
        return Err(PinError::BadLimits);
    }
    let slot = Slot {
        bits: initial.to_bits(),
        group,
        part,
        invert: NONE,
        bad: false,
        exempt: false,
        // A real number can always be none.
        is_free: T::TYPE != HalType::Float && (min, max) == T::bounds(),
    };
    let rule = Rule {
        safe: initial.to_bits(),
        min: min.to_bits(),
        max: max.to_bits(),
        out_of_range: OutOfRange::default(),
        max_limit: NONE,
        min_limit: NONE,
        scale: NONE,
        wire: (0.0, 0.0),
        rejections: Rejections::default(),
        now: Now::UNKNOWN,
    };
    Ok((slot, rule))
}

#[cfg(test)]
mod tests;
