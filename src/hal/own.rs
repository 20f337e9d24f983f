//! Pins of the application's own: values that it shows, and commands that it takes.

use super::handle::kind::InOutKind;
use super::{
    GroupId, Handle, InOut, Input, PinError, PinMaker, PinStore, Pins, Rejection, Settable, Value,
};

impl PinStore {
    /// Adds the group of the application's own pins: always valid and armed, whatever fails.
    pub(crate) fn add_own_group(&mut self) -> GroupId {
        let group = self.add_group();
        self.keep_valid(group);
        let now = (self.cycle, self.now);
        if let Some(group) = self.group_mut(group) {
            group.is_of_application = true;
            (group.is_good, group.last_good) = (true, Some(now));
        }
        group
    }

    /// Makes pins of the application's own, whose names begin with `prefix` and a dot.
    ///
    /// # Errors
    /// [`PinError::BadName`] without a prefix; [`PinError::NameTaken`] for one that begins with the
    /// name of the `board`.
    pub(crate) fn own_maker(
        &mut self,
        group: GroupId,
        prefix: &str,
        board: &str,
    ) -> Result<PinMaker<'_>, PinError> {
        if prefix.is_empty() {
            return Err(PinError::BadName {
                name: prefix.into(),
            });
        }
        if prefix.starts_with(board) {
            return Err(PinError::NameTaken {
                name: prefix.into(),
            });
        }
        let stem = [prefix, "."].concat();
        Ok(PinMaker::new(self, group, stem))
    }
}

/// Pins of the application's own: see [`Board::own_pins`](crate::Board::own_pins).
impl Pins {
    /// Shows a value on an input of the application's own, which is valid from then on: snapshots,
    /// scopes and other readers see it together with the values of the board in the same cycle. Its
    /// age is that of the last call for any pin of the application.
    ///
    /// A value that is not finite is counted and not shown: the pin is not valid until the next one.
    /// A pin of the board shows nothing, and counts as [a foreign
    /// handle](Self::foreign_handles).
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn show<T: Value>(&mut self, pin: Input<T>, value: T) {
        let now = (self.cycle, self.now);
        let found = self.index(pin.key).and_then(|index| {
            let slot = self.slots.get_mut(index)?;
            let group = self.groups.get_mut(slot.group as usize)?;
            group.is_of_application.then_some((index, slot, group))
        });
        let Some((index, slot, group)) = found else {
            return self.count_foreign();
        };
        group.last_good = Some(now);
        if !slot.accept(value.into()) {
            self.count_rejection(index, Rejection::NotFinite);
        }
    }

    /// The value that other threads have set an output of the application's own to, within the
    /// limits of the output; its safe value before that, and in place of a value that is not finite.
    /// Replaced values are [counted](Self::rejections) with each call.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn command<K: Settable, T: Value>(&mut self, pin: Handle<K, T>) -> T {
        let Some(index) = self.index(pin.key) else {
            self.count_foreign();
            return T::default();
        };
        let set = self.commanded(pin);
        let rule = self.slots.get(index).map(|slot| slot.rule as usize);
        let Some(rule) = rule.and_then(|rule| self.rules.get_mut(rule)) else {
            return T::default();
        };
        if rule.settings != self.settings {
            rule.apply::<T>(&self.slots, self.settings);
        }
        let (value, rejection) = rule.sanitise(set);
        if let Some(rejection) = rejection {
            self.count_rejection(index, rejection);
        }
        value
    }

    /// Takes a command that another thread has given by a pin of the application's own that both
    /// sides set: returns its value as [`command`](Self::command), and sets the pin back to zero or
    /// off, so that each command is taken once.
    ///
    /// ```
    /// # use mesa_hal::hal::{PinError, Pins};
    /// # use mesa_hal::InOut;
    /// # fn take(pins: &mut Pins, home: InOut<bool>) {
    /// if pins.take(home) {
    ///     // begin to home the axis
    /// }
    /// # }
    /// ```
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn take<T: Value>(&mut self, pin: InOut<T>) -> T {
        let value = self.command::<InOutKind, T>(pin);
        self.set(pin, T::default());
        value
    }

    fn count_rejection(&mut self, index: usize, rejection: Rejection) {
        self.totals.count(rejection);
        if let Some(rule) = self.rule_mut(index) {
            rule.rejections.count(rejection);
        }
    }
}
