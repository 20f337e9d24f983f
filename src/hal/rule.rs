//! What an output may be, and what becomes of values that it may not.

use super::enabling::Enabling;
use super::handle::Key;
use super::{
    AnyValue, GroupId, HalType, Output, Param, PinError, Pins, Rejection, Rejections, Role,
    ShortName, Spec, Value,
};

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

/// The range of an output on the wire, and the parameter that gives its end in the application's
/// units.
///
/// A value beyond the range goes out as the nearest end, and is counted. Where the scale gives no
/// finite number, the safe value goes out, counted as not finite.
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
    /// The last value published for an input was not finite, or is withheld; or it is an output of a
    /// group that is not armed.
    pub bad: bool,
    /// An output that a fault does not silence, such as `run`.
    pub exempt: bool,
    /// Every value of its type is allowed: nothing has to be looked up in its [`Rule`].
    pub is_free: bool,
    pub role: Role,
}

/// What a pin may be, and what became of values that it may not.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    pub safe: u64,
    pub min: u64,
    pub max: u64,
    /// Parameters that limit it; `NONE` where there is none.
    pub max_limit: u32,
    pub min_limit: u32,
    /// The parameter of its [`FullScale`]; `NONE` where there is none.
    pub scale: u32,
    /// The ends of that on the wire.
    pub wire: (f64, f64),
    pub rejections: Rejections,
    pub enabling: Enabling,
    /// The state of the parameters from which the rest was computed.
    pub settings: u64,
    /// The limits as the parameters narrow them.
    lowest: u64,
    highest: u64,
    /// What full scale is now.
    scale_now: f64,
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
        self.settings = settings;
        self.lowest = limit(self.min_limit, min).to_bits();
        self.highest = limit(self.max_limit, max).to_bits();
        self.scale_now = param(self.scale).unwrap_or(0.0);
    }

    /// What becomes of a value that the application has set.
    pub fn sanitise<T: Value>(&self, value: T) -> (T, Option<Rejection>) {
        if !AnyValue::from(value).is_finite() {
            return (T::from_bits(self.safe), Some(Rejection::NotFinite));
        }
        let (min, max) = (T::from_bits(self.lowest), T::from_bits(self.highest));
        if min <= value && value <= max {
            return (value, None);
        }
        let allowed = if min > max {
            // No value is allowed, so that neither limit is a sensible one.
            self.safe
        } else if value > max {
            self.highest
        } else {
            self.lowest
        };
        (T::from_bits(allowed), Some(Rejection::OutOfRange))
    }

    /// A value in the units of the wire.
    // The scale is compared with what it was made with: nothing was computed.
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

/// Whether a number can be a scale: what it makes of any count or voltage is a number.
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
) -> Result<(Slot, Rule), PinError> {
    let group = pins.part(part).ok_or(PinError::ForeignHandle)?.group;
    let parameter = |key: Option<Key>| match key {
        None => Ok(NONE),
        Some(key) if pins.index(key).is_some() => Ok(key.index),
        Some(_) => Err(PinError::ForeignHandle),
    };
    let invert = parameter(spec.invert.map(Invert::key))?;
    let max_limit = parameter(spec.max_limit.map(|param| param.key))?;
    let min_limit = parameter(spec.min_limit.map(|param| param.key))?;
    let scale = parameter(spec.full_scale.map(|full| full.scale.key))?;
    let wire = spec
        .full_scale
        .map_or((0.0, 0.0), |full| (full.min, full.max));
    let is_real = T::TYPE == HalType::Float;
    // The first value of an input may lie outside its limits: they are informational.
    let limits = spec.limits.filter(|_| role != Role::Input);
    let ends = limits.unwrap_or_default();
    let are_finite = [ends.0, ends.1, wire.0, wire.1].map(f64::is_finite);
    let (min, max) =
        limits.map_or_else(T::bounds, |(min, max)| (T::from_f64(min), T::from_f64(max)));
    let is_within = min <= initial && initial <= max && AnyValue::from(initial).is_finite();
    if are_finite != [true; 4] || !is_within || (scale != NONE && !is_real) {
        return Err(PinError::BadLimits {
            name: ShortName::new(&spec.name),
            initial: initial.into(),
            limits,
        });
    }
    let safe = initial.to_bits();
    let slot = Slot {
        bits: safe,
        group,
        part: part.0.index,
        invert,
        bad: false,
        exempt: false,
        // A real number can be NaN.
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
    Ok((slot, rule))
}

#[cfg(test)]
mod tests;
