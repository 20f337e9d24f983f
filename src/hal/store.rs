//! The driver's side: groups, and the cycle.
//!
//! A driver calls [`PinStore::begin_cycle`] first. Then, for each group whose transfer succeeded,
//! it calls [`PinStore::publish`] for the inputs and [`PinStore::group_good`], or
//! [`PinStore::fault`] for one that failed. After the application has run, it calls
//! [`PinStore::fetch`] for the outputs.

use alloc::string::String;
use core::ops::{Deref, DerefMut};

use super::arming::ArmingEvent;
use super::groups::Origin;
use super::handle::kind::{Publishable, Settable};
use super::{AnyValue, GroupId, Handle, Input, Output, PinError, PinId, Pins, Rejection, Value};
use crate::bus::Instant;

/// The driver's side of all pins and parameters of a machine.
///
/// A [`PinMaker`](super::PinMaker) makes the pins in it; it publishes inputs and fetches outputs.
/// The operations that are also open to an application are in [`Pins`], to which it derefs. The
/// driver owns it and lends it to its modules; an application gets the [`Pins`] in it. Set-up
/// allocates; everything in the cycle takes constant time for each pin, never allocates and never
/// panics.
#[derive(Debug, Default)]
pub struct PinStore {
    pins: Pins<[(); 0]>,
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
        let part = self.groups.add();
        self.made_part(part)
    }

    /// Sets the age in cycles from which on inputs are not valid; 0 (the default) for never.
    pub fn set_stale_after(&mut self, cycles: u32) {
        self.groups.set_stale_after(cycles);
    }

    /// Age in cycles from which on inputs are not valid; 0 for never.
    pub const fn stale_after(&self) -> u32 {
        self.pins.groups.stale_after()
    }

    /// Exempts the inputs of a group from becoming stale: their values come from the driver itself.
    pub fn keep_valid(&mut self, group: GroupId) {
        self.set_origin(group, Origin::Driver);
    }

    pub(super) fn set_origin(&mut self, group: GroupId, origin: Origin) {
        if let Some(number) = self.resolve_group(group) {
            self.groups.set_origin(number, origin);
        }
    }

    /// Adds a part to a group, for pins whose changes are to be detected separately from the rest:
    /// see [`output_version`](Self::output_version). Everything else is the group's: a part is
    /// valid and armed with it, and a pin made in it belongs to the group.
    ///
    /// # Errors
    /// [`PinError::ForeignHandle`] for a group of another store.
    pub fn add_part(&mut self, group: GroupId) -> Result<GroupId, PinError> {
        let number = self.group_number(group).ok_or(PinError::ForeignHandle)?;
        let part = self.groups.add_part(number);
        Ok(self.made_part(part))
    }

    /// The id of a part that was added to the groups.
    fn made_part(&mut self, part: u32) -> GroupId {
        self.values.add_part();
        GroupId(self.catalog.key(part))
    }

    /// Gives a pin or parameter a second name, as LinuxCNC's `hal_param_alias`.
    ///
    /// ```
    /// use mesa_hal::hal::{PinError, PinMaker, PinStore};
    /// # fn main() -> Result<(), PinError> {
    /// let mut store = PinStore::default();
    /// let group = store.add_group();
    /// let inverted = PinMaker::new(&mut store, group, "board.gpio.000.").setting("invert", false)?;
    /// store.add_alias(inverted, "board.spindle.invert")?;
    /// assert_eq!(store.parameter("board.spindle.invert"), Ok(inverted));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`PinError::BadName`], [`PinError::NameTaken`], and [`PinError::ForeignHandle`] for a pin of
    /// another store.
    pub fn add_alias(
        &mut self,
        pin: impl Into<PinId>,
        alias: impl Into<String>,
    ) -> Result<(), PinError> {
        self.catalog.add_alias(pin.into(), alias.into())
    }

    /// Declares that the value of an output reaches its terminal only while `by` is on: see
    /// [`PinInfo::enabled_by`](super::PinInfo::enabled_by). A pin of another store changes nothing.
    pub fn enabled_by(&mut self, output: impl Into<PinId>, by: impl Into<PinId>) {
        let (output, by) = (output.into(), by.into());
        if self.catalog.set_enabled_by(output, by) {
            self.values.set_enabled_by(output.index(), by.index());
        }
    }

    /// Declares that the values of an output may change their meaning: see
    /// [`restate`](Self::restate).
    pub(crate) fn may_be_restated(&mut self, pin: Output<f64>) {
        if let Some(index) = self.catalog.index(pin.key) {
            self.values.may_be_restated(index);
        }
    }
}

/// The cycle. Constant time for each pin, no allocation, no panic.
impl PinStore {
    /// Begins a new cycle at `now`: ages grow.
    pub fn begin_cycle(&mut self, now: Instant) {
        self.groups.begin_cycle(now);
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
        if let Some(index) = self.resolve(pin.key) {
            self.values.publish(index, value);
        }
    }

    /// Withdraws the value of an input: it is not valid until it is published again, even if its
    /// group is. For values that are not known yet.
    pub fn withhold<T: Value>(&mut self, pin: Input<T>) {
        if let Some(index) = self.resolve(pin.key) {
            self.values.withhold(index);
        }
    }

    /// Records that the transfer of a group succeeded in this cycle: its inputs are valid, with age
    /// 0.
    pub fn group_good(&mut self, group: GroupId) {
        self.group_good_since(group, 0, self.now());
    }

    /// Like [`group_good`](Self::group_good), for a transfer that was started at `started` and
    /// completed `cycles` cycles after it was due: its data has that age.
    pub fn group_good_since(&mut self, group: GroupId, cycles: u64, started: Instant) {
        if let Some(number) = self.resolve_group(group)
            && self.groups.note_good(number, cycles, started)
        {
            self.change_arming(number, ArmingEvent::GoodTransfer);
        }
    }

    /// Changes the arming of a group. Returns true if it is awaited from now on, or not any more; a
    /// group of another store is counted.
    pub(crate) fn change_arming_of(&mut self, group: GroupId, event: ArmingEvent) -> bool {
        let number = self.resolve_group(group);
        number.is_some_and(|number| self.change_arming(number, event))
    }

    /// Changes the arming of all groups; returns the number of those that are awaited from now on,
    /// or not any more.
    pub(crate) fn change_all_arming(&mut self, event: ArmingEvent) -> u32 {
        let groups = 0..self.groups.len();
        let changed = groups.filter(|&number| self.change_arming(number, event));
        changed.count() as u32
    }

    /// Makes the inputs of a group not valid after a failed transfer; outputs are not affected.
    pub fn invalidate(&mut self, group: GroupId) {
        if let Some(number) = self.resolve_group(group) {
            self.groups.invalidate(number);
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
        self.values.version(self.catalog.index(group.0)?)
    }

    /// The value that an output must have now: sanitised, limited, and inverted if configured.
    /// Returns the safe value if its group is not armed, or if it is not enabled while others that
    /// share its enable are: see [`AnalogOut::enable`](super::AnalogOut::enable).
    ///
    /// A value that is not finite is replaced by the safe value, one out of range by the nearest
    /// limit. Both are counted, for the pin and in total, each time the driver fetches such a
    /// value. Nothing ever wraps around.
    pub fn fetch<K: Settable, T: Value>(&mut self, pin: Handle<K, T>) -> T {
        let pins = &mut **self;
        let groups = &pins.groups;
        let index = pins.catalog.index(pin.key);
        let value =
            index.and_then(|index| pins.values.fetch(index, |group| groups.is_armed(group)));
        value.unwrap_or_else(|| {
            pins.count_foreign();
            T::default()
        })
    }

    /// Changes the safe value of an output whose safe state depends on the machine: the command of
    /// a position is safe where the axis stands. It is the value of the output while its group is
    /// not armed, and when the group is armed again. It has to be within the limits of the output;
    /// a value that is not finite changes nothing.
    pub fn set_safe(&mut self, pin: Output<f64>, safe: f64) {
        if let Some(index) = self.catalog.index(pin.key)
            && safe.is_finite()
        {
            self.values.set_safe(index, safe.to_bits());
        }
    }

    /// States the command of an output in new coordinates: the meaning of its values has changed,
    /// and the output is to stay where it was commanded to be. A program that
    /// [repeats](super::Pins::repeat_bits) the value of before in each cycle does not set it again.
    /// A value that is not finite changes nothing.
    pub(crate) fn restate(&mut self, pin: Output<f64>, command: f64) {
        if command.is_finite()
            && let Some(index) = self.resolve(pin.key)
        {
            self.values.restate(index, command.to_bits());
        }
    }

    /// Counts a value of `pin` as out of range that a module has replaced in its register word.
    pub fn count_out_of_range<K: Copy, T: Copy>(&mut self, pin: Handle<K, T>) {
        if let Some(index) = self.resolve(pin.key) {
            self.values.reject(index, Rejection::OutOfRange);
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
