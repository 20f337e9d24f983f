//! The modules that the driver has built in. A new one is one line here, besides its own file.

use super::dpll::{self, Dpll};
use super::encoder::{self, Encoders};
use super::in_mux::{self, InMux};
use super::led::{self, Leds};
use super::outputs::{self, Outputs};
use super::pwm::{self, Pwm};
use super::stepgen::{self, Stepgens};
use super::{RegisterError, Registrar};
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor};
use crate::sslbp::PortLayout;

/// A kind of module that is built in.
#[derive(Debug)]
pub(crate) struct BuiltIn {
    gtags: &'static [Gtag],
    /// Checks version and layout of a module.
    check: CheckFn,
    /// Registers all modules of the kind; `None` for those that the driver itself needs, and
    /// registers at their place.
    pub register: Option<RegisterFn>,
    /// A board has a single module of the kind.
    is_single: bool,
}

/// All kinds, in the order in which they are registered.
pub(crate) const BUILT_IN: [BuiltIn; 11] = [
    single(&[Gtag::WATCHDOG], any, None),
    single(&[Gtag::IO_PORT], any, None),
    single(&[Gtag::HM2DPLL], dpll::check, Some(Dpll::register)),
    several(
        &[Gtag::ENCODER, Gtag::MUXED_ENCODER],
        encoder::check,
        Some(Encoders::register),
    ),
    several(&[Gtag::MUX_SELECT], any, None),
    several(&[Gtag::PWM], pwm::check, Some(Pwm::register)),
    several(&[Gtag::STEPGEN], stepgen::check, Some(Stepgens::register)),
    several(
        &[Gtag::IN_MUX, Gtag::IN_M],
        in_mux::check,
        Some(InMux::register),
    ),
    several(
        &[Gtag::SSR, Gtag::OUT_M],
        outputs::check,
        Some(Outputs::register),
    ),
    single(&[Gtag::LED], led::check, Some(Leds::register)),
    several(&[Gtag::SSERIAL, Gtag::SSERIAL_B], serial, None),
];

/// Why a module is not driven.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum NotDriven {
    /// No built-in module is of this kind.
    Unsupported,
    /// The version, or the register layout, is unknown.
    Unknown(HostMot2Error),
}

/// Checks that kind, version and layout of a module are supported.
pub(crate) fn check(module: &ModuleDescriptor) -> Result<(), NotDriven> {
    let kind = find(module.gtag).ok_or(NotDriven::Unsupported)?;
    (kind.check)(module).map_err(NotDriven::Unknown)
}

/// True if a board has a single module of the kind.
pub(crate) fn is_single(gtag: Gtag) -> bool {
    find(gtag).is_some_and(|kind| kind.is_single)
}

fn find(gtag: Gtag) -> Option<&'static BuiltIn> {
    BUILT_IN.iter().find(|kind| kind.gtags.contains(&gtag))
}

type CheckFn = fn(&ModuleDescriptor) -> Result<(), HostMot2Error>;
type RegisterFn = fn(&mut Registrar<'_>) -> Result<(), RegisterError>;

const fn single(gtags: &'static [Gtag], check: CheckFn, register: Option<RegisterFn>) -> BuiltIn {
    BuiltIn {
        gtags,
        check,
        register,
        is_single: true,
    }
}

const fn several(gtags: &'static [Gtag], check: CheckFn, register: Option<RegisterFn>) -> BuiltIn {
    BuiltIn {
        gtags,
        check,
        register,
        is_single: false,
    }
}

/// Every version: without these modules a board is not driven at all.
#[expect(clippy::unnecessary_wraps, reason = "as the other checks")]
const fn any(_: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    Ok(())
}

fn serial(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    PortLayout::new(module, 0, 1).map(drop)
}
