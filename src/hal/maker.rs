//! Making pins and parameters.

use alloc::borrow::Cow;
use alloc::string::String;

use super::rule::make_slot;
use super::{
    FullScale, GroupId, Handle, InOut, Input, Invert, MAX_NAME, MAX_PINS, Output, Param, PinError,
    PinInfo, PinStore, Role, Value,
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
    /// The terminal it is at, for example `TB8 pin 3`; empty for that of the maker.
    pub terminal: Cow<'static, str>,
    /// The terminal's name in the manual, for example `INPUT2`.
    pub signal: Cow<'static, str>,
    /// Its unit, for example `V`.
    pub unit: Cow<'static, str>,
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
    terminal: String,
    signal: String,
}

impl<'a> PinMaker<'a> {
    /// Names begin with `stem`: `hm2_7i97.0.encoder.00.`.
    pub fn new(store: &'a mut PinStore, group: GroupId, stem: impl Into<String>) -> Self {
        Self {
            store,
            group,
            stem: stem.into(),
            terminal: String::new(),
            signal: String::new(),
        }
    }

    /// Pins, but no parameters, are at these terminals from now on, as
    /// [`Place`](super::Place) has them.
    #[must_use]
    pub fn at(mut self, terminal: impl Into<String>, signal: impl Into<String>) -> Self {
        (self.terminal, self.signal) = (terminal.into(), signal.into());
        self
    }

    /// An input.
    pub fn input<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<Input<T>, PinError> {
        self.add(Role::Input, spec.into(), T::default())
    }

    /// An output, which is `safe` before the application sets it, while its group is not armed, and
    /// when the application sets it to something that is not finite.
    pub fn output<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<Output<T>, PinError> {
        self.add(Role::Output, spec.into(), safe)
    }

    /// An output that decides how the driver works: faults do not touch it.
    pub fn switch<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Output<T>, PinError> {
        let output = self.add(Role::Output, spec.into(), initial)?;
        self.exempt(output)
    }

    /// A pin that both sides set, zero or off at first, which faults do not touch.
    pub fn inout<T: Value>(&mut self, spec: impl Into<Spec>) -> Result<InOut<T>, PinError> {
        let pin = self.bidirectional(spec, T::default())?;
        self.exempt(pin)
    }

    /// A pin that both sides set, and that is `safe` when an output is.
    pub fn bidirectional<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        safe: T,
    ) -> Result<InOut<T>, PinError> {
        self.add(Role::InOut, spec.into(), safe)
    }

    /// A parameter that the application may set within its limits.
    pub fn setting<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(Role::Setting, spec.into(), initial)
    }

    /// A parameter that the application can only read.
    pub fn property<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(Role::Property, spec.into(), initial)
    }

    /// A parameter that a remote keeps: the application can only read it here.
    pub fn in_remote<T: Value>(
        &mut self,
        spec: impl Into<Spec>,
        initial: T,
    ) -> Result<Param<T>, PinError> {
        self.add(Role::InRemote, spec.into(), initial)
    }

    fn exempt<K, T>(&mut self, pin: Handle<K, T>) -> Result<Handle<K, T>, PinError> {
        let slot = self.store.slot_mut(pin.key);
        slot.ok_or(PinError::ForeignHandle)?.exempt = true;
        Ok(pin)
    }

    fn add<K, T: Value>(
        &mut self,
        role: Role,
        mut spec: Spec,
        initial: T,
    ) -> Result<Handle<K, T>, PinError> {
        spec.name.insert_str(0, &self.stem);
        if !role.is_param() && spec.terminal.is_empty() {
            spec.terminal = self.terminal.clone().into();
            spec.signal = self.signal.clone().into();
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
            terminal: spec.terminal,
            signal: spec.signal,
            unit: spec.unit,
            limits: spec.limits.or(spec.range),
            group,
        });
        Ok(Handle::new(self.key(index)))
    }
}

/// Whether LinuxCNC takes it: by its length, and without a space, quote or other character that ends
/// a word in a HAL file.
fn is_name(name: &str) -> bool {
    let fits =
        |c: char| c.is_ascii_graphic() && !matches!(c, '"' | '\'' | '#' | '$' | '[' | ']' | '=');
    (1..=MAX_NAME).contains(&name.len()) && name.chars().all(fits)
}
