//! I/O ports: the pins themselves, and who drives them.

use super::{Gtag, HostMot2, LocateError, RegisterBlock};
use crate::bus::{Access, RegisterBus};
use alloc::vec::Vec;
use thiserror::Error;

/// The registers of all I/O ports.
///
/// Source: FACTS 13.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IoPorts {
    /// Written: the levels of plain outputs. Read: the levels of all pins.
    pub data: RegisterBlock,
    /// 1 = output.
    pub direction: RegisterBlock,
    /// 1 = a module drives the pin.
    pub alternate_source: RegisterBlock,
    /// 1 = the output only pulls down.
    pub open_drain: RegisterBlock,
    /// 1 = the output is inverted.
    pub invert: RegisterBlock,
    width: u8,
    pins: u16,
}

/// One pin of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PinPlace {
    /// The port, and index of its registers.
    pub port: u8,
    /// The bit in the registers of the port.
    pub bit: u8,
}

impl PinPlace {
    /// The bit as a mask.
    pub const fn mask(self) -> u32 {
        1 << (self.bit & 31)
    }

    /// The level of the pin in a data word.
    pub const fn get(self, word: u32) -> bool {
        word & self.mask() != 0
    }

    /// The word with the bit of the pin set or cleared.
    #[must_use]
    pub const fn put(self, word: u32, on: bool) -> u32 {
        if on {
            word | self.mask()
        } else {
            word & !self.mask()
        }
    }
}

impl IoPorts {
    const REGISTERS: u8 = 5;
    const MULTIPLE: u32 = 0x1F;

    /// The I/O ports of a firmware.
    pub fn locate(firmware: &HostMot2) -> Result<Self, LocateError> {
        let module = firmware.require(Gtag::IO_PORT)?;
        module.expect(&[Gtag::IO_PORT], Self::REGISTERS, Self::MULTIPLE)?;
        let width = firmware.idrom().port_width as u8;
        let pins = u16::from(width) * u16::from(module.instances);
        Ok(Self {
            data: module.block(0)?,
            direction: module.block(1)?,
            alternate_source: module.block(2)?,
            open_drain: module.block(3)?,
            invert: module.block(4)?,
            width,
            pins: pins.min(firmware.pins().len() as u16),
        })
    }

    /// Where I/O pin `pin` is; `None` beyond the last.
    pub fn place(&self, pin: u16) -> Option<PinPlace> {
        if pin >= self.pins {
            return None;
        }
        Some(PinPlace {
            port: pin.checked_div(u16::from(self.width))? as u8,
            bit: pin.checked_rem(u16::from(self.width))? as u8,
        })
    }

    /// Sets all ports up, in one exchange and in an order in which no pin is driven with a level
    /// that nobody asked for: nothing driven, then levels, inversions and sources, then directions,
    /// and open drain last, because a pin with open drain is driven whatever its direction
    /// (FACTS 12.2).
    ///
    /// # Real time
    /// For set-up: allocates.
    pub fn apply<B: RegisterBus>(&self, bus: &mut B, plan: &PortPlan) -> Result<(), B::Error> {
        let (mut accesses, mut words) = (Vec::new(), Vec::new());
        let mut push = |block: &RegisterBlock, word: fn(&PortSetup) -> u32| {
            for (address, setup) in block.addresses().zip(&plan.ports) {
                accesses.push(Access::write(address, words.len() as u16, 1));
                words.push(word(setup));
            }
        };
        push(&self.direction, |_| 0);
        push(&self.open_drain, |_| 0);
        push(&self.data, |setup| setup.data);
        push(&self.invert, |setup| setup.invert);
        push(&self.alternate_source, |setup| setup.alternate_source);
        push(&self.direction, |setup| setup.direction);
        push(&self.open_drain, |setup| setup.open_drain);
        bus.exchange(&accesses, &mut words)
    }
}

/// What the registers of one port are set to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PortSetup {
    /// Levels of plain outputs.
    pub data: u32,
    /// 1 = output.
    pub direction: u32,
    /// 1 = a module drives the pin.
    pub alternate_source: u32,
    /// 1 = the output only pulls down.
    pub open_drain: u32,
    /// 1 = the output is inverted.
    pub invert: u32,
}

/// How a pin is used as plain I/O.
#[allow(
    clippy::struct_excessive_bools,
    reason = "independent properties of a pin, one register bit each"
)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GpioSetup {
    /// Output, else input.
    pub output: bool,
    /// The output only pulls down.
    pub open_drain: bool,
    /// The output is inverted.
    pub invert: bool,
    /// Its level at first, before inversion.
    pub level: bool,
}

/// Who drives which pin: built from the pin descriptors, then applied at once.
///
/// Pins that nothing was said about are inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortPlan {
    ports: Vec<PortSetup>,
    places: IoPorts,
    taken: Vec<bool>,
}

/// Why a pin can not be used as asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IoPinError {
    /// There is no such pin.
    #[error("there is no I/O pin {pin}: this firmware has {pins} of them, counted from 0")]
    NoSuchPin {
        /// The pin.
        pin: u16,
        /// How many there are.
        pins: u16,
    },
    /// The pin is in use.
    #[error("I/O pin {pin} is used by a module or as plain I/O already: choose another one")]
    InUse {
        /// The pin.
        pin: u16,
    },
    /// The module has no pins.
    #[error("{gtag} {unit} has no pins in this firmware: choose another instance or firmware")]
    NoPins {
        /// The module.
        gtag: Gtag,
        /// The instance.
        unit: u8,
    },
}

impl PortPlan {
    /// All pins are inputs.
    pub fn new(ports: &IoPorts) -> Self {
        Self {
            ports: alloc::vec![PortSetup::default(); ports.data.count() as usize],
            places: *ports,
            taken: alloc::vec![false; ports.pins as usize],
        }
    }

    /// What the ports will be set to.
    pub fn ports(&self) -> &[PortSetup] {
        &self.ports
    }

    /// Gives instance `unit` of a module its pins: those that it drives become outputs with the
    /// module as their source, the others stay inputs.
    ///
    /// Source: FACTS 9.1 (bit 7 of the secondary pin).
    pub fn use_module(
        &mut self,
        firmware: &HostMot2,
        gtag: Gtag,
        unit: u8,
    ) -> Result<(), IoPinError> {
        self.use_some(firmware, gtag, unit, |_| true)
    }

    /// The same for those of its pins that are `wanted`; the others stay free for plain I/O.
    pub(crate) fn use_some(
        &mut self,
        firmware: &HostMot2,
        gtag: Gtag,
        unit: u8,
        wanted: impl Fn(super::PinDescriptor) -> bool,
    ) -> Result<(), IoPinError> {
        let mut pins = firmware.pins_of(gtag, unit).peekable();
        if pins.peek().is_none() {
            return Err(IoPinError::NoPins { gtag, unit });
        }
        for (pin, descriptor) in pins.filter(|&(_, descriptor)| wanted(*descriptor)) {
            let place = self.take(pin)?;
            if descriptor.is_output()
                && let Some(port) = self.ports.get_mut(place.port as usize)
            {
                port.direction |= place.mask();
                port.alternate_source |= place.mask();
            }
        }
        Ok(())
    }

    /// Uses a pin as plain I/O.
    pub fn use_gpio(&mut self, pin: u16, setup: GpioSetup) -> Result<PinPlace, IoPinError> {
        let place = self.take(pin)?;
        if let Some(port) = self.ports.get_mut(place.port as usize) {
            port.data = place.put(port.data, setup.level);
            port.direction = place.put(port.direction, setup.output);
            port.open_drain = place.put(port.open_drain, setup.open_drain);
            port.invert = place.put(port.invert, setup.invert);
        }
        Ok(place)
    }

    /// Whether a module uses the pin, or it was said how it is used as plain I/O.
    pub fn is_taken(&self, pin: u16) -> bool {
        self.taken.get(usize::from(pin)).copied().unwrap_or(false)
    }

    fn take(&mut self, pin: u16) -> Result<PinPlace, IoPinError> {
        let pins = self.places.pins;
        let missing = IoPinError::NoSuchPin { pin, pins };
        let place = self.places.place(pin).ok_or(missing)?;
        let taken = self.taken.get_mut(pin as usize).ok_or(missing)?;
        if core::mem::replace(taken, true) {
            return Err(IoPinError::InUse { pin });
        }
        Ok(place)
    }
}
