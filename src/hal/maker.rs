//! Construction of pins and parameters.

use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::rule::{is_scale, make_slot};
use super::{
    AnyValue, FullScale, GroupId, HalType, Handle, InOut, Input, Invert, MAX_NAME, MAX_PINS,
    Output, Param, PinError, PinInfo, PinStore, Place, Role, ShortName, Value,
};

/// Number of the newest pins whose places are compared with that of a new one.
const NEIGHBOURS: usize = 32;
/// Smallest number of pins for which room is made.
const LEAST_ROOM: usize = 16;

/// Properties of a new pin or parameter apart from its type. A name alone makes a pin at the
/// maker's terminal, without unit or limits:
///
/// ```
/// use mesa_hal::hal::Spec;
/// let volts = Spec {
///     unit: "V".into(),
///     limits: Some((-10.0, 10.0)),
///     ..Spec::from("volts")
/// };
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spec {
    /// Its name, without the maker's stem.
    pub name: String,
    /// Terminal of a pin; empty for that of the maker. Ignored for a parameter.
    pub place: Place,
    /// Its unit, for example `V`.
    pub unit: String,
    /// The smallest and the largest value. On an output they are enforced: a value outside is
    /// replaced by the nearest limit, as in LinuxCNC, because the command of a saturating servo
    /// loop means "as much as possible", and dropping it to the safe value at that point would let
    /// the axis go. On a setting they are enforced as well; on an input they are informational.
    pub limits: Option<(f64, f64)>,
    /// Usual limits, informational and not enforced: for an output whose scale is adjustable and
    /// whose limits are parameters.
    pub range: Option<(f64, f64)>,
    /// `-invert`: a truth value goes out as its opposite, including its safe value, because the
    /// parameter describes the wiring.
    pub invert: Option<Invert>,
    /// `-maxlim`: no larger value goes out.
    pub max_limit: Option<Param<f64>>,
    /// `-minlim`: no smaller value goes out.
    pub min_limit: Option<Param<f64>>,
    /// `-scalemax`: the real number goes out in other units.
    pub full_scale: Option<FullScale>,
}

impl<S: Into<String>> From<S> for Spec {
    fn from(name: S) -> Self {
        Self {
            name: name.into(),
            ..Self::default()
        }
    }
}

/// Makes pins and parameters of one group, with a common start of their names and a common
/// terminal.
///
/// # Errors
/// All functions return [`PinError::BadName`], [`PinError::NameTaken`], [`PinError::TooMany`],
/// [`PinError::ForeignHandle`] for a group or a parameter of another store, and
/// [`PinError::BadLimits`].
#[derive(Debug)]
pub struct PinMaker<'a> {
    store: &'a mut PinStore,
    group: GroupId,
    stem: String,
    place: Place,
}

impl<'a> PinMaker<'a> {
    /// Makes pins and parameters whose names begin with `stem`, for example
    /// `hm2_7i97.0.encoder.00.`.
    pub fn new(store: &'a mut PinStore, group: GroupId, stem: impl Into<String>) -> Self {
        Self {
            store,
            group,
            stem: stem.into(),
            place: Place::default(),
        }
    }

    /// Sets the terminal of the pins made from now on; parameters have none.
    #[must_use]
    pub fn at(self, place: Place) -> Self {
        Self { place, ..self }
    }

    /// An input.
    pub fn input<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<Input<T>, PinError> {
        self.add(Role::Input, spec, T::default())
    }

    /// The opposite of an input beside it. As long as the input was never valid, which reads as off,
    /// this one is on, as a tripped normally-closed switch shows.
    pub fn opposite(&mut self, spec: impl Into<Spec>) -> Result<Input<bool>, PinError> {
        self.add(Role::Input, spec, true)
    }

    /// An output. It has the value `safe` before the application sets it, while its group is not
    /// armed, and when the application sets it to a value that is not finite.
    pub fn output<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<Output<T>, PinError> {
        self.add(Role::Output, spec, safe)
    }

    /// An output that controls the driver itself: faults do not affect it.
    pub fn switch<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Output<T>, PinError> {
        let pin = self.output(spec, initial)?;
        self.store.exempt(pin)
    }

    /// A pin that both sides set, zero or off at first, which faults do not affect.
    pub fn inout<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<InOut<T>, PinError> {
        let pin = self.bidirectional(spec, T::default())?;
        self.store.exempt(pin)
    }

    /// A pin that both sides set, and that becomes `safe` together with the outputs.
    pub fn bidirectional<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<InOut<T>, PinError> {
        self.add(Role::InOut, spec, safe)
    }

    /// A parameter that the application may set within its limits.
    pub fn setting<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(Role::Setting, spec, initial)
    }

    /// A setting by which others are divided or multiplied. Its magnitude is from 1e-100 to 1e100,
    /// so that it is never 0 and no result overflows; it may be negative.
    ///
    /// # Errors
    /// [`PinError::BadScale`] if `initial` is outside that range.
    pub fn scale(&mut self, spec: impl Into<Spec>, initial: f64) -> Result<Param<f64>, PinError> {
        let spec = spec.into();
        if !is_scale(initial) {
            let name = [&*self.stem, &*spec.name].concat();
            return Err(PinError::BadScale {
                name: ShortName::new(&name),
                value: initial.into(),
            });
        }
        let param = self.setting(spec, initial)?;
        if let Some(info) = self.store.infos.last_mut() {
            info.is_scale = true;
        }
        Ok(param)
    }

    /// A parameter that the application can only read.
    pub fn property<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(Role::Property, spec, initial)
    }

    /// A parameter of a remote, whose type is known at run time only, zero at first. Its limits are
    /// informational, and the application can only read it here. `role` is [`Role::InRemote`], or
    /// [`Role::Property`] if the remote does not allow writing.
    pub(crate) fn of_remote(
        &mut self,
        spec: impl Into<Spec>,
        role: Role,
        hal_type: HalType,
    ) -> Result<Param<AnyValue>, PinError> {
        let mut spec = spec.into();
        spec.range = spec.limits.take();
        // The bits of zero are the same in every type.
        let param: Param<u64> = self.add(role, spec, 0)?;
        if let Some(info) = self.store.infos.last_mut() {
            info.hal_type = hal_type;
        }
        Ok(Handle::new(param.key))
    }

    fn add<K, T: Value>(
        &mut self,
        role: Role,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Handle<K, T>, PinError> {
        let mut spec = spec.into();
        spec.name = [&*self.stem, &*spec.name].concat();
        if role.is_param() {
            spec.place = Place::default();
        } else if spec.place.terminal.is_empty() {
            spec.place = self.place.clone();
        }
        self.store.insert(self.group, role, spec, initial)
    }
}

/// Numbers of pins, rules, groups and parts at some moment.
#[derive(Clone, Copy, Debug)]
struct PinMark {
    pins: usize,
    rules: usize,
    groups: usize,
    parts: usize,
}

impl PinStore {
    fn insert<K, T: Value>(
        &mut self,
        part: GroupId,
        role: Role,
        spec: Spec,
        initial: T,
    ) -> Result<Handle<K, T>, PinError> {
        if !is_name(&spec.name) {
            return Err(PinError::BadName { name: spec.name });
        }
        let rank = match self.rank_of(&spec.name) {
            Err(rank) if self.aliased(&spec.name).is_none() => rank,
            _ => return Err(PinError::NameTaken { name: spec.name }),
        };
        if self.infos.len() >= MAX_PINS {
            return Err(PinError::TooMany);
        }
        let (mut slot, rule) = make_slot(self, part, role, &spec, initial)?;
        let index = self.infos.len() as u32;
        let group = self.group_mut(part).ok_or(PinError::ForeignHandle)?;
        if matches!(role, Role::Output | Role::InOut) {
            group.outputs.push(index);
        }
        // A value of the application is valid when it is shown.
        slot.bad = group.is_of_application && role == Role::Input;
        let group = group.part;
        let group = GroupId(self.key(group));
        let place = self.shared(spec.place);
        let pins = &mut **self;
        for_one_more(&mut pins.by_name).insert(rank, index);
        for_one_more(&mut pins.slots).push(slot);
        if let Some(rule) = rule {
            for_one_more(&mut pins.rules).push(rule);
        }
        for_one_more(&mut pins.infos).push(PinInfo {
            name: spec.name,
            hal_type: T::TYPE,
            role,
            place,
            unit: spec.unit,
            limits: spec.limits.or(spec.range),
            is_scale: false,
            group,
            enabled_by: None,
        });
        Ok(Handle::new(self.key(index)))
    }

    /// The place of a pin: that of one of the newest pins, if it is the same.
    fn shared(&self, place: Place) -> Arc<Place> {
        if place.terminal.is_empty() && place.signal.is_empty() {
            return Arc::clone(&self.nowhere);
        }
        let newest = self.infos.iter().rev().take(NEIGHBOURS);
        let same = newest.map(|info| &info.place).find(|at| ***at == place);
        same.map_or_else(|| Arc::new(place), Arc::clone)
    }

    /// Makes pins, groups and parts as a whole: if `make` fails, the store has none of them.
    pub(crate) fn as_a_whole<T, E>(
        &mut self,
        make: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let mark = PinMark {
            pins: self.infos.len(),
            rules: self.rules.len(),
            groups: self.groups.len(),
            parts: self.parts.len(),
        };
        let made = make(self);
        if made.is_err() {
            self.undo(mark);
        }
        made
    }

    /// Removes all pins, groups and parts that were made since `mark`.
    fn undo(&mut self, mark: PinMark) {
        let pins = &mut **self;
        let first = mark.pins as u32;
        pins.infos.truncate(mark.pins);
        pins.slots.truncate(mark.pins);
        pins.rules.truncate(mark.rules);
        pins.groups.truncate(mark.groups);
        pins.parts.truncate(mark.parts);
        pins.by_name.retain(|&index| index < first);
        pins.aliases.retain(|&(_, index)| index < first);
        for group in &mut pins.groups {
            group.outputs.retain(|&index| index < first);
        }
    }

    /// Releases the memory that was kept for further pins.
    pub(crate) fn shrink_to_fit(&mut self) {
        let pins = &mut **self;
        pins.by_name.shrink_to_fit();
        pins.aliases.shrink_to_fit();
        pins.slots.shrink_to_fit();
        pins.rules.shrink_to_fit();
        pins.infos.shrink_to_fit();
        pins.parts.shrink_to_fit();
        pins.groups.shrink_to_fit();
        for group in &mut pins.groups {
            group.outputs.shrink_to_fit();
        }
    }

    /// Exempts the pin from faults.
    fn exempt<K, T>(&mut self, pin: Handle<K, T>) -> Result<Handle<K, T>, PinError> {
        let slot = self.slot_mut(pin.key);
        slot.ok_or(PinError::ForeignHandle)?.exempt = true;
        Ok(pin)
    }
}

/// Makes room for one more element: an eighth more than there are, where a vector would double. A
/// machine has hundreds of pins, and a controller little memory.
pub(super) fn for_one_more<T>(all: &mut Vec<T>) -> &mut Vec<T> {
    if all.len() == all.capacity() {
        all.reserve_exact((all.len() / 8).max(LEAST_ROOM));
    }
    all
}

/// True if LinuxCNC accepts the name: length within its limit, and no space, quote or other
/// character that ends a word in a HAL file.
pub(super) fn is_name(name: &str) -> bool {
    let fits =
        |c: char| c.is_ascii_graphic() && !matches!(c, '"' | '\'' | '#' | '$' | '[' | ']' | '=');
    (1..=MAX_NAME).contains(&name.len()) && name.chars().all(fits)
}
