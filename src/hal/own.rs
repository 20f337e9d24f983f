//! Pins of the application's own: values that it shows, and commands that it takes.

use super::groups::Origin;
use super::handle::kind::InOutKind;
use super::{GroupId, Handle, InOut, Input, PinError, PinMaker, PinStore, Pins, Settable, Value};

impl PinStore {
    /// Adds the group of the application's own pins: always valid and armed, whatever fails.
    pub(crate) fn add_own_group(&mut self) -> GroupId {
        let group = self.add_group();
        self.set_origin(group, Origin::Application);
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
    /// A value that is not finite is counted and not shown: the pin is not valid until the next
    /// one. A pin of the board shows nothing, and counts as [a foreign
    /// handle](Self::foreign_handles).
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn show<T: Value>(&mut self, pin: Input<T>, value: T) {
        let index = self.catalog.index(pin.key);
        let stored = index.and_then(|index| Some((index, self.values.get(index)?)));
        match stored {
            Some((index, stored)) if self.groups.note_shown(stored.group) => {
                self.values.publish(index, value.into());
            }
            _ => self.count_foreign(),
        }
    }

    /// The value that other threads have set an output of the application's own to, within the
    /// limits of the output; its safe value before that, and in place of a value that is not
    /// finite. Replaced values are [counted](Self::rejections) with each call.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn command<K: Settable, T: Value>(&mut self, pin: Handle<K, T>) -> T {
        let index = self.resolve(pin.key);
        index.map_or_else(T::default, |index| self.values.command(index))
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
}
