//! I/O pins: those that no module uses, and the settings of those that a module uses.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::{ListenCycle, Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::bus::{Phase, ReadSlot, Setting, Stage, WriteSlot};
use crate::hal::{DigitalIn, MAX_NAME, Output, Param, PinError, PinStore};
use crate::hostmot2::{Gtag, IoPort, ModuleInstance, PinDescriptor, PinPlace, PortRegisters};
use crate::settings::Defaults;

pub use crate::hostmot2::GpioConfig;

/// The pins and parameters of one I/O pin: `hm2_7i92.0.gpio.000.in` and so on.
///
/// A pin that a module uses cannot be set, and has a level only if the module reads it, or with
/// [`Defaults::LinuxCnc`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct GpioPins {
    /// The level, and its opposite. For a pin that a module drives only with
    /// [`Defaults::LinuxCnc`].
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
    /// By their bit in the registers.
    pins: Vec<(PinPlace, GpioPins)>,
    /// The registers as the modules use them, before any setting of the application.
    setup: PortRegisters<u32>,
    levels: Option<ReadSlot>,
    /// The directions that another program has set.
    driven: ReadSlot,
    /// The last levels that were taken.
    taken: Option<u32>,
    data: Option<WriteSlot>,
    address: PortRegisters<u16>,
    source: Setting,
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
    /// [`Settings`]: crate::settings::Settings
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

    /// Makes plain I/O of pins that a module has taken and does not use, when the board is set up
    /// already. Returns the writes that the board needs for it, in their order: none of them drives
    /// a pin.
    pub(crate) fn give_back(
        &mut self,
        r: &mut Registrar<'_>,
        numbers: &[u16],
    ) -> Result<Vec<(u16, u32)>, RegisterError> {
        for &number in numbers {
            r.io.give_back(number);
            let place = r.io.place(number);
            if let Some(pins) = place.and_then(|place| self.at_mut(place)) {
                pins.make_free(r, number)?;
            }
        }
        let mut writes = Vec::new();
        for (port, IoPort { setup, .. }) in self.ports.iter_mut().zip(r.io.ports.clone()) {
            if port.setup == setup {
                continue;
            }
            port.setup = setup;
            r.image.change(port.direction, setup.direction);
            r.image.change(port.source, setup.alternate_source);
            if port.data.is_none() {
                port.data = Some(r.image.output(port.address.data, setup.data));
            }
            writes.push((port.address.direction, setup.direction));
            writes.push((port.address.alternate_source, setup.alternate_source));
        }
        Ok(writes)
    }

    /// Gives the parameters of pins that modules drive their second names in LinuxCNC.
    pub(crate) fn add_aliases(&self, r: &mut Registrar<'_>) -> Result<(), PinError> {
        for number in 0.. {
            let Some(place) = r.io.place(number) else {
                break;
            };
            let pins = self.ports.get(usize::from(place.port));
            let pins = pins.and_then(|port| port.pins.iter().find(|(at, _)| *at == place));
            if let Some((_, pins)) = pins {
                pins.add_aliases(r, number)?;
            }
        }
        Ok(())
    }

    fn at_mut(&mut self, place: PinPlace) -> Option<&mut GpioPins> {
        let port = self.ports.get_mut(usize::from(place.port))?;
        let (_, pins) = port.pins.iter_mut().find(|(at, _)| *at == place)?;
        Some(pins)
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
        let is_read = is_free || !is_driven || r.settings.defaults == Defaults::LinuxCnc;
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
                not: make.opposite("in_not")?,
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

    /// Makes the pins and parameters that only a pin has which no module uses.
    fn make_free(&mut self, r: &mut Registrar<'_>, number: u16) -> Result<(), PinError> {
        let ports = ModuleInstance::new(Gtag::IO_PORT, 0);
        let place = r.board.place(r.firmware, ports, number);
        let mut make = r.maker_at(&format!("gpio.{number:03}."), place);
        let flags = [
            (&mut self.invert_output, "invert_output"),
            (&mut self.is_opendrain, "is_opendrain"),
            (&mut self.is_output, "is_output"),
        ];
        for (flag, name) in flags {
            if flag.is_none() {
                *flag = Some(make.setting(name, false)?);
            }
        }
        let out = make.output("out", false)?;
        self.out = Some(out);
        if let Some(is_output) = self.is_output {
            r.pins.enabled_by(out, is_output);
        }
        Ok(())
    }

    fn add_aliases(&self, r: &mut Registrar<'_>, number: u16) -> Result<(), PinError> {
        let Some(alias) = self.alias(r, number) else {
            return Ok(());
        };
        let named = [
            (self.invert_output, "invert_output"),
            (self.is_opendrain, "is_opendrain"),
        ];
        for (param, name) in named {
            let mut name = format!("{alias}.{name}");
            // LinuxCNC cuts second names one character before its limit.
            name.truncate(MAX_NAME - 1);
            if let Some(param) = param {
                r.pins.add_alias(param, name)?;
            }
        }
        Ok(())
    }

    /// The second name in LinuxCNC of an I/O pin that a module drives, for the names of its
    /// parameters: `hm2_7i97.0.pwmgen.00.out0`. Several pins with the same function are numbered.
    fn alias(&self, r: &Registrar<'_>, number: u16) -> Option<String> {
        let pin = r.firmware.pins.get(usize::from(number))?;
        let is_driven = self.out.is_none() && pin.is_output();
        if r.settings.defaults != Defaults::LinuxCnc || !is_driven {
            return None;
        }
        let (module, function) = hal_name(*pin)?;
        let pins = (0..).zip(&r.firmware.pins);
        let same = pins.filter(|&(other, same)| same == pin && r.io.is_taken(other));
        let same: Vec<u16> = same.map(|(other, _)| other).collect();
        let nth = same.iter().position(|&other| other == number)?;
        let (name, unit) = (r.name, pin.unit);
        Some(match *same {
            [_] => format!("{name}.{module}.{unit:02}.{function}"),
            _ => format!("{name}.{module}.{unit:02}.{nth}.{function}"),
        })
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

/// LinuxCNC's names of the module and the function of a pin that the module drives, if it has some.
fn hal_name(pin: PinDescriptor) -> Option<(&'static str, String)> {
    let channel = pin.sserial_channel().unwrap_or_default();
    Some(match (pin.secondary, pin.secondary_pin) {
        (Gtag::PWM, 0x81) => ("pwmgen", "out0".into()),
        (Gtag::PWM, 0x82) => ("pwmgen", "out1".into()),
        (Gtag::PWM, 0x83) => ("pwmgen", "enable".into()),
        (Gtag::STEPGEN, 0x81) => ("stepgen", "step".into()),
        (Gtag::STEPGEN, 0x82) => ("stepgen", "direction".into()),
        (Gtag::STEPGEN, output @ 0x83..=0x88) => {
            ("stepgen", format!("table{}", output.saturating_sub(0x81)))
        }
        (Gtag::MUX_SELECT, 0x81) => ("encoder", "sel0".into()),
        (Gtag::MUX_SELECT, 0x82) => ("encoder", "sel1".into()),
        (Gtag::SSERIAL | Gtag::SSERIAL_B, 0x81..=0x88) => ("sserial", format!("tx{channel}")),
        (Gtag::SSERIAL | Gtag::SSERIAL_B, 0x91..=0x98) => ("sserial", format!("txen{channel}")),
        _ => return None,
    })
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
        Self {
            pins,
            setup,
            address,
            source: r.image.setting(Stage::Route, source, word),
            levels: is_read.then(|| r.image.read(Phase::Data, address.data)),
            driven: r.image.read_back(address.direction),
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
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        for port in &self.ports {
            let levels = port.levels.map(|slot| cycle.words.word(slot));
            let directions = cycle.words.word(port.driven);
            for &(place, pins) in &port.pins {
                if let (Some(input), Some(levels)) = (pins.input, levels) {
                    cycle.show(input.pin, place.get(levels));
                    cycle.show(input.not, !place.get(levels));
                }
                if let Some(is_output) = pins.is_output {
                    cycle.show(is_output, place.get(directions));
                }
            }
        }
    }

    /// Publishes the levels that have changed, and all of them at first.
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        for port in &mut self.ports {
            let Some(slot) = port.levels else {
                continue;
            };
            let word = cycle.words.word(slot);
            let taken = port.taken.replace(word);
            let mut changed = taken.map_or(u32::MAX, |taken| taken ^ word);
            // Behind the last pin there is no bit, or one without a pin.
            while let Some((place, pins)) = port.pins.get(changed.trailing_zeros() as usize) {
                if let Some(input) = pins.input {
                    cycle.pins.publish(input.pin, place.get(word));
                    cycle.pins.publish(input.not, !place.get(word));
                }
                changed &= changed.wrapping_sub(1);
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
