//! I/O pins: those that no module uses, and the settings of those that a module uses.

use alloc::format;
use alloc::vec::Vec;

use super::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::bus::{Phase, ReadSlot, Setting, Stage, WriteSlot};
use crate::hal::{DigitalIn, Output, Param, PinError, PinStore};
use crate::hostmot2::{Gtag, IoPort, ModuleInstance, PinDescriptor, PinPlace, PortRegisters};

pub use crate::hostmot2::GpioConfig;

/// The pins and parameters of one I/O pin: `hm2_7i92.0.gpio.000.in` and so on.
///
/// A pin that a module uses cannot be set, and has a level only if the module reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct GpioPins {
    /// The level, and its opposite; absent for a pin that a module drives.
    pub input: Option<DigitalIn>,
    /// The level to drive, before inversion; only for a pin that no module uses.
    pub out: Option<Output<bool>>,
    /// True if the pin is driven; only for a pin that no module uses.
    pub is_output: Option<Param<bool>>,
    /// Inverts an output; absent for a pin that a module reads.
    pub invert_output: Option<Param<bool>>,
    /// Drives low only; absent for a pin that a module reads.
    pub is_opendrain: Option<Param<bool>>,
}

/// All I/O pins.
#[derive(Debug)]
pub struct Gpio {
    ports: Vec<GpioPort>,
}

/// An I/O port.
#[derive(Debug)]
struct GpioPort {
    pins: Vec<(PinPlace, GpioPins)>,
    /// The registers as the modules use them, before any setting of the application.
    setup: PortRegisters<u32>,
    levels: Option<ReadSlot>,
    /// The last levels that were taken.
    taken: Option<u32>,
    data: Option<WriteSlot>,
    invert: Setting,
    direction: Setting,
    open_drain: Setting,
}

impl Gpio {
    /// Registers all I/O pins of a firmware; called after all modules have taken their pins.
    ///
    /// # Errors
    /// [`RegisterError`]: the firmware has no I/O ports, or a pin cannot be used as [`Settings`]
    /// ask.
    ///
    /// [`Settings`]: crate::modules::Settings
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        let mut pins = Vec::new();
        for number in 0.. {
            let Some(place) = r.io.place(number) else {
                break;
            };
            pins.push((place, GpioPins::new(r, number)?));
        }
        for &(number, config) in &r.settings.gpio {
            r.io.use_gpio(number, config)?;
        }
        let ports = (0..).zip(r.io.ports.clone()).map(|(number, port)| {
            let of_port = pins.iter().filter(|(place, _)| place.port == number);
            GpioPort::new(r, port, of_port.copied().collect())
        });
        let module = Self {
            ports: ports.collect(),
        };
        r.add(module);
        Ok(())
    }

    /// The I/O pins, by number.
    pub fn pins(&self) -> impl Iterator<Item = GpioPins> + '_ {
        let pins = self.ports.iter().flat_map(|port| &port.pins);
        pins.map(|&(_, pins)| pins)
    }
}

impl GpioPins {
    fn new(r: &mut Registrar<'_>, number: u16) -> Result<Self, PinError> {
        let descriptor = r.firmware.pins.get(usize::from(number));
        let is_free = !r.io.is_taken(number);
        let is_driven = is_free || descriptor.is_some_and(PinDescriptor::is_output);
        let is_read = is_free || !is_driven;
        let mut settings = r.settings.gpio.iter();
        let config = settings.find_map(|&(n, config)| (n == number).then_some(config));
        let config = config.unwrap_or_default();
        let ports = ModuleInstance::new(Gtag::IO_PORT, 0);
        let place = r.board.place(r.firmware, ports, number);
        let mut make = r.maker_at(&format!("gpio.{number:03}."), place);
        let mut input = None;
        if is_read {
            input = Some(DigitalIn {
                pin: make.input("in")?,
                not: make.input("in_not")?,
            });
        }
        let mut flag = |there: bool, name: &str, initial: bool| {
            let flag = there.then(|| make.setting(name, initial));
            flag.transpose()
        };
        let made = Self {
            input,
            invert_output: flag(is_driven, "invert_output", config.invert)?,
            is_opendrain: flag(is_driven, "is_opendrain", config.open_drain)?,
            is_output: flag(is_free, "is_output", config.output)?,
            out: is_free.then(|| make.output("out", false)).transpose()?,
        };
        if let (Some(out), Some(is_output)) = (made.out, made.is_output) {
            r.pins.enabled_by(out, is_output);
        }
        Ok(made)
    }

    /// Puts the outputs and settings of the pin into the words of its port.
    fn put(&self, words: &mut PortRegisters<u32>, place: PinPlace, pins: &mut PinStore) {
        if let (Some(output), Some(out)) = (self.is_output, self.out) {
            words.direction = place.put(words.direction, pins.param(output));
            words.data = place.put(words.data, pins.fetch(out));
        }
        if let Some(open_drain) = self.is_opendrain {
            words.open_drain = place.put(words.open_drain, pins.param(open_drain));
        }
        if let Some(invert) = self.invert_output {
            words.invert = place.put(words.invert, pins.param(invert));
        }
    }
}

impl GpioPort {
    /// Registers a port. Open drain comes last, and is cleared with the directions, because a pin
    /// with open drain is driven whatever its direction is (FACTS 12.2).
    fn new(
        r: &mut Registrar<'_>,
        IoPort { address, setup }: IoPort,
        pins: Vec<(PinPlace, GpioPins)>,
    ) -> Self {
        let is_read = pins.iter().any(|(_, pins)| pins.input.is_some());
        let is_written = pins.iter().any(|(_, pins)| pins.out.is_some());
        r.image.step(Stage::Quiesce, address.direction, 0);
        r.image.step(Stage::Quiesce, address.open_drain, 0);
        if !is_written {
            r.image.step(Stage::Configure, address.data, setup.data);
        }
        let (source, word) = (address.alternate_source, setup.alternate_source);
        r.image.step(Stage::Route, source, word);
        Self {
            pins,
            setup,
            levels: is_read.then(|| r.image.read(Phase::Data, address.data)),
            taken: None,
            data: is_written.then(|| r.image.output(address.data, setup.data)),
            invert: r.image.setting(Stage::Route, address.invert, setup.invert),
            direction: r.image.drive(address.direction, setup.direction),
            open_drain: r
                .image
                .setting(Stage::Drive, address.open_drain, setup.open_drain),
        }
    }
}

impl Module for Gpio {
    /// Skips the ports whose levels are unchanged.
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        for port in &mut self.ports {
            let word = port.levels.map(|slot| cycle.words.word(slot));
            if core::mem::replace(&mut port.taken, word) == word {
                continue;
            }
            for (place, pins) in &port.pins {
                if let (Some(word), Some(input)) = (word, pins.input) {
                    cycle.pins.publish(input.pin, place.get(word));
                    cycle.pins.publish(input.not, !place.get(word));
                }
            }
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        for port in &self.ports {
            let mut wanted = port.setup;
            for (place, pins) in &port.pins {
                pins.put(&mut wanted, *place, cycle.pins);
            }
            if let Some(slot) = port.data {
                cycle.words.put(slot, wanted.data);
            }
            cycle.words.set(port.invert, wanted.invert);
            cycle.words.set(port.direction, wanted.direction);
            cycle.words.set(port.open_drain, wanted.open_drain);
        }
    }
}
