//! The driver's side: making pins.
//!
//! A driver calls, in this order: [`PinStore::begin_cycle`]; for each group whose transfer
//! succeeded [`PinStore::publish`] for its inputs and [`PinStore::group_good`], or
//! [`PinStore::fault`] for one that failed; then, after the application had its turn,
//! [`PinStore::fetch`] for the outputs.

use alloc::vec::Vec;
use core::ops::{Deref, DerefMut};
use core::sync::atomic::{AtomicU32, Ordering};

use super::handle::Key;
use super::info::{MAX_PINS, check_name};
use super::pins::{Group, Part};
use super::rule::{NONE, Now, Rule, make_slot};
use super::{
    GroupId, HalType, InOut, Input, Invert, Output, OutputModifiers, OutputRule, Param, PinError,
    PinInfo, Pins, Rejections, Role, Settable, Spec, Value,
};
use crate::bus::Instant;

/// Where the number of the next store comes from; 0 belongs to none.
static NEXT_STORE: AtomicU32 = AtomicU32::new(1);

/// The driver's side of all pins and parameters of a machine.
///
/// It makes them, publishes inputs and takes outputs; what an application may do as well is in
/// [`Pins`], to which it derefs. The driver owns it and lends it to its modules; an application
/// gets the [`Pins`] in it. Set-up allocates; everything in the cycle takes constant time for each
/// pin, never allocates and never panics.
#[derive(Debug)]
pub struct PinStore {
    pub(super) pins: Pins<[(); 0]>,
}

impl Default for PinStore {
    fn default() -> Self {
        Self::new()
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
    /// A store without pins.
    pub fn new() -> Self {
        let pins = Pins {
            // Wraps round after four thousand million stores, and never gives 0.
            id: NEXT_STORE.fetch_add(1, Ordering::Relaxed).max(1),
            slots: Vec::new(),
            rules: Vec::new(),
            infos: Vec::new(),
            by_name: Vec::new(),
            groups: Vec::new(),
            parts: Vec::new(),
            settings: 0,
            cycle: 0,
            now: Instant::default(),
            totals: Rejections::default(),
            foreign: AtomicU32::new(0),
            end: [],
        };
        Self { pins }
    }

    /// A new group: not valid before its first good transfer, and armed (its outputs begin with
    /// their safe values).
    pub fn add_group(&mut self) -> GroupId {
        let (group, part) = (self.groups.len() as u32, self.parts.len() as u32);
        self.groups.push(Group {
            valid: false,
            armed: true,
            last_good: None,
            faults: 0,
            outputs: Vec::new(),
            part,
            epoch: 0,
        });
        self.parts.push(Part { group, version: 0 });
        GroupId(self.key(part))
    }

    /// A new part of a group, for pins whose changes are to be noticed apart from those of the rest:
    /// see [`output_version`](Self::output_version). Everything else is the group's: a part is
    /// valid and armed with it, and a pin made in it belongs to the group.
    ///
    /// # Errors
    /// [`PinError::ForeignHandle`] for a group of another store.
    pub fn add_part(&mut self, group: GroupId) -> Result<GroupId, PinError> {
        let Part { group, .. } = *self.part(group).ok_or(PinError::ForeignHandle)?;
        let part = self.parts.len() as u32;
        self.parts.push(Part { group, version: 0 });
        Ok(GroupId(self.key(part)))
    }

    /// A new input.
    pub fn add_input<T: Value>(
        &mut self,
        group: GroupId,
        spec: Spec,
    ) -> Result<Input<T>, PinError> {
        // The limits of an input are informational: its first value may lie outside.
        let spec = Spec {
            enforced: false,
            ..spec
        };
        let key = self.insert(group, Role::Input, spec, T::default())?;
        Ok(Input::new(key))
    }

    /// A new output.
    ///
    /// # Errors
    /// Besides those of the name, [`PinError::BadLimits`].
    pub fn add_output<T: Value>(
        &mut self,
        group: GroupId,
        spec: Spec,
        rule: OutputRule<T>,
    ) -> Result<Output<T>, PinError> {
        let key = self.insert(group, Role::Output, spec, rule.safe)?;
        self.apply_rule(key, rule);
        Ok(Output::new(key))
    }

    /// A new pin that both sides set.
    pub fn add_inout<T: Value>(
        &mut self,
        group: GroupId,
        spec: Spec,
        rule: OutputRule<T>,
    ) -> Result<InOut<T>, PinError> {
        let key = self.insert(group, Role::InOut, spec, rule.safe)?;
        self.apply_rule(key, rule);
        Ok(InOut::new(key))
    }

    /// A new setting, which the application may change within the limits of `spec`.
    pub fn add_setting<T: Value>(
        &mut self,
        group: GroupId,
        spec: Spec,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.insert(group, Role::Setting, spec, initial)
            .map(Param::new)
    }

    /// A new property, which the application can only read.
    pub fn add_property<T: Value>(
        &mut self,
        group: GroupId,
        spec: Spec,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.insert(group, Role::Property, spec, initial)
            .map(Param::new)
    }

    /// A new parameter that a remote keeps: the application can only read it here.
    pub fn add_in_remote<T: Value>(
        &mut self,
        group: GroupId,
        spec: Spec,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.insert(group, Role::InRemote, spec, initial)
            .map(Param::new)
    }

    /// Lets parameters act on an output.
    ///
    /// # Errors
    /// [`PinError::ForeignHandle`] if any of them is of another store; [`PinError::BadLimits`] for
    /// a full scale whose ends are not finite, or of an output that is no real number.
    pub fn modify<P: Settable>(
        &mut self,
        output: P,
        modifiers: OutputModifiers,
    ) -> Result<(), PinError> {
        let key = output.key();
        let invert = self.modifier(modifiers.invert.map(Invert::key))?;
        let max_limit = self.modifier(modifiers.max_limit.map(|p| p.key))?;
        let min_limit = self.modifier(modifiers.min_limit.map(|p| p.key))?;
        let scale = self.modifier(modifiers.full_scale.map(|full| full.scale.key))?;
        let wire = modifiers
            .full_scale
            .map_or((0.0, 0.0), |full| (full.min, full.max));
        let is_real = P::Value::TYPE == HalType::Float && wire.0.is_finite() && wire.1.is_finite();
        if scale != NONE && !is_real {
            return Err(PinError::BadLimits);
        }
        self.changed(key);
        let slot = self.slot_mut(key).ok_or(PinError::ForeignHandle)?;
        slot.invert = invert;
        slot.is_free &= max_limit == NONE && min_limit == NONE;
        if let Some(rule) = self.rule_mut(key) {
            rule.now = Now::UNKNOWN;
            rule.max_limit = max_limit;
            rule.min_limit = min_limit;
            (rule.scale, rule.wire) = (scale, wire);
        }
        Ok(())
    }

    fn modifier(&self, key: Option<Key>) -> Result<u32, PinError> {
        match key {
            None => Ok(NONE),
            Some(key) if self.index(key).is_some() => Ok(key.index),
            Some(_) => Err(PinError::ForeignHandle),
        }
    }

    fn apply_rule<T: Value>(&mut self, key: Key, rule: OutputRule<T>) {
        if let Some(slot) = self.slot_mut(key) {
            slot.exempt = rule.exempt;
        }
        if let Some(kept) = self.rule_mut(key) {
            kept.out_of_range = rule.out_of_range;
        }
    }

    pub(super) fn rule_mut(&mut self, key: Key) -> Option<&mut Rule> {
        let index = self.index(key)?;
        self.rules.get_mut(index)
    }
}

/// Small steps that the functions above share.
impl PinStore {
    fn insert<T: Value>(
        &mut self,
        group: GroupId,
        role: Role,
        spec: Spec,
        initial: T,
    ) -> Result<Key, PinError> {
        check_name(&spec.name)?;
        let in_group = self.part(group).ok_or(PinError::ForeignHandle)?.group;
        let whole = self.group_ref(group).map_or(0, |group| group.part);
        let whole = GroupId(self.key(whole));
        let place = match self.search(&spec.name) {
            Ok(place) => {
                let existing = self.by_name.get(place).map_or(0, |&index| index as usize);
                return Err(PinError::NameTaken { existing });
            }
            Err(place) => place,
        };
        if self.infos.len() >= MAX_PINS {
            return Err(PinError::TooMany);
        }
        let kept = spec.limits.filter(|_| spec.enforced);
        let (slot, rule) = make_slot((in_group, group.0.index), initial, kept)?;
        let index = self.infos.len() as u32;
        self.by_name.insert(place, index);
        self.slots.push(slot);
        self.rules.push(rule);
        self.infos.push(PinInfo {
            name: spec.name,
            hal_type: T::TYPE,
            role,
            terminal: spec.terminal,
            signal: spec.signal,
            unit: spec.unit,
            limits: spec.limits,
            group: whole,
        });
        let silenced = matches!(role, Role::Output | Role::InOut);
        if let Some(group) = self.group_mut(group).filter(|_| silenced) {
            group.outputs.push(index);
        }
        Ok(self.key(index))
    }
}
