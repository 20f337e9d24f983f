//! The modules of the FPGA in the cycle.

mod dpll;
mod encoder;
mod gpio;
mod in_mux;
mod led;
mod outputs;
mod phase_start;
mod pwm;
mod wiring;

pub use encoder::EncoderSetup;
pub use gpio::GpioConfig;
pub(super) use gpio::GpioModule;
use wiring::Wiring;

use alloc::{boxed::Box, vec::Vec};
use core::time::Duration;

use super::{BuildError, Module, Pace};
use crate::boards::fpga::FpgaPins;
use crate::bus::{BusError, RegisterBus};
use crate::hal::{GroupId, PinError, PinStore};
use crate::hostmot2::{DpllError, HostMot2, IoPinError, LocateError, ModuleError};
use crate::hostmot2::{MissingModule, PortPlan};

use dpll::DpllModule;
use encoder::EncoderModule;
use in_mux::InMuxModule;
use led::LedModule;
use outputs::OutputModule;
use pwm::PwmModule;

/// What modules are made from, and what they leave for others.
#[derive(Debug)]
pub(super) struct Making<'a> {
    pub firmware: &'a HostMot2,
    /// Who drives which I/O pin.
    pub plan: &'a mut PortPlan,
    pub pins: &'a mut PinStore,
    /// The group of the board's own I/O.
    pub group: GroupId,
    /// What names begin with.
    pub board: &'a str,
    /// The handles of all pins.
    pub made: &'a mut FpgaPins,
}

/// What can be chosen of modules.
#[derive(Clone, Debug, Default)]
pub(super) struct ModuleChoices {
    pub encoders: EncoderSetup,
    /// `None` for what the board is made for.
    pub pwm_hz: Option<u32>,
    /// Leave the phase-locked loop alone.
    pub no_dpll: bool,
    /// Whether the phase-locked loop follows the reads, or they follow it.
    pub pace: Pace,
}

/// Every module that the firmware has and this crate knows, but for serial ports and I/O pins.
pub(super) fn build_modules<B: RegisterBus>(
    making: &mut Making<'_>,
    bus: &mut B,
    choices: &ModuleChoices,
    period: Duration,
) -> Result<Vec<Box<dyn Module>>, BuildError<B::Error>> {
    let mut modules: Vec<Box<dyn Module>> = Vec::new();
    let mut dpll = None;
    if !choices.no_dpll {
        dpll = DpllModule::build(making, bus, period, choices.pace)?;
    }
    if choices.pace == Pace::Board && dpll.is_none() {
        return Err(BuildError::NoPace);
    }
    add(&mut modules, dpll);
    add(
        &mut modules,
        EncoderModule::build(making, &choices.encoders)?,
    );
    add(&mut modules, PwmModule::build(making, choices.pwm_hz)?);
    add(&mut modules, InMuxModule::build_all(making, bus)?);
    add(&mut modules, OutputModule::build_all(making)?);
    add(&mut modules, LedModule::build(making)?);
    Ok(modules)
}

fn add<M: Module + 'static>(modules: &mut Vec<Box<dyn Module>>, more: impl IntoIterator<Item = M>) {
    for module in more {
        modules.push(Box::new(module));
    }
}

/// Why a module can not be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(super) enum PartError {
    #[error(transparent)]
    Locate(#[from] LocateError),
    #[error(transparent)]
    Io(#[from] IoPinError),
    #[error(transparent)]
    Pin(#[from] PinError),
    #[error("{count} encoders were asked for, and this firmware has {all}")]
    TooManyEncoders { count: u8, all: u8 },
}

impl From<ModuleError> for PartError {
    fn from(error: ModuleError) -> Self {
        Self::Locate(error.into())
    }
}

impl From<MissingModule> for PartError {
    fn from(error: MissingModule) -> Self {
        Self::Locate(error.into())
    }
}

/// The same of a module that has to ask the board something.
#[derive(Debug, thiserror::Error)]
pub(super) enum PartBuildError<E: BusError> {
    #[error(transparent)]
    Part(#[from] PartError),
    #[error(transparent)]
    Dpll(#[from] DpllError<E>),
    #[error(transparent)]
    Bus(E),
}

impl<E: BusError> From<PartError> for BuildError<E> {
    fn from(error: PartError) -> Self {
        match error {
            PartError::Locate(error) => error.into(),
            PartError::Io(error) => error.into(),
            PartError::Pin(error) => error.into(),
            PartError::TooManyEncoders { count, all } => Self::TooManyEncoders { count, all },
        }
    }
}

impl<E: BusError> From<PartBuildError<E>> for BuildError<E> {
    fn from(error: PartBuildError<E>) -> Self {
        match error {
            PartBuildError::Part(error) => error.into(),
            PartBuildError::Dpll(error) => Self::Dpll(error),
            PartBuildError::Bus(error) => Self::Bus(error),
        }
    }
}
