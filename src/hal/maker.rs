//! Pins that belong together.

use alloc::format;
use alloc::string::String;

use super::{GroupId, InOut, Input, Output, OutputRule, Param, PinError, PinStore, Spec, Value};

/// Makes pins and parameters of one group whose names begin alike, at the same terminals.
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
    pub fn input<T: Value>(&mut self, name: &str) -> Result<Input<T>, PinError> {
        let spec = self.spec(name);
        self.store.add_input(self.group, spec)
    }

    /// An output that is safe at zero or off.
    pub fn output<T: Value>(&mut self, name: &str) -> Result<Output<T>, PinError> {
        let spec = self.spec(name);
        let rule = OutputRule::safe_at(T::default());
        self.store.add_output(self.group, spec, rule)
    }

    /// An output that decides how the driver works: faults do not touch it.
    pub fn switch<T: Value>(&mut self, name: &str, initial: T) -> Result<Output<T>, PinError> {
        let spec = self.spec(name);
        let rule = OutputRule::switch(initial);
        self.store.add_output(self.group, spec, rule)
    }

    /// A pin that both sides set, zero or off at first, which faults do not touch.
    pub fn inout<T: Value>(&mut self, name: &str) -> Result<InOut<T>, PinError> {
        let spec = self.spec(name);
        let rule = OutputRule::switch(T::default());
        self.store.add_inout(self.group, spec, rule)
    }

    /// A parameter that the application may set.
    pub fn setting<T: Value>(&mut self, name: &str, initial: T) -> Result<Param<T>, PinError> {
        let spec = self.parameter(name);
        self.store.add_setting(self.group, spec, initial)
    }

    /// A parameter that the application can only read.
    pub fn property<T: Value>(&mut self, name: &str, initial: T) -> Result<Param<T>, PinError> {
        let spec = self.parameter(name);
        self.store.add_property(self.group, spec, initial)
    }

    /// A pin's name and place, for one that is made otherwise.
    pub fn spec(&self, name: &str) -> Spec {
        let spec = self.parameter(name);
        spec.at(self.terminal.clone(), self.signal.clone())
    }

    fn parameter(&self, name: &str) -> Spec {
        Spec::new(format!("{}{name}", self.stem))
    }
}
