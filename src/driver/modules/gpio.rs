//! I/O pins that no module drives, and what can be set of those that one does.

use alloc::vec::Vec;

use super::{Making, PartError, Wiring};
use crate::boards::fpga::{GpioPins, PinUse};
use crate::bus::{ImagePlan, ReadSlot, WriteSlot};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hal::{Param, PinStore, Pins};
use crate::hostmot2::{GpioSetup, IoPorts, PinPlace, PortPlan, PortSetup};

pub use crate::modules::gpio::GpioConfig;

/// All I/O pins.
#[derive(Debug)]
pub(in crate::driver) struct GpioModule {
    registers: IoPorts,
    pins: Vec<(PinPlace, GpioPins)>,
    ports: Vec<Port>,
}

/// One port, as it is at first, and its words in the image.
#[derive(Debug)]
struct Port {
    setup: PortSetup,
    /// What the application asks for now.
    wanted: PortSetup,
    levels: Option<ReadSlot>,
    data: Option<WriteSlot>,
    /// The levels that were taken last.
    taken: Option<u32>,
    invert: Option<SettingSlot>,
}

impl GpioModule {
    /// All pins of a firmware. To be called when the modules have taken theirs.
    pub fn build(
        parts: &mut Making<'_>,
        registers: &IoPorts,
        configs: &[(u16, GpioConfig)],
    ) -> Result<Self, PartError> {
        let wiring = Wiring::of(parts.firmware);
        let mut pins = Vec::new();
        for (number, descriptor) in (0u16..).zip(parts.firmware.pins()) {
            let Some(place) = registers.place(number) else {
                break;
            };
            let is_free = !parts.plan.is_taken(number);
            let usage = if is_free {
                PinUse::Gpio
            } else {
                PinUse::of(descriptor)
            };
            let index = usize::from(number);
            let terminals = wiring.io(index);
            let made = GpioPins::new(
                parts.pins,
                parts.group,
                parts.board,
                index,
                usage,
                terminals,
            )?;
            pins.push((place, made));
        }
        for &(number, config) in configs {
            configure(parts.pins, &pins, parts.plan, number, config)?;
        }
        parts.made.io = pins.iter().map(|(_, made)| *made).collect();
        let ports = parts.plan.ports().iter();
        let ports = ports.map(|&setup| Port::new(setup)).collect();
        Ok(Self {
            registers: *registers,
            pins,
            ports,
        })
    }
}

/// Sets a pin's parameters and its place in the plan.
fn configure(
    store: &mut PinStore,
    pins: &[(PinPlace, GpioPins)],
    plan: &mut PortPlan,
    number: u16,
    config: GpioConfig,
) -> Result<(), PartError> {
    let setup = GpioSetup {
        output: config.output,
        open_drain: config.open_drain,
        invert: config.invert,
        level: false,
    };
    plan.use_gpio(number, setup)?;
    let Some((_, of)) = pins.get(usize::from(number)) else {
        return Ok(());
    };
    for (param, value) in [
        (of.is_output, config.output),
        (of.is_opendrain, config.open_drain),
        (of.invert_output, config.invert),
    ] {
        if let Some(param) = param {
            store.set_param(param, value)?;
        }
    }
    Ok(())
}

impl Port {
    fn new(setup: PortSetup) -> Self {
        Self {
            setup,
            wanted: setup,
            levels: None,
            taken: None,
            data: None,
            invert: None,
        }
    }
}

impl Module for GpioModule {
    /// The whole of it is the plan of the ports, which the driver writes when all modules are set
    /// up.
    fn set_up(&self, _: &mut SetupList) {}

    fn claim(&mut self, plan: &mut ImagePlan) {
        let registers = &self.registers;
        for (index, port) in (0u8..).zip(&mut self.ports) {
            let of_port = || self.pins.iter().filter(|(place, _)| place.port == index);
            let is_read = of_port().any(|(_, pin)| pin.input.is_some());
            let is_written = of_port().any(|(_, pin)| pin.out.is_some());
            if let Some(address) = registers.data.address(index) {
                port.levels = is_read.then(|| plan.read_data(address));
                port.data = is_written.then(|| plan.write_data(address, port.setup.data));
            }
            let address = registers.invert.address(index);
            port.invert =
                address.map(|address| SettingSlot::claim(plan, address, port.setup.invert));
        }
    }

    /// Ports of which no pin has changed are passed over.
    fn take(&mut self, cycle: &mut Take<'_>) {
        let mut changed = 0_u64;
        for (index, port) in self.ports.iter_mut().enumerate() {
            let word = port.levels.and_then(|slot| cycle.image.word(slot));
            changed |= u64::from(word != port.taken) << (index & 63);
            port.taken = word;
        }
        if changed == 0 {
            return;
        }
        for (place, pin) in &self.pins {
            let word = self.ports.get(usize::from(place.port));
            let word = word.and_then(|port| port.taken);
            if let (Some(word), true) = (word, changed >> (place.port & 63) & 1 != 0) {
                pin.publish(cycle.pins, place.get(word));
            }
        }
    }

    fn put(&mut self, cycle: &mut Put<'_>) {
        for port in &mut self.ports {
            port.wanted = port.setup;
        }
        for (place, pin) in &self.pins {
            if let Some(port) = self.ports.get_mut(usize::from(place.port)) {
                put_pin(&mut port.wanted, *place, pin, cycle.pins);
            }
        }
        for (index, port) in self.ports.iter().enumerate() {
            let words = port.wanted;
            if let Some(slot) = port.data {
                cycle.image.put(slot, words.data);
            }
            cycle.change(port.invert, words.invert);
            cycle.drive(index, words);
        }
    }
}

/// Puts what the application asks of a pin into the words of its port.
fn put_pin(words: &mut PortSetup, place: PinPlace, pin: &GpioPins, pins: &mut PinStore) {
    let flag = |pins: &Pins, param: Option<Param<bool>>| param.map(|param| pins.param(param));
    if let Some(output) = flag(pins, pin.is_output) {
        words.direction = place.put(words.direction, output);
        words.data = place.put(words.data, pin.level(pins));
    }
    if let Some(open_drain) = flag(pins, pin.is_opendrain) {
        words.open_drain = place.put(words.open_drain, open_drain);
    }
    if let Some(invert) = flag(pins, pin.invert_output) {
        words.invert = place.put(words.invert, invert);
    }
}
