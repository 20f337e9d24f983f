//! The application's side: descriptions and values of the pins.

use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicU32, Ordering};

use super::arming::{Arming, ArmingCondition, ArmingEvent};
use super::handle::Key;
use super::rule::{PinSlot, Rule};
use super::{
    Age, AnyValue, GroupId, GroupState, Handle, InOut, Input, Output, Param, PinError, PinInfo,
    Place, Readable, Reading, Rejections, Role, Settable, ShortName, Value,
};
use crate::bus::Instant;

/// All pins and parameters of a machine, as seen by an application.
///
/// The driver owns them, in a [`PinStore`](super::PinStore); the application keeps handles
/// ([`Input`], [`Output`], [`InOut`], [`Param`]), which are small and `Copy`. [`read`](Self::read),
/// [`set`](Self::set), [`param`](Self::param) and [`set_param`](Self::set_param) take constant
/// time, never allocate and never panic.
///
/// An application cannot publish an input, which only the driver does:
/// ```compile_fail,E0599
/// use mesa_hal::hal::{Input, Pins};
/// fn wrong(pins: &mut Pins, limit_switch: Input<bool>) {
///     pins.publish(limit_switch, false);
/// }
/// ```
/// and no conversion leads from `Pins` to the driver's side:
/// ```compile_fail,E0308
/// use mesa_hal::hal::{PinStore, Pins};
/// fn wrong(pins: &mut Pins) -> &mut PinStore {
///     pins
/// }
/// ```
///
/// The pins of two drivers cannot be exchanged either:
/// ```compile_fail,E0277
/// use mesa_hal::hal::Pins;
/// fn wrong(one: &mut Pins, other: &mut Pins) {
///     core::mem::swap(one, other);
/// }
/// ```
///
/// Pins come in groups that work or fail together: those of a remote, or of the board. A group is
/// *valid* while its transfers succeed, and *armed* unless a fault has disarmed it. The outputs of
/// a group that is not armed have their safe values until the application calls
/// [`rearm`](Self::rearm).
#[derive(Debug, Default)]
pub struct Pins<End: ?Sized = [()]> {
    pub(super) id: u32,
    pub(super) slots: Vec<PinSlot>,
    /// Those of the slots that have one.
    pub(super) rules: Vec<Rule>,
    pub(super) infos: Vec<PinInfo>,
    /// Indices into `infos`, in the order of the names there.
    pub(super) by_name: Vec<u32>,
    /// Second names in their order, with indices into `infos`.
    pub(super) aliases: Vec<(String, u32)>,
    /// The place of a pin without a terminal.
    pub(super) nowhere: Arc<Place>,
    pub(super) groups: Vec<Group>,
    /// Parts of groups; a [`GroupId`] is an index into these.
    pub(super) parts: Vec<GroupPart>,
    /// Incremented when a parameter changes.
    pub(super) settings: u64,
    /// Incremented when an output is newly enabled or held.
    pub(super) switches: u64,
    pub(super) cycle: u64,
    /// Age in cycles from which on inputs are not valid; 0 for never.
    pub(super) stale_after: u32,
    pub(super) now: Instant,
    /// Number of faults of groups that were armed, or ran.
    pub(super) losses: u64,
    pub(super) totals: Rejections,
    /// Outputs whose values may change their meaning, in ascending order of their indices.
    pub(super) restated: Vec<RestatedOutput>,
    /// Number of those of them that have an outdated value.
    pub(super) outdated: u32,
    pub(super) foreign: AtomicU32,
    /// Empty. Behind a reference its length is not known, so that a driver's pins cannot be
    /// replaced by others.
    #[expect(dead_code, reason = "only what it is made of counts")]
    pub(super) end: End,
}

/// An output whose values may change their meaning.
#[derive(Clone, Copy, Debug)]
pub(super) struct RestatedOutput {
    pub index: u32,
    /// The value that was set before the last change: repeated, it is no new command.
    pub outdated: Option<u64>,
}

#[derive(Debug)]
pub(super) struct Group {
    /// The last transfer that counts was good. The inputs are valid until they become stale: see
    /// [`Pins::is_valid`].
    pub is_good: bool,
    /// The group does not become stale: its values come from the driver itself.
    pub is_own: bool,
    /// Its pins are those of the application, which shows their values.
    pub is_of_application: bool,
    /// Changed by [`Pins::change_arming`] alone.
    pub arming: Arming,
    pub last_good: Option<(u64, Instant)>,
    pub faults: u64,
    /// Its outputs, to set them to their safe values.
    pub outputs: Vec<u32>,
    /// Its first part, whose index is the group's public id.
    pub part: u32,
    /// Incremented when the group is disarmed or armed.
    pub epoch: u64,
}

/// A part of a group: pins whose changes are detected together.
#[derive(Clone, Copy, Debug)]
pub(super) struct GroupPart {
    pub group: u32,
    /// Incremented when the required values of its outputs may have changed.
    pub version: u64,
}

impl Group {
    /// True if its outputs follow the application.
    pub fn is_armed(&self) -> bool {
        self.arming == Arming::Armed
    }
}

impl Pins {
    /// Descriptions of all pins and parameters in the order in which they were made: those of the
    /// board first, then remote by remote. The order is the same in every run on the same machine.
    pub fn infos(&self) -> &[PinInfo] {
        &self.infos
    }

    /// Description of a pin; `None` for a handle of another store.
    pub fn info<K: Copy, T: Copy>(&self, pin: Handle<K, T>) -> Option<&PinInfo> {
        self.infos.get(self.index(pin.key)?)
    }

    /// Values of all pins and parameters, in the order of [`infos`](Self::infos).
    pub fn values(&self) -> impl Iterator<Item = AnyValue> + '_ {
        let infos = self.infos.iter().zip(&self.slots);
        infos.zip(0..).map(|((info, slot), index)| AnyValue {
            hal_type: info.hal_type,
            bits: self.shown(index, slot),
        })
    }

    /// Reads a pin.
    ///
    /// A handle of another store reads as zero and not valid, and is counted in
    /// [`foreign_handles`](Self::foreign_handles).
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read<K: Readable, T: Value>(&self, pin: Handle<K, T>) -> Reading<T> {
        let Some((slot, group)) = self.slot(pin.key) else {
            return Reading {
                value: T::default(),
                valid: false,
                age: Age::NEVER,
            };
        };
        Reading {
            value: T::from_bits(slot.bits),
            valid: self.is_valid(group) && !slot.bad,
            age: if slot.bad {
                Age::NEVER
            } else {
                self.age(group)
            },
        }
    }

    /// Sets an output, or a pin that both sides set. It takes effect with the driver's next
    /// `write`, if its group is armed.
    ///
    /// When the driver fetches them, values that are not finite or out of range are replaced and
    /// counted: see [`rejections`](Self::rejections). A handle of another store sets nothing.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set<K: Settable, T: Value>(&mut self, pin: Handle<K, T>, value: T) {
        let bits = value.to_bits();
        if let Some(slot) = self.slot_mut(pin.key)
            && core::mem::replace(&mut slot.bits, bits) != bits
        {
            self.changed(pin.key);
        }
    }

    /// The value to which the application last set an output; a fault and re-arming reset it to the
    /// safe value.
    ///
    /// A value that is set while the group is not armed is returned as well, although the output
    /// stays safe and re-arming forgets the value: [`group_state`](Self::group_state) indicates
    /// this, and the output then [reads](Self::read_any) as not valid.
    pub fn commanded<K: Settable, T: Value>(&self, pin: Handle<K, T>) -> T {
        self.value(pin.key)
    }

    /// The value of a parameter; zero for a handle of another store.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn param<T: Value>(&self, param: Param<T>) -> T {
        self.value(param.key)
    }

    /// Changes a setting.
    ///
    /// # Errors
    /// The errors of [`PinInfo::check_settable`], and [`PinError::ForeignHandle`]. On error, the
    /// setting keeps its value.
    pub fn set_param<T: Value>(&mut self, param: Param<T>, value: T) -> Result<(), PinError> {
        let index = self.index(param.key).ok_or(PinError::ForeignHandle)?;
        let (Some(info), Some(slot)) = (self.infos.get(index), self.slots.get_mut(index)) else {
            return Err(PinError::ForeignHandle);
        };
        info.check_settable(value.into())?;
        slot.bits = value.to_bits();
        self.changed(param.key);
        self.settings = self.settings.wrapping_add(1);
        Ok(())
    }

    /// The state of a group; `None` for a group of another store.
    pub fn group_state(&self, group: GroupId) -> Option<GroupState> {
        let group = self.groups.get(self.group_index(group)?)?;
        Some(GroupState {
            valid: self.is_valid(group),
            armed: group.is_armed(),
            age: self.age(group),
            faults: group.faults,
            coming: group.arming.is_awaited(),
        })
    }

    /// The state of the group of a pin: that of its remote, or of the board. For a remote without
    /// inputs, whose outputs have no validity of their own. `None` for a handle of another store.
    pub fn state_of<K: Copy, T: Copy>(&self, pin: Handle<K, T>) -> Option<GroupState> {
        self.group_state(self.info(pin)?.group)
    }

    /// Lets the outputs of a group follow the application again after a fault.
    ///
    /// Everything set before this call is forgotten, whether before the fault, during it or in the
    /// same cycle: outputs start from their safe values and follow what is set from now on. A group
    /// that is already armed stays unchanged.
    ///
    /// # Errors
    /// [`PinError::NotRunning`] while its transfers fail; [`PinError::ForeignHandle`].
    /// [`Driver::rearm_group_when_running`](crate::Driver::rearm_group_when_running) waits for a
    /// group that does not run.
    pub fn rearm(&mut self, group: GroupId) -> Result<(), PinError> {
        let index = self.group_index(group).ok_or(PinError::ForeignHandle)?;
        if !self
            .groups
            .get(index)
            .is_some_and(|group| self.is_valid(group))
        {
            let first = self.infos.iter().find(|info| info.group == group);
            let pin = ShortName::new(first.map_or("", |info| &info.name));
            return Err(PinError::NotRunning { pin });
        }
        self.arm(index);
        Ok(())
    }

    /// Calls [`rearm`](Self::rearm) for every group that runs; returns the number of groups that
    /// were disarmed and are armed now.
    pub fn rearm_all(&mut self) -> usize {
        let groups = 0..self.groups.len();
        groups.filter(|&index| self.arm(index)).count()
    }

    /// All groups, in the order in which they were made.
    pub fn groups(&self) -> impl Iterator<Item = GroupId> + '_ {
        let groups = self.groups.iter();
        groups.map(|group| GroupId(self.key(group.part)))
    }

    /// Number of the current cycle; 0 before the first.
    pub fn cycle(&self) -> u64 {
        self.cycle
    }

    /// Start of the current cycle, when its inputs had been read; ages are measured up to it.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Values that were replaced instead of used, of all pins together.
    pub fn total_rejections(&self) -> Rejections {
        self.totals
    }

    /// Values of this pin that were replaced instead of used.
    pub fn rejections<K: Copy, T: Copy>(&self, pin: Handle<K, T>) -> Rejections {
        let rule = self.index(pin.key).and_then(|index| self.rule(index));
        rule.map_or_else(Rejections::default, |rule| rule.rejections)
    }

    /// Number of uses of a handle of another store. Any value other than 0 is an error in the
    /// program.
    pub fn foreign_handles(&self) -> u32 {
        self.foreign.load(Ordering::Relaxed)
    }

    /// The values as they are stored, in the order of [`infos`](Self::infos), and whether each was
    /// refused or withheld.
    #[cfg(feature = "std")]
    pub(crate) fn kept(&self) -> impl Iterator<Item = (u64, bool)> + '_ {
        let slots = self.slots.iter().zip(0..);
        slots.map(|(slot, index)| (self.shown(index, slot), slot.bad))
    }

    /// Finds the input with the given name, or second name ([`aliases`](Self::aliases)).
    ///
    /// # Errors
    /// [`PinError::NotFound`] with the nearest name; [`PinError::WrongKind`]. The same applies to
    /// [`output`](Self::output), [`inout`](Self::inout) and [`parameter`](Self::parameter).
    ///
    /// # Real time
    /// Set-up only: an error allocates, and compares names.
    pub fn input<T: Value>(&self, name: &str) -> Result<Input<T>, PinError> {
        self.handle(name, Role::Input)
    }

    /// Finds the output with the given name.
    pub fn output<T: Value>(&self, name: &str) -> Result<Output<T>, PinError> {
        self.handle(name, Role::Output)
    }

    /// Finds the pin with the given name that both sides set.
    pub fn inout<T: Value>(&self, name: &str) -> Result<InOut<T>, PinError> {
        self.handle(name, Role::InOut)
    }

    /// Finds the parameter with the given name.
    pub fn parameter<T: Value>(&self, name: &str) -> Result<Param<T>, PinError> {
        self.handle(name, Role::Setting)
    }

    /// What `find` finds under a name that need not exist. An error about a missing name would be
    /// compared with all names, to name the one that was meant.
    pub(super) fn optional<T>(
        &self,
        name: &str,
        find: impl Fn(&Self, &str) -> Result<T, PinError>,
    ) -> Result<Option<T>, PinError> {
        self.has(name).then(|| find(self, name)).transpose()
    }

    fn handle<K, T: Value>(&self, name: &str, role: Role) -> Result<Handle<K, T>, PinError> {
        let (index, info) = self.named(name).ok_or_else(|| self.not_found(name))?;
        let wrong = |expected, actual| {
            let name = name.into();
            Err(PinError::WrongKind {
                name,
                expected,
                actual,
            })
        };
        if info.role != role && !(role.is_param() && info.role.is_param()) {
            return wrong(role.as_str(), info.role.as_str());
        }
        if info.hal_type != T::TYPE {
            return wrong(T::TYPE.as_str(), info.hal_type.as_str());
        }
        Ok(Handle::new(self.key(index)))
    }

    /// The pin or parameter with the given first or second name, and its index.
    pub(super) fn named(&self, name: &str) -> Option<(u32, &PinInfo)> {
        let index = match self.rank_of(name) {
            Ok(rank) => *self.by_name.get(rank)?,
            Err(_) => self.aliased(name)?,
        };
        Some((index, self.infos.get(index as usize)?))
    }

    /// Rank of a name among all names; as an error the rank that it would have.
    pub(super) fn rank_of(&self, name: &str) -> Result<usize, usize> {
        let at = |index: u32| self.infos.get(index as usize).map(|info| &*info.name);
        self.by_name
            .binary_search_by(|&index| at(index).cmp(&Some(name)))
    }

    /// Error for an unknown name, with the nearest name. Allocates.
    pub(super) fn not_found(&self, name: &str) -> PinError {
        PinError::NotFound {
            name: name.into(),
            nearest: self.nearest(name),
        }
    }
}

/// Small steps that the other functions share.
impl Pins {
    pub(super) fn key(&self, index: u32) -> Key {
        Key {
            store: self.id,
            index,
        }
    }

    pub(super) fn index(&self, key: Key) -> Option<usize> {
        (key.store == self.id).then_some(key.index as usize)
    }

    /// The slot and the group of a pin; a pin of another store is counted.
    pub(super) fn slot(&self, key: Key) -> Option<(&PinSlot, &Group)> {
        let slot = self.index(key).and_then(|index| self.slots.get(index));
        let found = slot.and_then(|slot| Some((slot, self.groups.get(slot.group as usize)?)));
        if found.is_none() {
            self.count_foreign();
        }
        found
    }

    /// The slot of a pin, mutable; a pin of another store is counted.
    pub(super) fn slot_mut(&mut self, key: Key) -> Option<&mut PinSlot> {
        let index = self.index(key);
        if index.is_none() {
            self.count_foreign();
        }
        self.slots.get_mut(index?)
    }

    /// The rule of a pin that has one.
    pub(super) fn rule(&self, index: usize) -> Option<&Rule> {
        self.rules.get(self.slots.get(index)?.rule as usize)
    }

    /// The rule of a pin that has one, mutable.
    pub(super) fn rule_mut(&mut self, index: usize) -> Option<&mut Rule> {
        self.rules.get_mut(self.slots.get(index)?.rule as usize)
    }

    pub(super) fn group_index(&self, group: GroupId) -> Option<usize> {
        Some(self.part(group)?.group as usize)
    }

    pub(super) fn part(&self, group: GroupId) -> Option<&GroupPart> {
        self.parts.get(self.index(group.0)?)
    }

    /// A group, mutable; a group of another store is counted.
    pub(super) fn group_mut(&mut self, group: GroupId) -> Option<&mut Group> {
        let index = self.group_index(group);
        if index.is_none() {
            self.count_foreign();
        }
        self.groups.get_mut(index?)
    }

    pub(super) fn count_foreign(&self) {
        self.foreign.fetch_add(1, Ordering::Relaxed);
    }

    /// The value of a pin as the application sees it: for a held output its safe value.
    #[inline]
    pub(super) fn shown(&self, index: usize, slot: &PinSlot) -> u64 {
        if !slot.is_free
            && slot.role == Role::Output
            && self.is_held(index)
            && let Some(rule) = self.rules.get(slot.rule as usize)
        {
            return rule.safe;
        }
        slot.bits
    }

    fn value<T: Value>(&self, key: Key) -> T {
        let slot = self.slot(key);
        slot.map_or_else(T::default, |(slot, _)| T::from_bits(slot.bits))
    }

    /// Arms a group that runs and is disarmed: its outputs follow what is set from now on. Returns
    /// true if the group was in that state.
    fn arm(&mut self, index: usize) -> bool {
        let waits = |group: &Group| self.is_valid(group) && !group.is_armed();
        let is_due = self.groups.get(index).is_some_and(waits);
        if is_due {
            self.change_arming(index, ArmingEvent::Request(ArmingCondition::Running));
            self.change_arming(index, ArmingEvent::GoodTransfer);
        }
        is_due
    }

    /// Changes the arming of a group, and returns the one before. Commands are forgotten by each
    /// fault, and when the group is armed.
    pub(super) fn change_arming(&mut self, index: usize, event: ArmingEvent) -> Arming {
        let Some(before) = self.groups.get(index).map(|group| group.arming) else {
            return Arming::Safe;
        };
        let after = before.after(event);
        let [was_armed, is_armed] = [before, after].map(|arming| arming == Arming::Armed);
        if is_armed != was_armed || event == ArmingEvent::Fault {
            self.forget_commands(index, is_armed);
        }
        if let Some(group) = self.groups.get_mut(index) {
            group.arming = after;
            group.faults = group.faults.saturating_add((was_armed && !is_armed).into());
        }
        self.losses = self.losses.saturating_add((was_armed && !is_armed).into());
        before
    }

    /// Sets the outputs of a group to their safe values, except those that faults do not affect.
    /// Unless they follow the application again, they read as not valid.
    fn forget_commands(&mut self, index: usize, follow: bool) {
        let Some(group) = self.groups.get_mut(index) else {
            return;
        };
        group.epoch = group.epoch.wrapping_add(1);
        self.switches = self.switches.wrapping_add(1);
        for &output in &group.outputs {
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

    /// Records that the required values of outputs in the pin's part may have changed.
    pub(super) fn changed(&mut self, key: Key) {
        let part = self.slot(key).map(|(slot, _)| slot.part as usize);
        if let Some(part) = part.and_then(|index| self.parts.get_mut(index)) {
            part.version = part.version.wrapping_add(1);
        }
    }

    /// True if the inputs of a group are valid. Staleness is decided here and nowhere else.
    pub(super) fn is_valid(&self, group: &Group) -> bool {
        let is_stale = self.stale_after > 0
            && !group.is_own
            && self.age(group).cycles >= u64::from(self.stale_after);
        group.is_good && !is_stale
    }

    fn age(&self, group: &Group) -> Age {
        group.last_good.map_or(Age::NEVER, |(cycle, time)| Age {
            cycles: self.cycle.saturating_sub(cycle),
            time: self.now.since(time),
        })
    }
}
