//! Pins whose type is known at run time only: for tools, recorders and remote control.

#[cfg(any(test, feature = "std"))]
use super::Role;
use super::values::MAX_ENABLES;
use super::{AnyValue, HalType, PinError, PinId, PinInfo, Pins, Reading};

/// Pins whose type is known at run time only.
impl Pins {
    /// Finds the pin or parameter with the given name.
    ///
    /// # Errors
    /// [`PinError::NotFound`], with the nearest name.
    ///
    /// # Real time
    /// Set-up only: an error allocates.
    pub fn id(&self, name: &str) -> Result<PinId, PinError> {
        self.find(name).ok_or_else(|| self.catalog.not_found(name))
    }

    /// The pin or parameter with the given name, for names that need not exist: no similar one is
    /// searched for.
    ///
    /// # Real time
    /// Searches in the sorted names; no allocation.
    pub fn find(&self, name: &str) -> Option<PinId> {
        let (index, _) = self.catalog.named(name)?;
        Some(PinId::new(self.catalog.key(index)))
    }

    /// True if a pin or parameter has the given name, as [`find`](Self::find).
    pub fn has(&self, name: &str) -> bool {
        self.find(name).is_some()
    }

    /// True if a pin with the given first or second name exists; a parameter does not count.
    pub fn has_pin(&self, name: &str) -> bool {
        let named = self.catalog.named(name);
        named.is_some_and(|(_, info)| !info.role.is_param())
    }

    /// All pins and parameters, in the order of [`infos`](Self::infos).
    pub fn ids(&self) -> impl Iterator<Item = PinId> + '_ {
        let indices = 0..self.infos().len() as u32;
        indices.map(|index| PinId::new(self.catalog.key(index)))
    }

    /// Description of a pin or parameter; `None` if it belongs to another store.
    pub fn info_of(&self, pin: PinId) -> Option<&PinInfo> {
        self.catalog.info(pin.key())
    }

    /// The chain of enables that must be on for the value of an output to reach its terminal, step
    /// by step. On a 7I97, AOUT1 needs the enable of generator 1 and then that of generator 0,
    /// which the switch of its drive follows. Empty for a pin of another store.
    ///
    /// ```
    /// # use mesa_hal::{Driver, Settings};
    /// # use mesa_hal_sim::machines;
    /// # let board = machines::six_axes_7i97(Default::default());
    /// let driver = Driver::start(board, Settings::default())?;
    /// let pins = driver.pins();
    /// let enables = pins.enables(pins.id("hm2_7i97.0.pwmgen.01.value")?);
    /// let names: Vec<_> = enables.map(|pin| &*pins.info_of(pin).unwrap().name).collect();
    /// assert_eq!(names, ["hm2_7i97.0.pwmgen.01.enable", "hm2_7i97.0.pwmgen.00.enable"]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn enables(&self, pin: PinId) -> impl Iterator<Item = PinId> + '_ {
        let next = |pin: &PinId| self.info_of(*pin)?.enabled_by;
        // Bounds a circular chain, which the maker of the pins may have built by mistake.
        core::iter::successors(next(&pin), next).take(MAX_ENABLES)
    }

    /// Reads a pin, a parameter, or the value to which the application has set an output.
    ///
    /// An output that is [not enabled](super::AnalogOut::enable) while others that share its enable
    /// are reads as its safe value. An output reads as not valid, whatever it was set to, if its
    /// group is not armed or if it was set to NaN or infinity: its safe value goes out then. A
    /// parameter does not depend on transfers and is always valid.
    ///
    /// A pin of another store reads as a bit that is off and not valid, and is counted in
    /// [`foreign_handles`](Self::foreign_handles).
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn read_any(&self, pin: PinId) -> Reading<AnyValue> {
        // The handle type serves only for the check: all values are kept as the same 64 bits.
        let reading: Reading<u64> = self.read(super::Input::new(pin.key()));
        let info = self.info_of(pin);
        let is_param = info.is_some_and(|info| info.role.is_param());
        let index = self.catalog.index(pin.key());
        let displayed = index.and_then(|index| self.values.displayed(index));
        let value = AnyValue {
            hal_type: info.map_or(HalType::Bit, |info| info.hal_type),
            bits: displayed.unwrap_or(reading.value),
        };
        Reading {
            value,
            // An output that was set to NaN or infinity goes out as its safe value, not as what was
            // set.
            valid: (reading.valid || is_param) && value.is_finite(),
            age: reading.age,
        }
    }

    /// Sets an output, a pin that both sides set, or a parameter, as [`set`](Self::set) and
    /// [`set_param`](Self::set_param) do.
    ///
    /// # Errors
    /// [`PinError::NotSettable`] for an input, [`PinError::WrongType`],
    /// [`PinError::ForeignHandle`], and those of [`set_param`](Self::set_param). On error, nothing
    /// is set.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set_any(&mut self, pin: PinId, value: AnyValue) -> Result<(), PinError> {
        let Some(info) = self.info_of(pin) else {
            self.count_foreign();
            return Err(PinError::ForeignHandle);
        };
        info.check_settable(value)?;
        let (is_param, index) = (info.role.is_param(), pin.index());
        if is_param {
            self.values.set_parameter(index, value.bits);
        } else {
            self.values.set(index, value.bits);
        }
        Ok(())
    }

    /// The bits of the last value of a pin or parameter, as [`AnyValue`] keeps them, whether it is
    /// valid or not; for programs that copy all values in every cycle and know their types. 0 for a
    /// pin of another store, which is counted in [`foreign_handles`](Self::foreign_handles).
    ///
    /// ```
    /// use mesa_hal::hal::{PinMaker, PinStore};
    /// # fn main() -> Result<(), mesa_hal::hal::PinError> {
    /// let mut store = PinStore::default();
    /// let group = store.add_group();
    /// let speed = PinMaker::new(&mut store, group, "card.").output::<f64>("speed", 0.0)?;
    /// store.set_bits(speed.into(), 1.5_f64.to_bits())?;
    /// assert_eq!(f64::from_bits(store.bits_of(speed.into())), 1.5);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Real time
    /// Constant time, no allocation; without the description of the pin, which
    /// [`read_any`](Self::read_any) needs.
    #[inline]
    pub fn bits_of(&self, pin: PinId) -> u64 {
        let index = self.catalog.index(pin.key());
        let displayed = index.and_then(|index| self.values.displayed(index));
        displayed.unwrap_or_else(|| {
            self.count_foreign();
            0
        })
    }

    /// As [`bits_of`](Self::bits_of) for an input; `None` while it is not valid.
    ///
    /// # Real time
    /// As [`bits_of`](Self::bits_of).
    #[inline]
    pub fn valid_bits_of(&self, input: PinId) -> Option<u64> {
        let stored = self.stored(input.key())?;
        (!stored.is_bad && self.groups.is_valid(stored.group)).then_some(stored.bits)
    }

    /// [`valid_bits_of`](Self::valid_bits_of) of many inputs, in less time where those of a group
    /// follow each other. Each input has a value of any type beside it, such as the place to copy
    /// to; for each that is valid, `each` is called with that value and the bits of the input.
    ///
    /// # Real time
    /// As [`valid_bits_of`](Self::valid_bits_of) for each; no allocation.
    #[inline]
    pub fn each_valid<T>(
        &self,
        inputs: impl IntoIterator<Item = (PinId, T)>,
        mut each: impl FnMut(T, u64),
    ) {
        // No group yet: their numbers have 16 bits.
        let mut group = usize::MAX;
        let mut is_valid = false;
        for (input, target) in inputs {
            let Some(stored) = self.stored(input.key()) else {
                continue;
            };
            if group != stored.group {
                group = stored.group;
                is_valid = self.groups.is_valid(group);
            }
            if is_valid && !stored.is_bad {
                each(target, stored.bits);
            }
        }
    }

    /// A number that is another one when a parameter may have changed, or the driver may have
    /// changed a pin that both sides set; for programs that copy all values in every cycle.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub const fn parameters_version(&self) -> u64 {
        self.values.settings()
    }

    /// Sets a pin or parameter as [`set_any`](Self::set_any) does, to the bits of a value of its
    /// type.
    ///
    /// # Errors
    /// As of [`set_any`](Self::set_any), except [`PinError::WrongType`].
    ///
    /// # Real time
    /// Constant time, no allocation; the description of an output is not needed.
    #[inline]
    pub fn set_bits(&mut self, pin: PinId, bits: u64) -> Result<(), PinError> {
        if let Some(index) = self.catalog.index(pin.key())
            && self.values.set_pin(index, bits)
        {
            return Ok(());
        }
        let hal_type = self.info_of(pin).map_or(HalType::Bit, |info| info.hal_type);
        self.set_any(pin, AnyValue { hal_type, bits })
    }

    /// Repeats the value of an output, for a program that gives all values in every cycle without
    /// knowing which of them are new, as a copy of LinuxCNC's HAL does. As
    /// [`set_bits`](Self::set_bits), except for a value that was set before the meaning of the
    /// output's values changed (the position that a step generator follows, after `position-reset`,
    /// an index or another `position-scale`): it is no new command as long as it stays the same.
    ///
    /// # Errors
    /// As of [`set_bits`](Self::set_bits).
    ///
    /// # Real time
    /// Constant time, no allocation.
    #[inline]
    pub fn repeat_bits(&mut self, pin: PinId, bits: u64) -> Result<(), PinError> {
        if let Some(index) = self.catalog.index(pin.key())
            && self.values.check_outdated(index, bits)
        {
            return Ok(());
        }
        self.set_bits(pin, bits)
    }

    /// True if the value to which an output is set goes out: its group is armed, or faults do not
    /// affect it.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn follows(&self, output: PinId) -> bool {
        let stored = self.stored(output.key());
        stored.is_some_and(|stored| self.groups.is_armed(stored.group) || stored.is_exempt)
    }

    /// Number of faults that have made an output safe; `None` for an output that faults do not
    /// affect, for a parameter, and for a value that equals the safe value.
    #[cfg(feature = "std")]
    pub(crate) fn faults_against(&self, pin: PinId, value: AnyValue) -> Option<u64> {
        let info = self.info_of(pin)?;
        let stored = self.stored(pin.key())?;
        let is_output = matches!(info.role, Role::Output | Role::InOut);
        let bits = self.values.safe(pin.index())?;
        // Compared as numbers: 0.0 and -0.0 are the same output.
        let safe = AnyValue { bits, ..value };
        let is_safe = value.bits == bits || value.as_f64() == safe.as_f64();
        let faults = self.groups.faults(stored.group);
        (is_output && !stored.is_exempt && !is_safe).then_some(faults)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PinMaker, PinStore, ShortName, Spec};
    use super::*;

    /// An input, an output, a setting from 0 to 10, a scale, and a property.
    fn store() -> PinStore {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "card.");
        make.input::<i32>("in").expect("made");
        make.output::<f64>("out", 0.0).expect("made");
        let setting = Spec {
            limits: Some((0.0, 10.0)),
            ..Spec::from("setting")
        };
        make.setting(setting, 5.0).expect("made");
        make.scale("scale", 1.0).expect("made");
        make.property("property", true).expect("made");
        store.group_good(group);
        store
    }

    #[test]
    fn value_set_by_number_is_read_by_handle_and_vice_versa() {
        let mut pins = store();
        let out = pins.output::<f64>("card.out").expect("there");
        assert_eq!(PinId::from(out), pins.id("card.out").expect("there"));
        pins.set_any(out.into(), AnyValue::from(1.5))
            .expect("an output");
        assert_eq!(pins.commanded(out), 1.5);
        let setting = pins.id("card.setting").expect("there");
        pins.set_any(setting, AnyValue::from(7.0))
            .expect("a setting");
        let handle = pins.parameter::<f64>("card.setting").expect("there");
        assert_eq!(pins.param(handle), 7.0);
        let reading = pins.read_any(setting);
        assert_eq!((reading.value, reading.valid), (AnyValue::from(7.0), true));
        let input = pins.input::<i32>("card.in").expect("there");
        pins.publish(input, -3);
        assert_eq!(pins.read_any(input.into()).value, AnyValue::from(-3));
    }

    /// The bits are those of the value, for every role, and each error is that of `set_any`.
    #[test]
    fn bits_are_those_of_the_value() {
        let mut pins = store();
        let all: Vec<_> = pins.ids().collect();
        for (pin, value) in all.iter().zip(pins.values().collect::<Vec<_>>()) {
            assert_eq!(pins.bits_of(*pin), value.bits);
            let reading = pins.read_any(*pin);
            let valid = reading.valid.then_some(reading.value.bits);
            if pins
                .info_of(*pin)
                .is_some_and(|info| info.role == Role::Input)
            {
                assert_eq!(pins.valid_bits_of(*pin), valid);
            }
            for bits in [1.5_f64, f64::NAN, 12.0].map(f64::to_bits) {
                let (mut one, mut other) = (store(), store());
                let pins = [&mut one, &mut other].map(|store| {
                    let id = store.ids().nth(pin.index()).expect("as many");
                    (store, id)
                });
                let [(one, first), (other, second)] = pins;
                let value = AnyValue { bits, ..value };
                assert_eq!(one.set_bits(first, bits), other.set_any(second, value));
                assert_eq!(one.bits_of(first), other.bits_of(second));
            }
        }
        let foreign = store().ids().next().expect("a pin");
        assert_eq!((pins.bits_of(foreign), pins.foreign_handles()), (0, 1));
        let refused = pins.set_bits(foreign, 0);
        assert_eq!(refused, Err(PinError::ForeignHandle));
    }

    #[test]
    fn valid_inputs_of_a_list_are_given_with_their_associated_data() {
        let mut pins = PinStore::default();
        let groups = [(); 3].map(|()| pins.add_group());
        let mut inputs = Vec::new();
        // Those of a group do not follow each other.
        for number in 0..9_u32 {
            let group = groups[number as usize % 3];
            let mut make = PinMaker::new(&mut pins, group, "card.");
            inputs.push(make.input::<u32>(format!("input-{number}")).expect("made"));
        }
        for (number, input) in inputs.iter().enumerate() {
            pins.publish(*input, number as u32 + 100);
        }
        pins.withhold(inputs[4]);
        pins.group_good(groups[0]);
        pins.group_good(groups[1]);
        let foreign = store().ids().next().expect("a pin");
        let mut ids: Vec<PinId> = inputs.iter().map(|input| (*input).into()).collect();
        ids.insert(2, foreign);
        let mut given = Vec::new();
        pins.each_valid(ids.iter().map(|id| (*id, id)), |id, bits| {
            given.push((*id, bits));
        });
        assert_eq!(pins.foreign_handles(), 1);
        let bits: Vec<_> = given.iter().map(|(_, bits)| *bits).collect();
        assert_eq!(bits, [100, 101, 103, 106, 107]);
        for id in ids {
            let found = given.iter().find(|(given, _)| *given == id);
            assert_eq!(found.map(|(_, bits)| *bits), pins.valid_bits_of(id));
        }
    }

    fn bad_value(value: f64) -> PinError {
        PinError::BadValue {
            name: ShortName::new("card.setting"),
            value: value.into(),
            limits: Some((0.0, 10.0)),
        }
    }

    fn bad_scale(value: f64) -> PinError {
        PinError::BadScale {
            name: ShortName::new("card.scale"),
            value: value.into(),
        }
    }

    #[test]
    fn unsettable_pin_keeps_its_value_and_is_refused_with_a_reason() {
        let mut pins = store();
        let before: Vec<_> = pins.values().collect();
        let id = |pins: &PinStore, name| pins.id(name).expect("there");
        for (name, value, why) in [
            (
                "card.in",
                AnyValue::from(1),
                PinError::NotSettable {
                    name: ShortName::new("card.in"),
                },
            ),
            (
                "card.property",
                AnyValue::from(true),
                PinError::ReadOnly {
                    name: ShortName::new("card.property"),
                },
            ),
            ("card.setting", AnyValue::from(11.0), bad_value(11.0)),
            (
                "card.setting",
                AnyValue::from(f64::NAN),
                bad_value(f64::NAN),
            ),
            ("card.scale", AnyValue::from(0.0), bad_scale(0.0)),
            ("card.scale", AnyValue::from(-0.0), bad_scale(-0.0)),
            ("card.scale", AnyValue::from(5e-324), bad_scale(5e-324)),
            ("card.scale", AnyValue::from(f64::NAN), bad_scale(f64::NAN)),
            (
                "card.scale",
                AnyValue::from(f64::NEG_INFINITY),
                bad_scale(f64::NEG_INFINITY),
            ),
        ] {
            let pin = id(&pins, name);
            assert_eq!(pins.set_any(pin, value), Err(why), "{name}");
        }
        let scale = id(&pins, "card.scale");
        for number in [-1e100, -1e-100, 1e-100, 1e100] {
            assert_eq!(pins.set_any(scale, number.into()), Ok(()), "{number}");
        }
        pins.set_any(scale, 1.0.into()).expect("a scale");
        let out = id(&pins, "card.out");
        let wrong = pins
            .set_any(out, AnyValue::from(1))
            .expect_err("an integer");
        let text = "`card.out` takes a value of type float, and 1 is of type s32";
        assert_eq!(wrong.to_string(), text);
        let foreign = id(&store(), "card.out");
        let refused = pins.set_any(foreign, AnyValue::from(1.0));
        assert_eq!(refused, Err(PinError::ForeignHandle));
        assert!(!pins.read_any(foreign).valid);
        assert_eq!(pins.foreign_handles(), 2);
        assert_eq!(pins.values().collect::<Vec<_>>(), before);
    }
}
