//! The application's side: descriptions and values of the pins.

use core::sync::atomic::{AtomicU32, Ordering};

use super::arming::ArmingEvent;
use super::catalog::Catalog;
use super::groups::Groups;
use super::handle::Key;
use super::values::{StoredValue, Values};
use super::{
    Age, AnyValue, GroupId, GroupState, Handle, InOut, Input, Output, Param, PinError, PinId,
    PinInfo, Readable, Reading, Rejections, Role, Settable, ShortName, Value,
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
    pub(super) catalog: Catalog,
    pub(super) values: Values,
    pub(super) groups: Groups,
    /// Number of uses of a handle of another store.
    foreign: AtomicU32,
    /// Empty. Behind a reference its length is not known, so that a driver's pins cannot be
    /// replaced by others.
    #[expect(dead_code, reason = "only what it is made of counts")]
    end: End,
}

impl Pins {
    /// Descriptions of all pins and parameters in the order in which they were made: those of the
    /// board first, then remote by remote. The order is the same in every run on the same machine.
    pub fn infos(&self) -> &[PinInfo] {
        self.catalog.infos()
    }

    /// Description of a pin; `None` for a handle of another store.
    pub fn info<K: Copy, T: Copy>(&self, pin: Handle<K, T>) -> Option<&PinInfo> {
        self.catalog.info(pin.key)
    }

    /// Values of all pins and parameters, in the order of [`infos`](Self::infos).
    pub fn values(&self) -> impl Iterator<Item = AnyValue> + '_ {
        let infos = self.infos().iter().zip(self.values.all_displayed());
        infos.map(|(info, (bits, _))| AnyValue {
            hal_type: info.hal_type,
            bits,
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
        let Some(stored) = self.stored(pin.key) else {
            return Reading {
                value: T::default(),
                valid: false,
                age: Age::NEVER,
            };
        };
        Reading {
            value: T::from_bits(stored.bits),
            valid: self.groups.is_valid(stored.group) && !stored.is_bad,
            age: if stored.is_bad {
                Age::NEVER
            } else {
                self.groups.age(stored.group)
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
        if let Some(index) = self.resolve(pin.key) {
            self.values.set(index, value.to_bits());
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
        let info = self.info(param).ok_or(PinError::ForeignHandle)?;
        info.check_settable(value.into())?;
        let index = param.key.index as usize;
        self.values.set_parameter(index, value.to_bits());
        Ok(())
    }

    /// The state of a group; `None` for a group of another store.
    pub fn group_state(&self, group: GroupId) -> Option<GroupState> {
        self.groups.state(self.group_number(group)?)
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
        let number = self.group_number(group).ok_or(PinError::ForeignHandle)?;
        if !self.groups.is_valid(number) {
            let first = self.infos().iter().find(|info| info.group == group);
            let pin = ShortName::new(first.map_or("", |info| &info.name));
            return Err(PinError::NotRunning { pin });
        }
        self.change_arming(number, ArmingEvent::Rearm);
        Ok(())
    }

    /// Calls [`rearm`](Self::rearm) for every group that runs; returns the number of groups that
    /// were disarmed and are armed now.
    pub fn rearm_all(&mut self) -> usize {
        let groups = 0..self.groups.len();
        let disarmed = groups.filter(|&number| {
            let is_due = self.groups.is_valid(number) && !self.groups.is_armed(number);
            if is_due {
                self.change_arming(number, ArmingEvent::Rearm);
            }
            is_due
        });
        disarmed.count()
    }

    /// All groups, in the order in which they were made.
    pub fn groups(&self) -> impl Iterator<Item = GroupId> + '_ {
        (0..self.groups.len()).map(|number| self.group_of(number))
    }

    /// Number of groups.
    pub(crate) const fn group_count(&self) -> usize {
        self.groups.len()
    }

    /// The group with this number, in the order of [`groups`](Self::groups).
    pub(crate) fn group_of(&self, number: usize) -> GroupId {
        let part = self.groups.part_of(number);
        GroupId(part.map_or_else(Key::default, |part| self.catalog.key(part)))
    }

    /// Number of faults of groups that were armed, or ran.
    #[cfg(feature = "std")]
    pub(crate) const fn losses(&self) -> u64 {
        self.groups.losses()
    }

    /// Number of the current cycle; 0 before the first.
    pub fn cycle(&self) -> u64 {
        self.groups.cycle()
    }

    /// Start of the current cycle, when its inputs had been read; ages are measured up to it.
    pub fn now(&self) -> Instant {
        self.groups.now()
    }

    /// Values that were replaced instead of used, of all pins together.
    pub fn total_rejections(&self) -> Rejections {
        self.values.total_rejections()
    }

    /// Values of this pin that were replaced instead of used.
    pub fn rejections<K: Copy, T: Copy>(&self, pin: Handle<K, T>) -> Rejections {
        let index = self.catalog.index(pin.key);
        index.map_or_else(Rejections::default, |index| self.values.rejections(index))
    }

    /// Number of uses of a handle of another store. Any value other than 0 is an error in the
    /// program.
    pub fn foreign_handles(&self) -> u32 {
        self.foreign.load(Ordering::Relaxed)
    }

    /// The values as they are stored, in the order of [`infos`](Self::infos), and whether each was
    /// refused or withheld.
    #[cfg(feature = "std")]
    pub(crate) fn raw_values(&self) -> impl Iterator<Item = (u64, bool)> + '_ {
        self.values.all_displayed()
    }

    /// Second names, each with the pin or parameter that it names, in the order of the names. They
    /// are found like the first name, [`PinInfo::name`].
    ///
    /// With [`Defaults::LinuxCnc`](crate::driver::Defaults::LinuxCnc) they are those that LinuxCNC
    /// makes: `hm2_7i97.0.pwmgen.00.out0.invert_output` for `hm2_7i97.0.gpio.000.invert_output`.
    pub fn aliases(&self) -> impl Iterator<Item = (&str, PinId)> {
        self.catalog.aliases()
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
        self.catalog.handle(name, Role::Input)
    }

    /// Finds the output with the given name.
    pub fn output<T: Value>(&self, name: &str) -> Result<Output<T>, PinError> {
        self.catalog.handle(name, Role::Output)
    }

    /// Finds the pin with the given name that both sides set.
    pub fn inout<T: Value>(&self, name: &str) -> Result<InOut<T>, PinError> {
        self.catalog.handle(name, Role::InOut)
    }

    /// Finds the parameter with the given name.
    pub fn parameter<T: Value>(&self, name: &str) -> Result<Param<T>, PinError> {
        self.catalog.handle(name, Role::Setting)
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
}

/// Small steps that the other functions share.
impl Pins {
    /// The index of a pin; a pin of another store is counted.
    #[inline]
    pub(super) fn resolve(&self, key: Key) -> Option<usize> {
        let index = self.catalog.index(key);
        if index.is_none() {
            self.count_foreign();
        }
        index
    }

    /// A pin as it is stored; a pin of another store is counted.
    #[inline]
    pub(super) fn stored(&self, key: Key) -> Option<StoredValue> {
        let index = self.catalog.index(key);
        let stored = index.and_then(|index| self.values.get(index));
        if stored.is_none() {
            self.count_foreign();
        }
        stored
    }

    /// The number of a group; `None` for a group of another store.
    #[inline]
    pub(super) fn group_number(&self, group: GroupId) -> Option<usize> {
        self.groups.of_part(self.catalog.index(group.0)?)
    }

    /// The number of a group; a group of another store is counted.
    #[inline]
    pub(super) fn resolve_group(&self, group: GroupId) -> Option<usize> {
        let number = self.group_number(group);
        if number.is_none() {
            self.count_foreign();
        }
        number
    }

    pub(super) fn count_foreign(&self) {
        self.foreign.fetch_add(1, Ordering::Relaxed);
    }

    fn value<T: Value>(&self, key: Key) -> T {
        let stored = self.stored(key);
        stored.map_or_else(T::default, |stored| T::from_bits(stored.bits))
    }

    /// Changes the arming of a group. Commands are forgotten by each fault, and when the group is
    /// armed. Returns true if the group is awaited from now on, or not any more.
    pub(super) fn change_arming(&mut self, number: usize, event: ArmingEvent) -> bool {
        let Some([before, after]) = self.groups.change_arming(number, event) else {
            return false;
        };
        if event.is_fault() || before.is_armed() != after.is_armed() {
            let outputs = self.groups.outputs(number);
            self.values.forget_commands(outputs, after.is_armed());
        }
        before.is_awaited() != after.is_awaited()
    }
}
