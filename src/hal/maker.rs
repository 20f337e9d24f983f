//! Making pins and parameters.

use alloc::string::String;

use super::rule::{is_scale, make_slot};
use super::{
    AnyValue, FullScale, GroupId, HalType, Handle, InOut, Input, Invert, MAX_NAME, MAX_PINS,
    Output, Param, PinError, PinInfo, PinStore, Place, Role, ShortName, Value,
};

/// What a pin or parameter is to be beside its type. A name alone is one at the maker's terminal,
/// without unit or limits:
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
    /// Its name, without what the maker puts before it.
    pub name: String,
    /// Where a pin is; empty for the place of the maker. A parameter is nowhere.
    pub place: Place,
    /// Its unit, for example `V`.
    pub unit: String,
    /// The smallest and the largest value. On an output they are enforced: a value outside becomes
    /// the nearest limit, as in LinuxCNC: the command of a servo loop that saturates means "as much
    /// as there is", and dropping it to the safe value at that moment would let the axis go. On a
    /// setting they are enforced as well, on an input informational.
    pub limits: Option<(f64, f64)>,
    /// Usual limits, informational and not enforced: for an output whose scale can be set, and whose
    /// limits are parameters.
    pub range: Option<(f64, f64)>,
    /// `-invert`: an output that is a truth value goes out as its opposite, also when it is safe:
    /// the parameter says how it is wired.
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

/// Makes pins and parameters of one group whose names begin alike, at the same terminals.
///
/// # Errors
/// All its functions: [`PinError::BadName`], [`PinError::NameTaken`], [`PinError::TooMany`],
/// [`PinError::ForeignHandle`] for a group or a parameter of another store, [`PinError::BadLimits`].
#[derive(Debug)]
pub struct PinMaker<'a> {
    store: &'a mut PinStore,
    group: GroupId,
    stem: String,
    place: Place,
}

impl<'a> PinMaker<'a> {
    /// Names begin with `stem`: `hm2_7i97.0.encoder.00.`.
    pub fn new(store: &'a mut PinStore, group: GroupId, stem: impl Into<String>) -> Self {
        Self {
            store,
            group,
            stem: stem.into(),
            place: Place::default(),
        }
    }

    /// Pins, but no parameters, are at this place from now on.
    #[must_use]
    pub fn at(self, place: Place) -> Self {
        Self { place, ..self }
    }

    /// An input.
    pub fn input<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<Input<T>, PinError> {
        self.add(Role::Input, spec, T::default())
    }

    /// An output, which is `safe` before the application sets it, while its group is not armed, and
    /// when the application sets it to something that is not finite.
    pub fn output<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<Output<T>, PinError> {
        self.add(Role::Output, spec, safe)
    }

    /// An output that decides how the driver works: faults do not touch it.
    pub fn switch<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Output<T>, PinError> {
        let pin = self.output(spec, initial)?;
        self.store.exempt(pin)
    }

    /// A pin that both sides set, zero or off at first, which faults do not touch.
    pub fn inout<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<InOut<T>, PinError> {
        let pin = self.bidirectional(spec, T::default())?;
        self.store.exempt(pin)
    }

    /// A pin that both sides set, and that is `safe` when an output is.
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

    /// A setting that others are divided by or multiplied with. It is never 0, nor so near to 0 or so
    /// large that what it makes of a number is none: 1e-100 to 1e100, or the same below 0.
    ///
    /// # Errors
    /// [`PinError::BadScale`] if it begins with another.
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

    /// A parameter of a remote, whose type is known at run time only, zero at first; limits are
    /// informational. The application can only read it here. `role` is [`Role::InRemote`], or
    /// [`Role::Property`] where the remote does not let it be written.
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
        spec.name.insert_str(0, &self.stem);
        if role.is_param() {
            spec.place = Place::default();
        } else if spec.place.terminal.is_empty() {
            spec.place = self.place.clone();
        }
        self.store.insert(self.group, role, spec, initial)
    }
}

impl PinStore {
    fn insert<K, T: Value>(
        &mut self,
        part: GroupId,
        role: Role,
        spec: Spec,
        initial: T,
    ) -> Result<Handle<K, T>, PinError> {
        let name = spec.name.clone();
        if !is_name(&name) {
            return Err(PinError::BadName { name });
        }
        if self.by_name.contains_key(&name) {
            return Err(PinError::NameTaken { name });
        }
        if self.infos.len() >= MAX_PINS {
            return Err(PinError::TooMany);
        }
        let (slot, rule) = make_slot(self, part, role, &spec, initial)?;
        let index = self.infos.len() as u32;
        let group = self.group_mut(part).ok_or(PinError::ForeignHandle)?;
        if matches!(role, Role::Output | Role::InOut) {
            group.outputs.push(index);
        }
        let group = group.part;
        let group = GroupId(self.key(group));
        self.by_name.insert(name, index);
        self.slots.push(slot);
        self.rules.push(rule);
        self.infos.push(PinInfo {
            name: spec.name,
            hal_type: T::TYPE,
            role,
            place: spec.place,
            unit: spec.unit,
            limits: spec.limits.or(spec.range),
            is_scale: false,
            group,
            enabled_by: None,
        });
        Ok(Handle::new(self.key(index)))
    }

    /// Faults do not touch the pin.
    fn exempt<K, T>(&mut self, pin: Handle<K, T>) -> Result<Handle<K, T>, PinError> {
        let slot = self.slot_mut(pin.key);
        slot.ok_or(PinError::ForeignHandle)?.exempt = true;
        Ok(pin)
    }
}

/// Whether LinuxCNC takes it: by its length, and without a space, quote or other character that ends
/// a word in a HAL file.
fn is_name(name: &str) -> bool {
    let fits =
        |c: char| c.is_ascii_graphic() && !matches!(c, '"' | '\'' | '#' | '$' | '[' | ']' | '=');
    (1..=MAX_NAME).contains(&name.len()) && name.chars().all(fits)
}
