//! The I/O ports: direction, alternate source, open drain and invert of every pin.

use mesa_wire::bus::Direction;

use super::{Configuration, Settles, SimModule};
use crate::fpga::{Fabric, UNDRIVEN};

const DATA: u8 = 0;
const DIRECTION: u8 = 1;
const ALTERNATE: u8 = 2;
const OPEN_DRAIN: u8 = 3;
const INVERT: u8 = 4;

/// The registers of all ports: a port is an instance of this module.
///
/// The set-up of the pins concerns all modules, and belongs to the fabric: [`SimIoPorts`].
#[derive(Debug)]
pub(super) struct IoPortRegisters;

impl SimModule for IoPortRegisters {
    fn read(&mut self, fabric: &Fabric, register: u8, port: u8) -> u32 {
        let levels = |pin| fabric.module_level(pin);
        fabric.io().read(register, port, &levels)
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, port: u8, value: u32) {
        fabric.io_mut().write(register, port, value);
        fabric.pins_changed();
    }

    fn reload(&mut self, _: &Configuration<'_>) {}

    fn settles(&self, access: Direction) -> Settles {
        match access {
            Direction::Read => Settles::Signals,
            Direction::Write => Settles::World,
        }
    }

    fn is_driving(&self) -> bool {
        true
    }
}

/// The registers of one port.
#[derive(Clone, Copy, Debug, Default)]
struct Port {
    data: u32,
    direction: u32,
    alternate: u32,
    open_drain: u32,
    invert: u32,
}

/// The signal that the FPGA drives a pin from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The FPGA does not drive the pin.
    Undriven,
    /// A plain output.
    Level(bool),
    /// The module that can use the pin.
    Module {
        /// True if the port inverts the signal.
        inverted: bool,
    },
}

/// All I/O ports of the FPGA, and the levels that the outside world drives on the pins.
#[derive(Clone, Debug)]
pub struct SimIoPorts {
    ports: Vec<Port>,
    width: u32,
    outside: Vec<Option<bool>>,
}

impl SimIoPorts {
    /// Ports at power-up: every pin is an input with a pull-up.
    pub(crate) fn new(ports: u32, width: u32) -> Self {
        let width = width.clamp(1, 32);
        let ports = ports.min(16) as usize;
        Self {
            ports: vec![Port::default(); ports],
            width,
            outside: vec![None; ports * width as usize],
        }
    }

    /// Registers after a reload of the FPGA: as at power-up. Levels driven from outside stay.
    pub(crate) fn reload(&mut self) {
        self.ports.fill(Port::default());
    }

    /// Reads a register; `levels` returns a module's output on a pin.
    fn read(&self, register: u8, port: u8, levels: &dyn Fn(usize) -> bool) -> u32 {
        let Some(registers) = self.ports.get(usize::from(port)) else {
            return 0;
        };
        match register {
            DATA => {
                let first = usize::from(port) * self.width as usize;
                (0..self.width).fold(0, |word, bit| {
                    let level = self.level(first + bit as usize, levels);
                    word | u32::from(level) << bit
                })
            }
            DIRECTION => registers.direction,
            _ => UNDRIVEN,
        }
    }

    /// Writes a register.
    fn write(&mut self, register: u8, port: u8, value: u32) {
        let value = value & (u32::MAX >> (32 - self.width));
        let Some(registers) = self.ports.get_mut(usize::from(port)) else {
            return;
        };
        match register {
            DATA => registers.data = value,
            DIRECTION => registers.direction = value,
            ALTERNATE => registers.alternate = value,
            OPEN_DRAIN => registers.open_drain = value,
            INVERT => registers.invert = value,
            _ => {}
        }
    }

    /// Makes all pins inputs, as a watchdog bite does.
    pub(crate) fn make_inputs(&mut self) {
        for port in &mut self.ports {
            port.direction = 0;
            port.open_drain = 0;
        }
    }

    /// The voltage on a pin as a logic level; `levels` returns a module's output on a pin.
    pub(crate) fn level(&self, pin: usize, levels: &dyn Fn(usize) -> bool) -> bool {
        self.driven_level(pin, levels).unwrap_or(true)
    }

    /// The level that the FPGA or the outside drives on a pin; `None` if the pin is only pulled up.
    ///
    /// Open drain pulls low whatever the direction is. FACTS 12.2. If both sides drive different
    /// levels, the pin is low, as in a short circuit.
    pub(crate) fn driven_level(&self, pin: usize, levels: &dyn Fn(usize) -> bool) -> Option<bool> {
        let (port, mask) = self.locate(pin)?;
        let source = if port.alternate & mask != 0 {
            levels(pin)
        } else {
            port.data & mask != 0
        };
        let out = source ^ (port.invert & mask != 0);
        let driven = if port.open_drain & mask != 0 {
            !out
        } else {
            port.direction & mask != 0
        };
        let outside = self.outside.get(pin).copied().flatten();
        if driven {
            return Some(out && outside != Some(false));
        }
        outside
    }

    /// True if a module's signal reaches a pin: alternate source, driven, not inverted. `false` if
    /// the firmware has no such pin.
    pub(crate) fn module_drives(&self, pin: Option<usize>) -> bool {
        self.module_pin(pin) == Some(false)
    }

    /// True if the port inverts the signal of the module that drives a pin; `None` if none drives
    /// it.
    pub(crate) fn module_pin(&self, pin: Option<usize>) -> Option<bool> {
        match self.source(pin) {
            Source::Module { inverted } => Some(inverted),
            Source::Undriven | Source::Level(_) => None,
        }
    }

    /// The signal that the FPGA drives an I/O pin from; `Undriven` for a pin that the firmware does
    /// not have. An open-drain pin that is 1 stays at its pull-up.
    pub fn source(&self, pin: Option<usize>) -> Source {
        let Some((port, mask)) = pin.and_then(|pin| self.locate(pin)) else {
            return Source::Undriven;
        };
        let inverted = port.invert & mask != 0;
        if (port.direction | port.open_drain) & mask == 0 {
            Source::Undriven
        } else if port.alternate & mask != 0 {
            Source::Module { inverted }
        } else {
            Source::Level((port.data & mask != 0) != inverted)
        }
    }

    /// True if the FPGA drives a pin, even if only to one of the levels.
    pub(crate) fn is_output(&self, pin: usize) -> bool {
        self.locate(pin)
            .is_some_and(|(port, mask)| (port.direction | port.open_drain) & mask != 0)
    }

    /// Drives a pin from outside, or releases it (the pull-up then makes it 1).
    pub(crate) fn drive(&mut self, pin: usize, level: Option<bool>) {
        if let Some(slot) = self.outside.get_mut(pin) {
            *slot = level;
        }
    }

    fn locate(&self, pin: usize) -> Option<(&Port, u32)> {
        let width = self.width as usize;
        let port = self.ports.get(pin / width)?;
        Some((port, 1 << (pin % width)))
    }
}
