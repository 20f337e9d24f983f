//! The values of the pins: what was set or published, what goes out, and what counts as changed.

mod enabling;
mod new_pin;
mod restated;
mod rule;
mod slot;

use alloc::vec::Vec;
use core::mem;

use super::handle::Key;
use super::room::for_one_more;
use super::{AnyValue, PinError, Rejection, Rejections, Role, Value};
use enabling::Enabling;
pub(super) use enabling::MAX_ENABLES;
pub(super) use new_pin::NewPin;
use restated::RestatedOutputs;
use rule::Rule;
use slot::{NONE, PinSlot};

/// The values of all pins and parameters of a store, by their indices. An index without a pin
/// changes nothing.
#[derive(Debug, Default)]
pub(super) struct Values {
    slots: Vec<PinSlot>,
    /// Those of the slots that have one.
    rules: Vec<Rule>,
    /// By part: incremented when the required values of its outputs may have changed.
    versions: Vec<u64>,
    /// Incremented when a parameter changes.
    settings: u64,
    /// Incremented when an output is newly enabled or held, or commands are forgotten.
    switches: u64,
    rejections: Rejections,
    restated: RestatedOutputs,
}

/// A pin or parameter as it is stored.
#[derive(Clone, Copy, Debug)]
pub(super) struct StoredValue {
    pub bits: u64,
    /// The number of its group.
    pub group: usize,
    /// The value was refused or withheld, or is an output of a group that is not armed.
    pub is_bad: bool,
    /// Faults do not affect it.
    pub is_exempt: bool,
}

/// Set-up. Allocates.
impl Values {
    /// Adds the pin with the next index. The parameters that it follows are found by `index`.
    pub fn add<T: Value>(
        &mut self,
        pin: NewPin<'_, T>,
        index: impl Fn(Key) -> Option<usize>,
    ) -> Result<(), PinError> {
        let (slot, rule) = pin.make(self.rules.len(), index)?;
        for_one_more(&mut self.slots).push(slot);
        if let Some(rule) = rule {
            for_one_more(&mut self.rules).push(rule);
        }
        Ok(())
    }

    /// Adds the next part of a group.
    pub fn add_part(&mut self) {
        self.versions.push(0);
    }

    /// Declares that an output reaches its terminal only while the pin `by` is on.
    pub fn set_enabled_by(&mut self, output: usize, by: usize) {
        if let Some(rule) = self.rule_mut(output) {
            rule.enabling.by = by as u32;
        }
    }

    /// Declares that the values of an output may change their meaning, after all outputs before it.
    pub fn may_be_restated(&mut self, output: usize) {
        self.restated.add(output);
    }

    /// Removes all pins from index `pins` on, and all parts from index `parts` on.
    pub fn truncate(&mut self, pins: usize, parts: usize) {
        self.slots.truncate(pins);
        let with_rule = self.slots.iter().filter(|slot| slot.rule != NONE);
        self.rules.truncate(with_rule.count());
        self.versions.truncate(parts);
        self.restated.truncate(pins);
    }

    /// Releases the memory that was kept for further pins.
    pub fn shrink_to_fit(&mut self) {
        self.slots.shrink_to_fit();
        self.rules.shrink_to_fit();
        self.versions.shrink_to_fit();
    }
}

/// What the application sees and sets.
impl Values {
    #[inline]
    pub fn get(&self, index: usize) -> Option<StoredValue> {
        self.slots.get(index).map(|slot| StoredValue {
            bits: slot.bits,
            group: slot.group.into(),
            is_bad: slot.bad,
            is_exempt: slot.exempt,
        })
    }

    /// The value of a pin as the application sees it: for a held output its safe value.
    #[inline]
    pub fn displayed(&self, index: usize) -> Option<u64> {
        let slot = self.slots.get(index)?;
        Some(self.displayed_of(index, slot))
    }

    /// The values of all pins as the application sees them, and whether each is bad.
    pub fn all_displayed(&self) -> impl Iterator<Item = (u64, bool)> + '_ {
        let slots = self.slots.iter().zip(0..);
        slots.map(|(slot, index)| (self.displayed_of(index, slot), slot.bad))
    }

    /// Sets an output, or a pin that both sides set.
    #[inline]
    pub fn set(&mut self, index: usize, bits: u64) {
        if let Some(slot) = self.slots.get_mut(index)
            && mem::replace(&mut slot.bits, bits) != bits
        {
            let part = slot.part;
            self.changed(part);
        }
    }

    /// Sets a pin, if it is one that an application sets; returns false otherwise.
    #[inline]
    pub fn set_pin(&mut self, index: usize, bits: u64) -> bool {
        let role = self.slots.get(index).map(|slot| slot.role);
        let is_pin = matches!(role, Some(Role::Output | Role::InOut));
        if is_pin {
            self.set(index, bits);
        }
        is_pin
    }

    /// True for the value of before the meaning of the output's values changed; any other one ends
    /// that.
    #[inline]
    pub fn check_outdated(&mut self, index: usize, bits: u64) -> bool {
        self.restated.check_outdated(index, bits)
    }

    /// Sets a parameter.
    pub fn set_parameter(&mut self, index: usize, bits: u64) {
        if let Some(slot) = self.slots.get_mut(index) {
            slot.bits = bits;
            let part = slot.part;
            self.changed(part);
            self.settings = self.settings.wrapping_add(1);
        }
    }

    /// The value of an output within its limits, without the inversion or scale of the wire.
    pub fn command<T: Value>(&mut self, index: usize) -> T {
        let set = self.slots.get(index).map_or(0, |slot| slot.bits);
        let Some(rule) = self.current_rule::<T>(index) else {
            return T::default();
        };
        let (value, rejection) = rule.sanitise(T::from_bits(set));
        if let Some(rejection) = rejection {
            self.reject(index, rejection);
        }
        value
    }

    pub const fn settings(&self) -> u64 {
        self.settings
    }

    pub const fn total_rejections(&self) -> Rejections {
        self.rejections
    }

    pub fn rejections(&self, index: usize) -> Rejections {
        let rule = self.rule(index);
        rule.map_or_else(Rejections::default, |rule| rule.rejections)
    }

    /// The safe value of a pin with a rule.
    #[cfg(feature = "std")]
    pub fn safe(&self, index: usize) -> Option<u64> {
        Some(self.rule(index)?.safe)
    }
}

/// What the driver publishes and fetches.
impl Values {
    /// Publishes a value. One that is not finite is counted and not published: the pin keeps its
    /// last value and is not valid.
    pub fn publish(&mut self, index: usize, value: AnyValue) {
        let Some(slot) = self.slots.get_mut(index) else {
            return;
        };
        let before = slot.bits;
        if !slot.accept(value) {
            return self.reject(index, Rejection::NotFinite);
        }
        let has_changed = before != value.bits;
        // Outputs may depend on any pin that is not an input.
        if has_changed && slot.role != Role::Input {
            let part = slot.part;
            self.changed(part);
            self.settings = self.settings.wrapping_add(1);
        }
    }

    /// Publishes the values of inputs that follow each other from index `first` on; returns false
    /// if there are fewer.
    #[inline]
    pub fn publish_row<const N: usize>(&mut self, first: usize, values: [AnyValue; N]) -> bool {
        let slots = self.slots.get_mut(first..);
        let Some(slots) = slots.and_then(|slots| slots.first_chunk_mut::<N>()) else {
            return false;
        };
        // One look at all of them: a sum with NaN is NaN.
        let doubt = values.map(AnyValue::nonfinite_part);
        if doubt.into_iter().sum::<f64>().is_nan() {
            for (index, value) in (first..).zip(values) {
                self.publish_doubtful(index, value);
            }
        } else {
            for (slot, value) in slots.iter_mut().zip(values) {
                slot.take(value);
            }
        }
        true
    }

    #[cold]
    fn publish_doubtful(&mut self, index: usize, value: AnyValue) {
        self.publish(index, value);
    }

    /// Withdraws the value of an input until it is published again.
    pub fn withhold(&mut self, index: usize) {
        if let Some(slot) = self.slots.get_mut(index) {
            slot.bad = true;
        }
    }

    /// The value that an output must have now: sanitised, limited, and inverted if configured; its
    /// safe value if its group is not armed. `None` without such a pin.
    pub fn fetch<T: Value>(&mut self, index: usize, is_armed: impl Fn(usize) -> bool) -> Option<T> {
        let slot = self.slots.get(index)?;
        let follows = is_armed(slot.group.into()) || slot.exempt;
        let (set, invert) = (T::from_bits(slot.bits), slot.invert);
        let value = if follows && slot.is_free {
            set
        } else {
            self.ruled(index, set, follows)
        };
        let is_inverted =
            invert != NONE && self.slots.get(invert as usize).is_some_and(|s| s.bits != 0);
        Some(if is_inverted { value.inverted() } else { value })
    }

    /// The value that goes out by the pin's rule when it was set to `set`; its safe value if it
    /// does not follow the application.
    fn ruled<T: Value>(&mut self, index: usize, set: T, follows: bool) -> T {
        let follows = follows && !self.is_held(index);
        let Some(rule) = self.current_rule::<T>(index) else {
            return T::default();
        };
        let (mut value, mut rejection) = if follows {
            rule.sanitise(set)
        } else {
            (T::from_bits(rule.safe), None)
        };
        if rule.scale != NONE {
            // Only floats have a full scale.
            let (real, refused) = rule.on_wire(f64::from_bits(value.to_bits()));
            value = T::from_bits(real.to_bits());
            rejection = rejection.or(refused);
        }
        if let Some(rejection) = rejection {
            self.reject(index, rejection);
        }
        value
    }

    /// The rule of a pin that has one, with the present values of its parameters.
    fn current_rule<T: Value>(&mut self, index: usize) -> Option<&Rule> {
        let rule = self.slots.get(index)?.rule as usize;
        let rule = self.rules.get_mut(rule)?;
        if rule.settings != self.settings {
            rule.apply::<T>(&self.slots, self.settings);
        }
        Some(rule)
    }

    /// Changes the safe value of an output.
    pub fn set_safe(&mut self, index: usize, safe: u64) {
        if let Some(slot) = self.slots.get(index)
            && let Some(rule) = self.rules.get_mut(slot.rule as usize)
            && mem::replace(&mut rule.safe, safe) != safe
        {
            let part = slot.part;
            self.changed(part);
        }
    }

    /// Sets an output to the same command in new coordinates.
    pub fn restate(&mut self, index: usize, command: u64) {
        if let Some(slot) = self.slots.get_mut(index) {
            let before = mem::replace(&mut slot.bits, command);
            let part = slot.part;
            self.restated.restate(index, before);
            self.changed(part);
        }
    }

    /// Counts a value that was replaced instead of used.
    pub fn reject(&mut self, index: usize, rejection: Rejection) {
        self.rejections.count(rejection);
        let Some(slot) = self.slots.get(index) else {
            return;
        };
        if let Some(rule) = self.rules.get_mut(slot.rule as usize) {
            rule.rejections.count(rejection);
        }
        // Fetched, and counted, in each cycle again.
        let part = slot.part;
        self.changed(part);
    }

    /// Sets outputs to their safe values, except those that faults do not affect. Unless they
    /// follow the application again, they read as not valid.
    pub fn forget_commands(&mut self, outputs: &[u32], follow: bool) {
        // Outputs of other groups may share an enable with them.
        self.switches = self.switches.wrapping_add(1);
        for &output in outputs {
            if let Some(slot) = self.slots.get_mut(output as usize)
                && let Some(rule) = self.rules.get_mut(slot.rule as usize)
                && !slot.exempt
            {
                slot.bits = rule.safe;
                slot.bad = slot.role == Role::Output && !follow;
                rule.enabling.forget();
            }
        }
    }

    /// A number that is another one when the required values of outputs in a part may have changed.
    pub fn version(&self, part: usize) -> Option<u64> {
        let version = self.versions.get(part)?;
        Some(version.wrapping_add(self.switches))
    }

    #[inline]
    fn changed(&mut self, part: u16) {
        if let Some(version) = self.versions.get_mut(usize::from(part)) {
            *version = version.wrapping_add(1);
        }
    }
}

/// Outputs that share an enable.
impl Values {
    /// Enables an output, or holds it at its safe value. Its enable is on while any of the outputs
    /// that share it is enabled; from this call on, those of them that are not enabled are held.
    pub fn enable_alone(&mut self, output: usize, by: usize, on: bool) {
        let (Some(before), Some(first)) = (self.enabling(output), self.enabling(by)) else {
            return;
        };
        let was_on = before.since != 0 && !self.is_held(output);
        if (before.by, first.round, was_on) != (by as u32, first.round.max(1), on) {
            self.switches = self.switches.wrapping_add(1);
            if was_on {
                self.each_enable(before.by as usize, |enable| {
                    enable.wanted = enable.wanted.saturating_sub(1);
                });
            }
            self.note_enabled(output, by, 0);
            self.each_enable(by, |enable| {
                enable.round = enable.round.max(1);
                enable.wanted = enable.wanted.saturating_add(u32::from(on));
            });
            let round = self.enabling(by).map_or(0, |by| by.round);
            self.note_enabled(output, by, if on { round } else { 0 });
        }
        let mut next = Some(by).filter(|by| *by != output);
        for _ in 0..MAX_ENABLES {
            let Some((pin, enable)) = next.and_then(|pin| Some((pin, self.enabling(pin)?))) else {
                return;
            };
            self.set(pin, (enable.wanted > 0).to_bits());
            next = self.enable_of(pin);
        }
    }

    /// Notes by which enable an output is enabled, and since which of its rounds.
    fn note_enabled(&mut self, output: usize, by: usize, since: u32) {
        if let Some(rule) = self.rule_mut(output) {
            (rule.enabling.by, rule.enabling.since) = (by as u32, since);
        }
    }

    /// True if an output has its safe value because it is not enabled while its enable is managed
    /// output by output.
    fn is_held(&self, output: usize) -> bool {
        let Some(own) = self.enabling(output) else {
            return false;
        };
        let round = self.enabling(own.by as usize).map_or(0, |by| by.round);
        round != 0 && own.since != round
    }

    /// Changes an enable and the ones that it needs in turn.
    fn each_enable(&mut self, first: usize, change: impl Fn(&mut Enabling)) {
        let mut next = Some(first);
        for _ in 0..MAX_ENABLES {
            let Some(rule) = next.and_then(|pin| self.rule_mut(pin)) else {
                return;
            };
            change(&mut rule.enabling);
            next = next.and_then(|pin| self.enable_of(pin));
        }
    }

    /// The enable that an enable itself needs, if both belong to the same group and fail together.
    fn enable_of(&self, pin: usize) -> Option<usize> {
        let by = self.enabling(pin)?.by as usize;
        (self.slots.get(by)?.group == self.slots.get(pin)?.group).then_some(by)
    }

    fn enabling(&self, pin: usize) -> Option<Enabling> {
        Some(self.rule(pin)?.enabling)
    }

    #[inline]
    fn displayed_of(&self, index: usize, slot: &PinSlot) -> u64 {
        if !slot.is_free
            && slot.role == Role::Output
            && self.is_held(index)
            && let Some(rule) = self.rules.get(slot.rule as usize)
        {
            return rule.safe;
        }
        slot.bits
    }

    fn rule(&self, index: usize) -> Option<&Rule> {
        self.rules.get(self.slots.get(index)?.rule as usize)
    }

    fn rule_mut(&mut self, index: usize) -> Option<&mut Rule> {
        self.rules.get_mut(self.slots.get(index)?.rule as usize)
    }
}

#[cfg(test)]
mod tests;
