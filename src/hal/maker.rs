//! Construction of pins and parameters.

use alloc::string::String;

use super::values::NewPin;
use super::{
    AnyValue, GroupId, HalType, Handle, InOut, Input, Output, Param, PinError, PinInfo, PinStore,
    Place, Role, ShortName, Spec, Value, is_scale,
};

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
        self.add(NewKind::of::<T>(Role::Input), spec, T::default())
    }

    /// The opposite of an input beside it. As long as the input was never valid, which reads as
    /// off, this one is on, as a tripped normally-closed switch shows.
    pub fn opposite(&mut self, spec: impl Into<Spec>) -> Result<Input<bool>, PinError> {
        self.add(NewKind::of::<bool>(Role::Input), spec, true)
    }

    /// An output. It has the value `safe` before the application sets it, while its group is not
    /// armed, and when the application sets it to a value that is not finite.
    pub fn output<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<Output<T>, PinError> {
        self.add(NewKind::of::<T>(Role::Output), spec, safe)
    }

    /// An output that controls the driver itself: faults do not affect it.
    pub fn switch<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Output<T>, PinError> {
        self.add(NewKind::exempt::<T>(Role::Output), spec, initial)
    }

    /// A pin that both sides set, zero or off at first, which faults do not affect.
    pub fn inout<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<InOut<T>, PinError> {
        self.add(NewKind::exempt::<T>(Role::InOut), spec, T::default())
    }

    /// A pin that both sides set, and that becomes `safe` together with the outputs.
    pub fn bidirectional<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<InOut<T>, PinError> {
        self.add(NewKind::of::<T>(Role::InOut), spec, safe)
    }

    /// A parameter that the application may set within its limits.
    pub fn setting<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(NewKind::of::<T>(Role::Setting), spec, initial)
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
        let kind = NewKind {
            is_scale: true,
            ..NewKind::of::<f64>(Role::Setting)
        };
        self.add(kind, spec, initial)
    }

    /// A parameter that the application can only read.
    pub fn property<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(NewKind::of::<T>(Role::Property), spec, initial)
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
        let kind = NewKind {
            hal_type,
            ..NewKind::of::<u64>(role)
        };
        let param: Param<u64> = self.add(kind, spec, 0)?;
        Ok(Handle::new(param.key))
    }

    fn add<K, T: Value>(
        &mut self,
        kind: NewKind,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Handle<K, T>, PinError> {
        let mut spec = spec.into();
        spec.name = [&*self.stem, &*spec.name].concat();
        if kind.role.is_param() {
            spec.place = Place::default();
        } else if spec.place.terminal.is_empty() {
            spec.place = self.place.clone();
        }
        self.store.insert(self.group, kind, spec, initial)
    }
}

/// What a maker knows of a new pin apart from its `Spec`.
#[derive(Clone, Copy, Debug)]
struct NewKind {
    role: Role,
    hal_type: HalType,
    is_scale: bool,
    /// Faults do not affect it.
    is_exempt: bool,
}

impl NewKind {
    const fn of<T: Value>(role: Role) -> Self {
        Self {
            role,
            hal_type: T::TYPE,
            is_scale: false,
            is_exempt: false,
        }
    }

    const fn exempt<T: Value>(role: Role) -> Self {
        Self {
            is_exempt: true,
            ..Self::of::<T>(role)
        }
    }
}

impl PinStore {
    fn insert<K, T: Value>(
        &mut self,
        part: GroupId,
        kind: NewKind,
        spec: Spec,
        initial: T,
    ) -> Result<Handle<K, T>, PinError> {
        let pins = &mut **self;
        let name = pins.catalog.check_new(&spec.name)?;
        let index = pins.catalog.next_index()?;
        let group = pins.group_number(part).ok_or(PinError::ForeignHandle)?;
        let role = kind.role;
        let pin = NewPin {
            spec: &spec,
            role,
            initial,
            group,
            part: part.0.index as usize,
            is_exempt: kind.is_exempt,
            // A value of the application is valid when it is shown.
            is_withheld: role == Role::Input && pins.groups.is_of_application(group),
        };
        let catalog = &pins.catalog;
        pins.values.add(pin, |key| catalog.index(key))?;
        if matches!(role, Role::Output | Role::InOut) {
            pins.groups.add_output(group, index);
        }
        let info = PinInfo {
            place: catalog.shared(spec.place),
            name: spec.name,
            hal_type: kind.hal_type,
            role,
            unit: spec.unit,
            limits: spec.limits.or(spec.range),
            is_scale: kind.is_scale,
            group: pins.group_of(group),
            enabled_by: None,
        };
        pins.catalog.add(name, info);
        Ok(Handle::new(pins.catalog.key(index)))
    }

    /// Makes pins, groups and parts as a whole: if `make` fails, the store has none of them.
    pub(crate) fn as_a_whole<T, E>(
        &mut self,
        make: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let (groups, parts) = (self.groups.len(), self.groups.part_count());
        let pins = self.infos().len();
        let made = make(self);
        if made.is_err() {
            self.catalog.truncate(pins);
            self.values.truncate(pins, parts);
            self.groups.truncate(groups, parts, pins);
        }
        made
    }

    /// Releases the memory that was kept for further pins.
    pub(crate) fn shrink_to_fit(&mut self) {
        self.catalog.shrink_to_fit();
        self.values.shrink_to_fit();
        self.groups.shrink_to_fit();
    }
}
