//! Errors of a firmware, and of requests that it cannot fulfil.

use super::Gtag;
use crate::advice::{self, Advice, MesaError};
use crate::bus::BusError;
use alloc::string::String;
use thiserror::Error;

/// Reason why a firmware cannot be used, or not as requested.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum HostMot2Error {
    /// The cookie is missing.
    #[error("no HostMot2 cookie at 0x0100: read {found:#010X}, expected 0x55AACAFE")]
    NoCookie {
        /// Value read instead.
        found: u32,
    },
    /// The firmware's description of itself contains an impossible value.
    #[error("{what}: {found}, expected {expected}")]
    Description {
        /// Item of the description.
        what: String,
        /// Value read.
        found: String,
        /// Possible values.
        expected: &'static str,
    },
    /// The firmware does not contain a module.
    #[error("this firmware has no {wanted}; it has {present}")]
    Missing {
        /// The requested module.
        wanted: Gtag,
        /// The modules that are present: see [`HostMot2::gtags`](super::HostMot2::gtags).
        present: String,
    },
    /// A module has a version or registers that this crate does not support.
    #[error("{gtag} has {found}, expected {expected}")]
    Unknown {
        /// The module.
        gtag: Gtag,
        /// Its actual version or registers.
        found: String,
        /// The supported ones.
        expected: String,
    },
    /// A module does not have a register or an instance.
    #[error(
        "register {register} of {gtag} {instance} does not exist: this firmware has {registers} \
         registers and {instances} instances, counted from 0"
    )]
    NoRegister {
        /// The module.
        gtag: Gtag,
        /// The requested register.
        register: u8,
        /// The requested instance.
        instance: u8,
        /// Number of registers.
        registers: u8,
        /// Number of instances.
        instances: u8,
    },
    /// The I/O pin does not exist, or is in use.
    #[error("I/O pin {pin} {why}")]
    IoPin {
        /// The pin.
        pin: u16,
        /// Reason why it cannot be used.
        why: String,
    },
    /// The module has no I/O pins.
    #[error("{gtag} {unit} has no pins in this firmware")]
    NoPins {
        /// The module.
        gtag: Gtag,
        /// The instance.
        unit: u8,
    },
}

impl MesaError for HostMot2Error {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::NoCookie { .. } => advice::CHECK_BOARD_FIRMWARE,
            Self::Description { .. } => advice::CHECK_BYTE_ORDER,
            Self::Missing { .. } => advice::LOAD_MATCHING_FIRMWARE,
            Self::Unknown { .. } => advice::USE_KNOWN_FIRMWARE,
            Self::NoRegister { .. } => advice::CHOOSE_EXISTING,
            Self::IoPin { .. } => advice::CHOOSE_OTHER_PIN,
            Self::NoPins { .. } => advice::CHOOSE_OTHER_INSTANCE,
        })
    }
}

impl HostMot2Error {
    pub(super) fn description(what: &str, found: String, expected: &'static str) -> Self {
        let what = what.into();
        Self::Description {
            what,
            found,
            expected,
        }
    }
}

/// Reason why no firmware was identified.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// The bus failed.
    #[error("reading {count} registers of the firmware's description at {address:#06X} failed")]
    Bus {
        /// Address of the first register.
        address: u16,
        /// Number of registers.
        count: u16,
        /// The bus error.
        #[source]
        source: BusError,
    },
    /// The board has no HostMot2 firmware, or one that cannot be used.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
}

impl MesaError for IdentifyError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Bus { source, .. } => source.advice(),
            Self::Firmware(error) => error.advice(),
        }
    }
}
