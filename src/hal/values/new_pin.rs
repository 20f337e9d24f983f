//! A new pin or parameter: its place, its limits and the parameters that it follows.

use super::rule::Rule;
use super::slot::{NONE, PinSlot};
use crate::hal::handle::Key;
use crate::hal::{AnyValue, HalType, Invert, PinError, Role, ShortName, Spec, Value};

/// A pin or parameter to be made.
#[derive(Clone, Copy, Debug)]
pub(in crate::hal) struct NewPin<'a, T> {
    /// Its name, its limits, and the parameters that it follows.
    pub spec: &'a Spec,
    pub role: Role,
    pub initial: T,
    /// The number of its group.
    pub group: usize,
    /// The index of the part.
    pub part: usize,
    /// An output that faults do not affect.
    pub is_exempt: bool,
    /// Not valid before a value is published.
    pub is_withheld: bool,
}

impl<T: Value> NewPin<'_, T> {
    /// Its slot, and its rule if it has one, with the index `rule`. The index of a parameter is
    /// that of its key, if it is one of the same store.
    pub(super) fn make(
        self,
        rule: usize,
        index: impl Fn(Key) -> Option<usize>,
    ) -> Result<(PinSlot, Option<Rule>), PinError> {
        let short = |number: usize| u16::try_from(number).map_err(|_| PinError::TooMany);
        let parameter = |key: Option<Key>| match key.map(&index) {
            None => Ok(NONE),
            Some(own) => own.map(|n| n as u32).ok_or(PinError::ForeignHandle),
        };
        let spec = self.spec;
        let invert = parameter(spec.invert.map(Invert::key))?;
        let max_limit = parameter(spec.max_limit.map(|param| param.key))?;
        let min_limit = parameter(spec.min_limit.map(|param| param.key))?;
        let scale = parameter(spec.full_scale.map(|full| full.scale.key))?;
        let (min, max) = self.bounds()?;
        let is_real = T::TYPE == HalType::Float;
        // A float can be NaN, which is counted for the pin.
        let has_rule = is_real || matches!(self.role, Role::Output | Role::InOut);
        let has_limits = (min, max) != T::bounds() || max_limit != NONE || min_limit != NONE;
        let slot = PinSlot {
            bits: self.initial.to_bits(),
            group: short(self.group)?,
            part: short(self.part)?,
            rule: if has_rule { rule as u32 } else { NONE },
            invert,
            bad: self.is_withheld,
            exempt: self.is_exempt,
            is_free: !is_real && !has_limits,
            role: self.role,
        };
        let mut rule = Rule::new(slot.bits, (min.to_bits(), max.to_bits()));
        (rule.max_limit, rule.min_limit, rule.scale) = (max_limit, min_limit, scale);
        if let Some(full) = spec.full_scale {
            rule.wire = (full.min, full.max);
        }
        Ok((slot, has_rule.then_some(rule)))
    }

    /// The smallest and the largest value, checked to be usable and to contain the first value.
    fn bounds(&self) -> Result<(T, T), PinError> {
        let (spec, initial) = (self.spec, self.initial);
        // The first value of an input may lie outside its limits, which are informational.
        let limits = spec.limits.filter(|_| self.role != Role::Input);
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
}
