//! The driver's side: groups, and the cycle.
//!
//! A driver calls [`PinStore::begin_cycle`] first. Then, for each group whose transfer succeeded,
//! it calls [`PinStore::publish`] for the inputs and [`PinStore::group_good`], or
//! [`PinStore::fault`] for one that failed. After the application has run, it calls
//! [`PinStore::fetch`] for the outputs.

use alloc::vec::Vec;
use core::ops::{Deref, DerefMut};
use core::sync::atomic::{AtomicU32, Ordering};

use super::arming::{Arming, ArmingCondition, ArmingEvent};
use super::handle::Key;
use super::handle::kind::{Publishable, Settable};
use super::pins::{Group, GroupPart, RestatedOutput};
use super::rule::NONE;
use super::{
    AnyValue, GroupId, Handle, Input, Output, PinError, PinId, Pins, Rejection, Role, Value,
};
use crate::bus::Instant;

/// Number of the next store; 0 belongs to none.
static NEXT_STORE: AtomicU32 = AtomicU32::new(1);

/// The driver's side of all pins and parameters of a machine.
///
/// A [`PinMaker`](super::PinMaker) makes the pins in it; it publishes inputs and fetches outputs.
/// The operations that are also open to an application are in [`Pins`], to which it derefs. The
/// driver owns it and lends it to its modules; an application gets the [`Pins`] in it. Set-up
/// allocates; everything in the cycle takes constant time for each pin, never allocates and never
/// panics.
#[derive(Debug)]
pub struct PinStore {
    pins: Pins<[(); 0]>,
}

impl Default for PinStore {
    fn default() -> Self {
        let pins = Pins {
            // Wraps around after 2^32 stores, and is never 0.
            id: NEXT_STORE.fetch_add(1, Ordering::Relaxed).max(1),
            ..Pins::default()
        };
        Self { pins }
    }
}

impl Deref for PinStore {
    type Target = Pins;

    fn deref(&self) -> &Pins {
        &self.pins
    }
}

impl DerefMut for PinStore {
    fn deref_mut(&mut self) -> &mut Pins {
        &mut self.pins
    }
}

/// Set-up. Allocates.
impl PinStore {
    /// Adds a group. It is not valid before its first good transfer, and armed (its outputs begin
    /// with their safe values).
    pub fn add_group(&mut self) -> GroupId {
        let (group, part) = (self.groups.len() as u32, self.parts.len() as u32);
        self.groups.push(Group {
            is_good: false,
            is_own: false,
            is_of_application: false,
            arming: Arming::Armed,
            last_good: None,
            faults: 0,
            outputs: Vec::new(),
            part,
            epoch: 0,
        });
        self.push_part(group)
    }

    /// Sets the age in cycles from which on inputs are not valid; 0 (the default) for never.
    pub fn set_stale_after(&mut self, cycles: u32) {
        self.stale_after = cycles;
    }

    /// Age in cycles from which on inputs are not valid; 0 for never.
    pub const fn stale_after(&self) -> u32 {
        self.pins.stale_after
    }

    /// Exempts the inputs of a group from becoming stale: their values come from the driver itself.
    pub fn keep_valid(&mut self, group: GroupId) {
        if let Some(group) = self.group_mut(group) {
            group.is_own = true;
        }
    }

    /// Adds a part to a group, for pins whose changes are to be detected separately from the rest:
    /// see [`output_version`](Self::output_version). Everything else is the group's: a part is
    /// valid and armed with it, and a pin made in it belongs to the group.
    ///
    /// # Errors
    /// [`PinError::ForeignHandle`] for a group of another store.
    pub fn add_part(&mut self, group: GroupId) -> Result<GroupId, PinError> {
        let GroupPart { group, .. } = *self.part(group).ok_or(PinError::ForeignHandle)?;
        Ok(self.push_part(group))
    }

    /// Declares that the value of an output reaches its terminal only while `by` is on: see
    /// [`PinInfo::enabled_by`](super::PinInfo::enabled_by). A pin of another store changes nothing.
    pub fn enabled_by(&mut self, output: impl Into<PinId>, by: impl Into<PinId>) {
        let (output, by) = (output.into(), by.into());
        let are_own = [output, by].map(|pin| self.info_of(pin).is_some()) == [true; 2];
        if let Some(info) = self.infos.get_mut(output.index())
            && are_own
        {
            info.enabled_by = Some(by);
            if let Some(rule) = self.rule_mut(output.index()) {
                rule.enabling.by = by.index() as u32;
            }
        }
    }

    /// Declares that the values of an output may change their meaning: see [`restate`](Self::restate).
    pub(crate) fn may_be_restated(&mut self, pin: Output<f64>) {
        if let Some(index) = self.index(pin.key) {
            let restated = RestatedOutput {
                index: index as u32,
                outdated: None,
            };
            // Pins are made in the order of their indices.
            self.restated.push(restated);
        }
    }

    fn push_part(&mut self, group: u32) -> GroupId {
        let part = self.key(self.parts.len() as u32);
        self.parts.push(GroupPart { group, version: 0 });
        GroupId(part)
    }
}

/// The cycle. Constant time for each pin, no allocation, no panic.
impl PinStore {
    /// Begins a new cycle at `now`: ages grow.
    pub fn begin_cycle(&mut self, now: Instant) {
        self.cycle = self.cycle.saturating_add(1);
        self.now = now;
    }

    /// Gives a value to an input, to a pin that both sides set, or to a parameter (a property, or a
    /// value read from a remote). A pin becomes valid with its group.
    ///
    /// A value that is not finite is counted and not published: the pin keeps its last value and is
    /// not valid.
    pub fn publish<K: Publishable, T: Copy + Into<AnyValue>>(
        &mut self,
        pin: Handle<K, T>,
        value: T,
    ) {
        let value = value.into();
        debug_assert!(self.info(pin).is_none_or(|i| i.hal_type == value.hal_type));
        self.publish_any(pin.key, value);
    }

    pub(super) fn publish_any(&mut self, key: Key, value: AnyValue) {
        let Some(slot) = self.slot_mut(key) else {
            return;
        };
        let before = slot.bits;
        if !slot.accept(value) {
            return self.reject(key, Rejection::NotFinite);
        }
        let has_changed = before != value.bits;
        // Outputs may depend on any pin that is not an input.
        if has_changed && slot.role != Role::Input {
            self.changed(key);
            self.settings = self.settings.wrapping_add(1);
        }
    }

    /// Withdraws the value of an input: it is not valid until it is published again, even if its
    /// group is. For values that are not known yet.
    pub fn withhold<T: Value>(&mut self, pin: Input<T>) {
        if let Some(slot) = self.slot_mut(pin.key) {
            slot.bad = true;
        }
    }

    /// Records that the transfer of a group succeeded in this cycle: its inputs are valid, with age
    /// 0.
    pub fn group_good(&mut self, group: GroupId) {
        self.group_good_since(group, 0, self.now);
    }

    /// Like [`group_good`](Self::group_good), for a transfer that was started at `started` and
    /// completed `cycles` cycles after it was due: its data has that age.
    pub fn group_good_since(&mut self, group: GroupId, cycles: u64, started: Instant) {
        let good = (self.cycle.saturating_sub(cycles), started.min(self.now));
        let Some(index) = self.group_index(group) else {
            return self.count_foreign();
        };
        let Some(group) = self.groups.get_mut(index) else {
            return;
        };
        group.is_good = true;
        group.last_good = Some(good);
        if group.arming.is_awaited()
            && let Some(group) = self.groups.get(index)
            && self.is_valid(group)
        {
            self.change_arming(index, ArmingEvent::GoodTransfer);
        }
    }

    /// The arming of a group; safe for a group of another store.
    pub(crate) fn arming(&self, group: GroupId) -> Arming {
        let group = self.group_index(group).and_then(|n| self.groups.get(n));
        group.map_or(Arming::Safe, |group| group.arming)
    }

    /// Arms a group that is not armed on a condition, unless a weaker one is asked for than before.
    /// Returns true if the group was neither armed nor awaited.
    pub(crate) fn request_arming(&mut self, group: GroupId, when: ArmingCondition) -> bool {
        self.change_arming_of(group, ArmingEvent::Request(when)) == Some(Arming::Safe)
    }

    /// Cancels the arming of a group that is not armed; returns true if it was awaited.
    pub(crate) fn cancel_arming(&mut self, group: GroupId) -> bool {
        let before = self.change_arming_of(group, ArmingEvent::Cancel);
        before.is_some_and(Arming::is_awaited)
    }

    /// Cancels the arming of all groups, except of those that wait for the board's set-up unless
    /// they are `included`; returns their number.
    pub(crate) fn cancel_all_arming(&mut self, included: bool) -> u32 {
        let mut count = 0_u32;
        for index in 0..self.groups.len() {
            let arming = self.groups.get(index).map(|group| group.arming);
            let is_concerned = arming.is_some_and(|arming| {
                arming.awaits_transfer().is_some() || included && arming.is_awaited()
            });
            if is_concerned {
                self.change_arming(index, ArmingEvent::Cancel);
                count = count.saturating_add(1);
            }
        }
        count
    }

    /// Lets all groups that wait for the board's set-up wait for their next good transfer.
    pub(crate) fn set_up_restored(&mut self) {
        for index in 0..self.groups.len() {
            self.change_arming(index, ArmingEvent::SetUp);
        }
    }

    /// Counts a fault of a group that is not armed, but ran.
    pub(crate) fn count_loss(&mut self) {
        self.losses = self.losses.saturating_add(1);
    }

    /// Changes the arming of a group, and returns the one before; a group of another store is
    /// counted.
    fn change_arming_of(&mut self, group: GroupId, event: ArmingEvent) -> Option<Arming> {
        let Some(index) = self.group_index(group) else {
            self.count_foreign();
            return None;
        };
        Some(self.change_arming(index, event))
    }

    /// Makes the inputs of a group not valid after a failed transfer; outputs are not affected.
    pub fn invalidate(&mut self, group: GroupId) {
        if let Some(group) = self.group_mut(group) {
            group.is_good = false;
        }
    }

    /// Handles the failure of a group: its inputs are no longer valid, and its outputs are safe
    /// until the application re-arms it. Everything set before is forgotten, and so is everything
    /// set until then, so that re-arming does not bring back an old command.
    pub fn fault(&mut self, group: GroupId) {
        self.invalidate(group);
        self.disarm(group);
    }

    /// Makes the outputs of a group safe until the application re-arms it; inputs are not affected.
    /// Everything set up to now is forgotten, including what was set after an earlier fault.
    pub fn disarm(&mut self, group: GroupId) {
        self.change_arming_of(group, ArmingEvent::Fault);
    }

    /// Version of the outputs of a part. Changes whenever [`fetch`](Self::fetch) of any of them may
    /// return another value than before or would count a replaced value, and whenever a parameter
    /// of the part changes; while it stays the same, nothing has to be fetched again. The
    /// parameters that limit, scale or invert outputs must belong to the same part. `None` for a
    /// group of another store.
    pub fn output_version(&self, group: GroupId) -> Option<u64> {
        let part = self.part(group)?;
        let epoch = self.groups.get(part.group as usize)?.epoch;
        let others = epoch.wrapping_add(self.switches);
        Some(part.version.wrapping_add(others))
    }

    /// The value that an output must have now: sanitised, limited, and inverted if configured.
    /// Returns the safe value if its group is not armed, or if it is not enabled while others that
    /// share its enable are: see [`AnalogOut::enable`](super::AnalogOut::enable).
    ///
    /// A value that is not finite is replaced by the safe value, one out of range by the nearest
    /// limit. Both are counted, for the pin and in total, each time the driver fetches such a
    /// value. Nothing ever wraps around.
    pub fn fetch<K: Settable, T: Value>(&mut self, pin: Handle<K, T>) -> T {
        let key = pin.key;
        let Some((slot, group)) = self.slot(key) else {
            return T::default();
        };
        let follows = group.is_armed() || slot.exempt;
        let (set, invert) = (T::from_bits(slot.bits), slot.invert);
        let value = if follows && slot.is_free {
            set
        } else {
            self.ruled(key, set, follows)
        };
        let is_inverted =
            invert != NONE && self.slots.get(invert as usize).is_some_and(|s| s.bits != 0);
        if is_inverted { value.inverted() } else { value }
    }

    /// Changes the safe value of an output whose safe state depends on the machine: the command of a
    /// position is safe where the axis stands. It is the value of the output while its group is not
    /// armed, and when the group is armed again. It has to be within the limits of the output; a value
    /// that is not finite changes nothing.
    pub fn set_safe(&mut self, pin: Output<f64>, safe: f64) {
        let index = self.index(pin.key).filter(|_| safe.is_finite());
        if let Some(rule) = index.and_then(|index| self.rule_mut(index))
            && core::mem::replace(&mut rule.safe, safe.to_bits()) != safe.to_bits()
        {
            self.changed(pin.key);
        }
    }

    /// States the command of an output in new coordinates: the meaning of its values has changed, and
    /// the output is to stay where it was commanded to be. A program that
    /// [repeats](super::Pins::repeat_bits) the value of before in each cycle does not set it again. A
    /// value that is not finite changes nothing.
    pub(crate) fn restate(&mut self, pin: Output<f64>, command: f64) {
        if !command.is_finite() {
            return;
        }
        let Some(slot) = self.slot_mut(pin.key) else {
            return;
        };
        let before = core::mem::replace(&mut slot.bits, command.to_bits());
        // That of the first change: a repeated value is still that one.
        if let Some(restated) = self.restated_mut(pin.key)
            && restated.outdated.is_none()
        {
            restated.outdated = Some(before);
            self.outdated = self.outdated.saturating_add(1);
        }
        self.changed(pin.key);
    }

    /// Counts a value of `pin` as out of range that a module has replaced in its register word.
    pub fn count_out_of_range<K: Copy, T: Copy>(&mut self, pin: Handle<K, T>) {
        self.reject(pin.key, Rejection::OutOfRange);
    }

    /// The value that goes out by the pin's rule when it was set to `set`; its safe value if it
    /// does not follow the application.
    fn ruled<T: Value>(&mut self, key: Key, set: T, follows: bool) -> T {
        let Some(index) = self.index(key) else {
            return T::default();
        };
        let follows = follows && !self.is_held(index);
        let pins = &mut self.pins;
        let rule = pins.slots.get(index).map(|slot| slot.rule as usize);
        let Some(rule) = rule.and_then(|rule| pins.rules.get_mut(rule)) else {
            return T::default();
        };
        if rule.settings != pins.settings {
            rule.apply::<T>(&pins.slots, pins.settings);
        }
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
            self.reject(key, rejection);
        }
        value
    }

    pub(super) fn reject(&mut self, key: Key, rejection: Rejection) {
        self.totals.count(rejection);
        if let Some(index) = self.index(key)
            && let Some(rule) = self.rule_mut(index)
        {
            rule.rejections.count(rejection);
        }
        // Fetched, and counted, in each cycle again.
        self.changed(key);
    }
}

#[cfg(test)]
pub(super) mod tests;
