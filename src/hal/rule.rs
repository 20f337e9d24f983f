//! Permitted values of an output, and the replacement of values that are not permitted.

use super::enabling::Enabling;
use super::handle::Key;
use super::{
    AnyValue, GroupId, HalType, Output, Param, PinError, Pins, Rejection, Rejections, Role,
    ShortName, Spec, Value,
};

/// Inverter of a digital output: a parameter, or a pin that faults do not affect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Invert {
    /// A parameter, as in LinuxCNC for outputs of remotes and for I/O pins.
    Setting(Param<bool>),
    /// A pin, as in LinuxCNC for SSR and OutM.
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

/// The range of an output on the wire, and the parameter that gives its end in the application's
/// units.
///
/// A value beyond the range goes out as the nearest end, and is counted. If the scale does not
/// yield a finite number, the safe value goes out and is counted as not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FullScale {
    /// The value that goes out as `max`.
    pub scale: Param<f64>,
    /// The other end of the range on the wire.
    pub min: f64,
    /// The value on the wire for the value of `scale`.
    pub max: f64,
}

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
    /// Takes a value of the driver. One that is not finite is not taken: the pin keeps its last value,
    /// and is not valid. Returns true if the value was taken.
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

/// Permitted values of a pin, and counts of the values that were not permitted. Outputs have one, and
/// real numbers, which can be NaN; other inputs and parameters have none.
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

/// True if a number can be a scale: any count or voltage divided or multiplied by it stays finite.
pub(crate) fn is_scale(number: f64) -> bool {
    (1e-100..=1e100).contains(&number.abs())
}

pub(super) const NONE: u32 = u32::MAX;

/// The slot and the rule of a new pin.
pub(super) fn make_slot<T: Value>(
    pins: &Pins,
    part: GroupId,
    role: Role,
    spec: &Spec,
    initial: T,
) -> Result<(PinSlot, Option<Rule>), PinError> {
    let group = pins.part(part).ok_or(PinError::ForeignHandle)?.group;
    let short = |index: u32| u16::try_from(index).map_err(|_| PinError::TooMany);
    let parameter = |key| parameter_index(pins, key);
    let invert = parameter(spec.invert.map(Invert::key))?;
    let max_limit = parameter(spec.max_limit.map(|param| param.key))?;
    let min_limit = parameter(spec.min_limit.map(|param| param.key))?;
    let scale = parameter(spec.full_scale.map(|full| full.scale.key))?;
    let wire = spec
        .full_scale
        .map_or((0.0, 0.0), |full| (full.min, full.max));
    let (min, max) = bounds(role, spec, initial)?;
    let is_real = T::TYPE == HalType::Float;
    let safe = initial.to_bits();
    // A float can be NaN, which is counted for the pin.
    let has_rule = is_real || matches!(role, Role::Output | Role::InOut);
    let rule_index = pins.rules.len() as u32;
    let slot = PinSlot {
        bits: safe,
        group: short(group)?,
        part: short(part.0.index)?,
        rule: if has_rule { rule_index } else { NONE },
        invert,
        bad: false,
        exempt: false,
        // A float can be NaN.
        is_free: !is_real && (min, max) == T::bounds() && max_limit == NONE && min_limit == NONE,
        role,
    };
    let (min, max) = (min.to_bits(), max.to_bits());
    let rule = Rule {
        safe,
        min,
        max,
        max_limit,
        min_limit,
        scale,
        wire,
        rejections: Rejections::default(),
        enabling: Enabling::NONE,
        settings: u64::MAX,
        lowest: min,
        highest: max,
        scale_now: 0.0,
    };
    Ok((slot, has_rule.then_some(rule)))
}

fn parameter_index(pins: &Pins, key: Option<Key>) -> Result<u32, PinError> {
    match key {
        None => Ok(NONE),
        Some(key) if pins.index(key).is_some() => Ok(key.index),
        Some(_) => Err(PinError::ForeignHandle),
    }
}

/// The smallest and the largest value of a new pin, checked to be usable and to contain its first
/// value.
fn bounds<T: Value>(role: Role, spec: &Spec, initial: T) -> Result<(T, T), PinError> {
    // The first value of an input may lie outside its limits, which are informational.
    let limits = spec.limits.filter(|_| role != Role::Input);
    let full_scale = spec.full_scale.map(|full| (full.min, full.max));
    let mut ranges = [limits, full_scale].into_iter().flatten();
    let are_finite = ranges.all(|(min, max)| min.is_finite() && max.is_finite());
    let (min, max) =
        limits.map_or_else(T::bounds, |(min, max)| (T::from_f64(min), T::from_f64(max)));
    let is_within = min <= initial && initial <= max && AnyValue::from(initial).is_finite();
    let is_scaled = full_scale.is_some();
    if !are_finite || !is_within || (is_scaled && T::TYPE != HalType::Float) {
        return Err(PinError::BadLimits {
            name: ShortName::new(&spec.name),
            initial: initial.into(),
            limits,
        });
    }
    Ok((min, max))
}

#[cfg(test)]
mod tests;
