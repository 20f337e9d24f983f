//! The I/O pins alone, for a thread that is faster than that of the cycle: the functions
//! `read_gpio` and `write_gpio`, which hm2_pci has.

use mesa_hal::bus::RegisterBus;
use mesa_hal::hal::{Pins, Value};
use mesa_hal::hostmot2::{Gtag, HostMot2};

use crate::table::Memory;

/// The I/O pins of a board, by port.
#[derive(Debug, Default)]
pub(crate) struct Gpio {
    ports: Vec<Port>,
}

/// A port: the register of its levels, and its pins by their bit there.
#[derive(Debug)]
struct Port {
    data: u16,
    pins: Vec<Pin>,
}

/// The numbers in HAL of a pin's `in`, `in_not` and `out`, as far as it has them.
#[derive(Clone, Copy, Debug)]
struct Pin {
    level: Option<usize>,
    not: Option<usize>,
    out: Option<usize>,
}

impl Gpio {
    /// The I/O pins of a board. HAL's numbers are the positions of the driver's pins.
    pub fn new(firmware: &HostMot2, board: &str, pins: &Pins) -> Self {
        let Some(module) = firmware.find(Gtag::IO_PORT) else {
            return Self::default();
        };
        let width = firmware.idrom.port_width as usize;
        let number = |pin: usize, end: &str| {
            let name = format!("{board}.gpio.{pin:03}.{end}");
            pins.find(&name).map(mesa_hal::hal::PinId::index)
        };
        let port = |instance: u8| {
            let first = usize::from(instance) * width;
            let pins = (first..first + width).map(|pin| Pin {
                level: number(pin, "in"),
                not: number(pin, "in_not"),
                out: number(pin, "out"),
            });
            let data = module.register(0, instance).ok()?;
            Some(Port {
                data,
                pins: pins.collect(),
            })
        };
        Self {
            ports: (0..module.instances).filter_map(port).collect(),
        }
    }

    /// Reads all levels into HAL. A read that fails changes nothing: the cycle finds out why.
    ///
    /// # Real time
    /// One access for each port. No allocation.
    pub fn read(&self, bus: &mut impl RegisterBus, memory: &mut impl Memory) {
        for port in &self.ports {
            let Ok(word) = bus.read(port.data) else {
                return;
            };
            for (bit, pin) in port.pins.iter().enumerate() {
                let is_high = word >> bit & 1 != 0;
                for (number, level) in [(pin.level, is_high), (pin.not, !is_high)] {
                    if let Some(number) = number {
                        memory.store(number, level.to_bits());
                    }
                }
            }
        }
    }

    /// Writes the levels of all outputs from HAL.
    ///
    /// # Real time
    /// As [`read`](Self::read).
    pub fn write(&self, bus: &mut impl RegisterBus, memory: &impl Memory) {
        for port in &self.ports {
            let outs = port.pins.iter().enumerate();
            let outs = outs.filter_map(|(bit, pin)| Some((bit, pin.out?)));
            let mut outs = outs.peekable();
            if outs.peek().is_none() {
                continue;
            }
            let word = outs.fold(0, |word: u32, (bit, number)| {
                word | u32::from(memory.load(number) != 0) << bit
            });
            if bus.write(port.data, word).is_err() {
                return;
            }
        }
    }
}
