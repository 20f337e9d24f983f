//! What can be wrong with a firmware, and with what is asked of it.

use super::Gtag;
use alloc::string::String;
use thiserror::Error;

/// Why a firmware can not be used, or not as asked for.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum HostMot2Error {
    /// The cookie is not there.
    #[error(
        "no HostMot2 cookie at 0x0100: read {found:#010X}, expected 0x55AACAFE; is this the right \
         address, and the right board?"
    )]
    NoCookie {
        /// What was read.
        found: u32,
    },
    /// The firmware's description of itself holds what can not be.
    #[error(
        "{what}: {found}, expected {expected}; the firmware's description was misread (does the bus \
         swap bytes?), or this firmware is older or newer than this crate"
    )]
    Description {
        /// What of it.
        what: String,
        /// What was read.
        found: String,
        /// What it can be.
        expected: &'static str,
    },
    /// The firmware does not have a module.
    #[error(
        "this firmware has no {wanted}; it has {present}; load a firmware for the boards that are \
         connected"
    )]
    Missing {
        /// What was asked for.
        wanted: Gtag,
        /// What is there: see [`HostMot2::gtags`](super::HostMot2::gtags).
        present: String,
    },
    /// A module is of a version, or has registers, that this crate does not know.
    #[error("{gtag} has {found}, known is {expected}: use a firmware with a module that is known")]
    Unknown {
        /// The module.
        gtag: Gtag,
        /// What it has.
        found: String,
        /// What is known.
        expected: String,
    },
    /// A module does not have a register or an instance.
    #[error(
        "there is no register {register} of {gtag} {instance}: this firmware has {registers} \
         registers and {instances} instances, counted from 0; ask for one of these"
    )]
    NoRegister {
        /// The module.
        gtag: Gtag,
        /// The register that was asked for.
        register: u8,
        /// The instance that was asked for.
        instance: u8,
        /// Number of registers.
        registers: u8,
        /// Number of instances.
        instances: u8,
    },
    /// The I/O pin is not there, or is in use.
    #[error("I/O pin {pin} {why}")]
    IoPin {
        /// The pin.
        pin: u16,
        /// Why it can not be used, and what to do.
        why: String,
    },
    /// The module has no I/O pins.
    #[error("{gtag} {unit} has no pins in this firmware: choose another instance or firmware")]
    NoPins {
        /// The module.
        gtag: Gtag,
        /// The instance.
        unit: u8,
    },
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

/// Why no firmware was identified.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IdentifyError<E: core::error::Error + 'static> {
    /// The bus failed.
    #[error("reading {count} registers of the firmware's description at {address:#06X} failed")]
    Bus {
        /// Address of the first register.
        address: u16,
        /// Number of registers.
        count: u16,
        /// What the bus says.
        #[source]
        source: E,
    },
    /// There is none, or one that can not be used.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
}
