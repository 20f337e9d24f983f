//! The copy between HAL's values and the driver's pins.
//!
//! | role | HAL | before `read` | after `read` | before `write` | after `write` |
//! |---|---|---|---|---|---|
//! | input | OUT | | valid values to HAL | | |
//! | output | IN | | | to the driver | |
//! | set by both | I/O | to the driver | to HAL | to the driver | to HAL |
//! | parameter | RW | | | to the driver, or back | |
//! | parameter by which the user acknowledges | RW | to the driver | | to the driver, or back | |
//! | property | RO | | to HAL | | to HAL |
//! | kept in a remote | RW | | | requested, or back to HAL | |
//!
//! An input that is not valid keeps its last value. Where both sides have changed a value, the
//! driver wins. Outputs are set anew in every cycle, because arming makes the driver forget what
//! was set before.

use mesa_hal::hal::{AnyValue, HalType, PinError, PinId, Pins, Role};

/// Values of HAL, by the numbers in which they were made: as the bits of [`mesa_hal::hal::Value`].
pub(crate) trait Memory {
    fn load(&self, index: usize) -> u64;
    fn store(&mut self, index: usize, bits: u64);
}

/// A pin or parameter of the driver, and its number in HAL.
#[derive(Clone, Copy, Debug)]
struct Entry {
    id: PinId,
    index: u32,
    hal_type: HalType,
}

/// A value that both sides change, or that seldom changes.
#[derive(Clone, Copy, Debug)]
struct Shared {
    entry: Entry,
    /// The value on which both sides agreed, as the driver's bits.
    agreed: u64,
    /// HAL's bits: those of `agreed`, or of a value that a remote was asked for.
    seen: u64,
}

/// What HAL has changed, or wanted to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Change {
    /// A value that both sides change has these bits now.
    Set(PinId, u64),
    /// A parameter that a remote keeps is to have this value.
    Request(PinId, AnyValue),
    /// The driver does not take the value, and HAL has the old one again.
    Refused(PinError),
}

/// All pins and parameters of a driver.
#[derive(Debug, Default)]
pub(crate) struct Table {
    inputs: Vec<Entry>,
    outputs: Vec<Entry>,
    inouts: Vec<Shared>,
    settings: Vec<Shared>,
    /// Those of the settings by which the user acknowledges a fault.
    acknowledging: Vec<Shared>,
    properties: Vec<Shared>,
    in_remotes: Vec<Shared>,
    /// The driver's version of its parameters in which `settings` and `in_remotes` are.
    taken: Option<u64>,
    /// The version in which HAL has `inouts` and `properties`.
    shown: Option<u64>,
}

impl Table {
    /// The table of all pins of a driver, in the order of [`Pins::ids`], which is also that of
    /// HAL's values. HAL gets the values that the driver has now.
    pub fn new(pins: &Pins, memory: &mut impl Memory) -> Self {
        let mut table = Self::default();
        for (index, (id, info)) in pins.ids().zip(pins.infos()).enumerate() {
            let entry = Entry {
                id,
                index: index as u32,
                hal_type: info.hal_type,
            };
            let agreed = pins.bits_of(id);
            let shared = Shared {
                entry,
                agreed,
                seen: entry.of_hal(agreed),
            };
            match info.role {
                Role::Input => table.inputs.push(entry),
                Role::Output => table.outputs.push(entry),
                Role::InOut => table.inouts.push(shared),
                Role::Setting => table.settings.push(shared),
                Role::Property => table.properties.push(shared),
                Role::InRemote => table.in_remotes.push(shared),
            }
            entry.store(memory, agreed);
        }
        // Values of one type follow each other: the processor then predicts the access to each.
        let hal_type = |entry: &Entry| entry.hal_type as u8;
        table.inputs.sort_by_key(hal_type);
        table.outputs.sort_by_key(hal_type);
        for parameters in [&mut table.settings, &mut table.in_remotes] {
            parameters.sort_by_key(|shared| hal_type(&shared.entry));
        }
        table
    }

    /// Takes a setting before `read` as well: what the user acknowledges by it are the faults
    /// before that.
    pub fn acknowledge_by(&mut self, id: PinId) {
        let place = self.settings.iter().position(|one| one.entry.id == id);
        if let Some(place) = place {
            let setting = self.settings.remove(place);
            self.acknowledging.push(setting);
        }
    }

    /// Before `read`: what HAL has set of the values that both sides set.
    pub fn before_read(
        &mut self,
        pins: &mut Pins,
        memory: &mut impl Memory,
        changes: &mut dyn FnMut(Change),
    ) {
        for shared in self.inouts.iter_mut().chain(&mut self.acknowledging) {
            shared.exchange(pins, memory, changes);
        }
    }

    /// After `read`: properties, and inputs that are valid.
    pub fn after_read(&mut self, pins: &Pins, memory: &mut impl Memory) {
        let inputs = self.inputs.iter().map(|entry| (entry.id, entry));
        pins.each_valid(inputs, |entry, bits| entry.store(memory, bits));
        self.after_write(pins, memory);
    }

    /// Before `write`: outputs, settings, and what HAL has set of the values that both sides set.
    pub fn before_write(
        &mut self,
        pins: &mut Pins,
        memory: &mut impl Memory,
        changes: &mut dyn FnMut(Change),
    ) {
        for shared in self.inouts.iter_mut().chain(&mut self.acknowledging) {
            shared.exchange(pins, memory, changes);
        }
        // There are hundreds, and they seldom change.
        let version = pins.parameters_version();
        let is_same = self.taken.replace(version) == Some(version);
        let is_due =
            |shared: &Shared, memory: &_| !is_same || shared.entry.load(memory) != shared.seen;
        for shared in &mut self.settings {
            if is_due(shared, memory) {
                shared.exchange(pins, memory, changes);
            }
        }
        for shared in &mut self.in_remotes {
            if is_due(shared, memory) {
                shared.request(pins, memory, changes);
            }
        }
        self.outputs(pins, memory);
    }

    /// Gives HAL the remote's own value of a parameter back, because it cannot have the requested
    /// one.
    pub fn give_back(&mut self, id: PinId, pins: &Pins, memory: &mut impl Memory) {
        let mut all = self.in_remotes.iter_mut();
        if let Some(shared) = all.find(|shared| shared.entry.id == id) {
            let own = pins.bits_of(id);
            shared.agreed = own;
            shared.entry.store(memory, own);
            shared.seen = shared.entry.load(memory);
        }
    }

    /// Sets all outputs.
    pub fn outputs(&self, pins: &mut Pins, memory: &impl Memory) {
        for entry in &self.outputs {
            let _ = pins.repeat_bits(entry.id, entry.load(memory));
        }
    }

    /// After `write`: properties, and the driver's changes of values that both sides set.
    pub fn after_write(&mut self, pins: &Pins, memory: &mut impl Memory) {
        let version = pins.parameters_version();
        if self.shown.replace(version) == Some(version) {
            return;
        }
        for shared in self.inouts.iter_mut().chain(&mut self.properties) {
            shared.show(pins, memory);
        }
    }
}

impl Shared {
    /// Moves a change from one side to the other.
    fn exchange(
        &mut self,
        pins: &mut Pins,
        memory: &mut impl Memory,
        changes: &mut dyn FnMut(Change),
    ) {
        let Self { entry, agreed, .. } = *self;
        let own = pins.bits_of(entry.id);
        if own != agreed {
            self.agree(own);
            entry.store(memory, own);
            return;
        }
        let set = entry.load(memory);
        if set == self.seen {
            return;
        }
        match pins.set_bits(entry.id, set) {
            Ok(()) => {
                self.agree(pins.bits_of(entry.id));
                changes(Change::Set(entry.id, set));
            }
            Err(error) => {
                entry.store(memory, agreed);
                changes(Change::Refused(error));
            }
        }
    }

    fn agree(&mut self, bits: u64) {
        self.agreed = bits;
        self.seen = self.entry.of_hal(bits);
    }

    /// Requests a value that HAL has for a remote, once; HAL gets each new value of the remote.
    fn request(&mut self, pins: &Pins, memory: &mut impl Memory, changes: &mut dyn FnMut(Change)) {
        let entry = self.entry;
        self.show(pins, memory);
        let bits = entry.load(memory);
        if core::mem::replace(&mut self.seen, bits) != bits && bits != entry.of_hal(self.agreed) {
            let hal_type = entry.hal_type;
            changes(Change::Request(entry.id, AnyValue { hal_type, bits }));
        }
    }

    /// Moves a change of the driver to HAL.
    fn show(&mut self, pins: &Pins, memory: &mut impl Memory) {
        let own = pins.bits_of(self.entry.id);
        if own != self.agreed {
            self.agree(own);
            self.entry.store(memory, own);
        }
    }
}

impl Entry {
    /// HAL's value, as bits of its type there.
    fn load(&self, memory: &impl Memory) -> u64 {
        memory.load(self.index as usize)
    }

    /// Stores the driver's bits in HAL.
    fn store(&self, memory: &mut impl Memory, bits: u64) {
        memory.store(self.index as usize, self.of_hal(bits));
    }

    /// The driver's bits as bits of HAL's type. Numbers of 64 bits, which HAL 2.9 does not have,
    /// are limited to 32 bits: a counter stops at its largest value, and does not begin again.
    fn of_hal(&self, bits: u64) -> u64 {
        match self.hal_type {
            HalType::Bit | HalType::Float | HalType::S32 | HalType::U32 => bits,
            HalType::S64 => (bits as i64).clamp(i32::MIN.into(), i32::MAX.into()) as u64,
            HalType::U64 => bits.min(u32::MAX.into()),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
