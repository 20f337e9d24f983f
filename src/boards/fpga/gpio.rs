//! Pins of the FPGA as plain inputs and outputs.

use alloc::format;
use alloc::vec::Vec;

use super::Maker;
use crate::boards::Terminal;
use crate::hal::{GroupId, Input, Output, Param, PinError, PinStore, Pins};
use crate::hostmot2::{GpioSetup, PinDescriptor};

/// Who uses an I/O pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PinUse {
    /// The application: a full GPIO.
    Gpio,
    /// A module reads it.
    ModuleInput,
    /// A module drives it.
    ModuleOutput,
}

impl PinUse {
    /// By the pin's descriptor, if all modules are in use.
    pub fn of(descriptor: &PinDescriptor) -> Self {
        if !descriptor.has_module() {
            Self::Gpio
        } else if descriptor.is_output() {
            Self::ModuleOutput
        } else {
            Self::ModuleInput
        }
    }
}

/// The pins and parameters of one I/O pin: `hm2_7i92.0.gpio.000.in` and so on.
///
/// What there is depends on who uses it: see [`PinUse`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpioPins {
    /// The level, and its opposite; not of a pin that a module drives.
    pub input: Option<(Input<bool>, Input<bool>)>,
    /// The level to drive; of a full GPIO only.
    pub out: Option<Output<bool>>,
    /// Whether it is driven; of a full GPIO only.
    pub is_output: Option<Param<bool>>,
    /// Turns an output round; not of a pin that a module reads.
    pub invert_output: Option<Param<bool>>,
    /// Drives low only; not of a pin that a module reads.
    pub is_opendrain: Option<Param<bool>>,
}

impl GpioPins {
    /// Makes the pins of I/O pin `number`.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        number: usize,
        usage: PinUse,
        terminals: &[Terminal],
    ) -> Result<Self, PinError> {
        let stem = format!("{board}.gpio.{number:03}.");
        let mut make = Maker::new(pins, group, stem).at(terminals);
        let full = usage == PinUse::Gpio;
        let driven = usage != PinUse::ModuleInput;
        let input = (usage != PinUse::ModuleOutput)
            .then(|| Ok::<_, PinError>((make.input("in")?, make.input("in_not")?)))
            .transpose()?;
        let invert_output = driven
            .then(|| make.setting("invert_output", false))
            .transpose()?;
        let is_opendrain = driven
            .then(|| make.setting("is_opendrain", false))
            .transpose()?;
        let out = full.then(|| make.output("out")).transpose()?;
        let is_output = full.then(|| make.setting("is_output", false)).transpose()?;
        Ok(Self {
            input,
            out,
            is_output,
            invert_output,
            is_opendrain,
        })
    }

    /// Makes the pins of all I/O pins of a board, by their descriptors.
    pub fn all(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        descriptors: &[PinDescriptor],
        terminals: fn(usize) -> &'static [Terminal],
    ) -> Result<Vec<Self>, PinError> {
        descriptors
            .iter()
            .enumerate()
            .map(|(number, descriptor)| {
                let usage = PinUse::of(descriptor);
                Self::new(pins, group, board, number, usage, terminals(number))
            })
            .collect()
    }

    /// Publishes the level of the pin.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn publish(&self, pins: &mut PinStore, level: bool) {
        if let Some((input, not)) = self.input {
            pins.publish(input, level);
            pins.publish(not, !level);
        }
    }

    /// The level to drive; low for what is no output. The hardware inverts, if it is to.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn level(&self, pins: &mut PinStore) -> bool {
        self.out.is_some_and(|out| pins.fetch(out))
    }

    /// How the pin is to be set up, by its parameters; `None` for one that a module uses.
    pub fn setup(&self, pins: &Pins) -> Option<GpioSetup> {
        let flag = |param: Option<Param<bool>>| param.is_some_and(|param| pins.param(param));
        let out = self.out?;
        Some(GpioSetup {
            level: pins.commanded(out),
            output: flag(self.is_output),
            open_drain: flag(self.is_opendrain),
            invert: flag(self.invert_output),
        })
    }
}
