//! I/O ports: the pins themselves, and their sources.

use super::{Gtag, HostMot2, HostMot2Error, PinDescriptor};
use crate::bus::{BusError, ImagePlan, RegisterBus, Stage};
use alloc::format;
use alloc::vec;
use alloc::vec::Vec;

/// An item for each register of an I/O port: its address, or its word.
///
/// Source: FACTS 13.3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct PortRegisters<T> {
    /// Written: the levels of plain outputs. Read: the levels of all pins.
    pub data: T,
    /// 1 = output.
    pub direction: T,
    /// 1 = a module drives the pin.
    pub alternate_source: T,
    /// 1 = the output only pulls down.
    pub open_drain: T,
    /// 1 = the output is inverted.
    pub invert: T,
}

/// An I/O port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct IoPort {
    /// Addresses of its registers.
    pub address: PortRegisters<u16>,
    /// Words to which the registers are set.
    pub setup: PortRegisters<u32>,
}

/// A pin of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct PinPlace {
    /// Number of the port.
    pub port: u8,
    /// The bit of the pin in the registers of the port.
    pub mask: u32,
}

impl PinPlace {
    /// The level of the pin in a data word.
    pub const fn get(self, word: u32) -> bool {
        word & self.mask != 0
    }

    /// The word with the bit of the pin set or cleared.
    #[must_use]
    pub const fn put(self, word: u32, on: bool) -> u32 {
        if on {
            word | self.mask
        } else {
            word & !self.mask
        }
    }
}

/// Initial configuration of an I/O pin that no module uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct GpioConfig {
    /// True for an output, false for an input.
    pub output: bool,
    /// The output pulls low only.
    pub open_drain: bool,
    /// The output is inverted by the hardware.
    pub invert: bool,
}

/// All I/O ports, and the source of each pin. Unused pins are inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoPorts {
    /// The ports, by number.
    pub(crate) ports: Vec<IoPort>,
    /// Number of pins of a port.
    width: u16,
    /// True for each pin that is in use.
    taken: Vec<bool>,
}

impl IoPorts {
    const REGISTERS: u8 = 5;
    const MULTIPLE: u32 = 0x1F;

    /// The I/O ports of a firmware, with all pins as inputs.
    ///
    /// # Errors
    /// [`HostMot2Error`] if the firmware has no I/O ports, or ports with an unsupported layout.
    pub fn locate(firmware: &HostMot2) -> Result<Self, HostMot2Error> {
        let module = firmware.require(Gtag::IO_PORT)?;
        module.check_layout(Self::REGISTERS, Self::MULTIPLE)?;
        let port = |number| {
            let address = |register| module.register(register, number);
            Ok(IoPort {
                address: PortRegisters {
                    data: address(0)?,
                    direction: address(1)?,
                    alternate_source: address(2)?,
                    open_drain: address(3)?,
                    invert: address(4)?,
                },
                setup: PortRegisters::default(),
            })
        };
        let width = firmware.idrom.port_width as u16;
        let pins = usize::from(width) * usize::from(module.instances);
        Ok(Self {
            ports: (0..module.instances).map(port).collect::<Result<_, _>>()?,
            width,
            taken: vec![false; pins.min(firmware.pins.len())],
        })
    }

    /// True if any pin is an output in the present state of the board.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn drives<B: RegisterBus>(&self, bus: &mut B) -> Result<bool, BusError> {
        for port in &self.ports {
            if bus.read(port.address.direction)? != 0 {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Port and bit of I/O pin `pin`; `None` beyond the last.
    pub(crate) fn place(&self, pin: u16) -> Option<PinPlace> {
        self.taken.get(usize::from(pin))?;
        Some(PinPlace {
            port: pin.checked_div(self.width)? as u8,
            mask: 1 << (pin.checked_rem(self.width)? & 31),
        })
    }

    /// True if a module uses the pin or it is configured as plain I/O.
    pub fn is_taken(&self, pin: u16) -> bool {
        self.taken.get(usize::from(pin)).is_some_and(|taken| *taken)
    }

    /// Assigns to instance `unit` of a module those of its I/O pins that are `wanted`: pins that
    /// the module drives become outputs with the module as their source, the others stay inputs. An
    /// instance may have no pins here: local I/O pins have no registers.
    ///
    /// Source: FACTS 9.1 (bit 7 of the secondary pin).
    ///
    /// # Errors
    /// [`HostMot2Error::IoPin`].
    pub fn use_module(
        &mut self,
        firmware: &HostMot2,
        gtag: Gtag,
        unit: u8,
        wanted: impl Fn(PinDescriptor) -> bool,
    ) -> Result<(), HostMot2Error> {
        let pins = firmware.pins_of(gtag, unit);
        for (pin, descriptor) in pins.filter(|&(_, descriptor)| wanted(*descriptor)) {
            self.take(pin, |setup, place| {
                let drives = descriptor.is_output();
                setup.direction = place.put(setup.direction, drives);
                setup.alternate_source = place.put(setup.alternate_source, drives);
            })?;
        }
        Ok(())
    }

    /// Configures a pin as plain I/O.
    ///
    /// # Errors
    /// [`HostMot2Error::IoPin`].
    pub fn use_gpio(&mut self, pin: u16, config: GpioConfig) -> Result<(), HostMot2Error> {
        self.take(pin, |setup, place| {
            setup.direction = place.put(setup.direction, config.output);
            setup.open_drain = place.put(setup.open_drain, config.open_drain);
            setup.invert = place.put(setup.invert, config.invert);
        })
    }

    /// Makes a pin that a module uses a plain input.
    pub(crate) fn give_back(&mut self, pin: u16) {
        let Some(place) = self.place(pin) else {
            return;
        };
        if let Some(taken) = self.taken.get_mut(usize::from(pin)) {
            *taken = false;
        }
        if let Some(IoPort { setup, .. }) = self.ports.get_mut(usize::from(place.port)) {
            setup.direction = place.put(setup.direction, false);
            setup.alternate_source = place.put(setup.alternate_source, false);
        }
    }

    fn take(
        &mut self,
        pin: u16,
        change: impl FnOnce(&mut PortRegisters<u32>, PinPlace),
    ) -> Result<(), HostMot2Error> {
        let (place, pins) = (self.place(pin), self.taken.len());
        let taken = self.taken.get_mut(usize::from(pin));
        let (Some(taken), Some(place)) = (taken, place) else {
            let why = format!("is not there: this firmware has {pins} of them, counted from 0");
            return Err(HostMot2Error::IoPin { pin, why });
        };
        if core::mem::replace(taken, true) {
            let why = "is used by a module or as plain I/O already".into();
            return Err(HostMot2Error::IoPin { pin, why });
        }
        let port = self.ports.get_mut(usize::from(place.port));
        debug_assert!(port.is_some(), "pin {pin} is in no port");
        if let Some(port) = port {
            change(&mut port.setup, place);
        }
        Ok(())
    }

    /// Sets up all ports in one exchange, in an order in which no pin is ever driven with a wrong
    /// level: first nothing is driven, then come levels, inversions and sources, then directions.
    /// Open drain comes last, because a pin with open drain is driven whatever its direction (FACTS
    /// 12.2).
    ///
    /// # Errors
    /// Errors of the bus.
    ///
    /// # Real time
    /// For set-up: allocates.
    pub fn apply<B: RegisterBus>(&self, bus: &mut B) -> Result<(), BusError> {
        let mut plan = ImagePlan::default();
        for IoPort { address, setup } in &self.ports {
            plan.step(Stage::Quiesce, address.direction, 0);
            plan.step(Stage::Quiesce, address.open_drain, 0);
            plan.step(Stage::Configure, address.data, setup.data);
            plan.step(Stage::Route, address.invert, setup.invert);
            let source = setup.alternate_source;
            plan.step(Stage::Route, address.alternate_source, source);
            plan.step(Stage::Drive, address.direction, setup.direction);
            plan.step(Stage::Enable, address.open_drain, setup.open_drain);
        }
        plan.set_up(bus)
    }
}
