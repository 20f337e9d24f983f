//! What can be wrong with a firmware.

use super::{Gtag, GtagList, ModuleError, Name8};
use core::fmt;
use thiserror::Error;

/// Why no HostMot2 firmware was found, or why it can not be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
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
    /// The cookie is not there.
    #[error(
        "no HostMot2 cookie at 0x0100: read {found:#010X}, expected 0x55AACAFE; is this the right \
         address, and the right board?"
    )]
    NoCookie {
        /// What was read.
        found: u32,
    },
    /// The configuration name is not HOSTMOT2.
    #[error(
        "configuration name at 0x0104 is {found:?}, expected \"HOSTMOT2\": this is not a HostMot2 \
         firmware, or the bus swaps bytes"
    )]
    WrongName {
        /// What was read.
        found: Name8,
    },
    /// The IDROM does not lie in the address space.
    #[error(
        "the {part} at {address:#X} with {words} words lie outside of the 16-bit address space, or \
         not at a multiple of 4: the IDROM was misread, or is not right"
    )]
    OutsideAddressSpace {
        /// What does not fit.
        part: IdromPart,
        /// Its address, as computed.
        address: u64,
        /// Its size in words.
        words: u32,
    },
    /// The IDROM is of a type that is not known.
    #[error("IDROM type {found}, expected 3 or 2: this firmware is older or newer than this crate")]
    UnknownIdromType {
        /// The type.
        found: u32,
    },
    /// The widths do not fit together.
    #[error(
        "{ports} ports of {port_width} pins do not make {io_width} pins, or there are none or more \
         than 32 for a port or 256 in all: the IDROM was misread, or is not right"
    )]
    Widths {
        /// Number of ports.
        ports: u32,
        /// Pins of a port.
        port_width: u32,
        /// Pins of all ports.
        io_width: u32,
    },
    /// A clock is too slow to be true.
    #[error(
        "{clock} is {hz} Hz, expected at least 1 MHz: the IDROM was misread, or is not right",
        clock = if *.low { "ClockLow" } else { "ClockHigh" }
    )]
    Clock {
        /// ClockLow, else ClockHigh.
        low: bool,
        /// Its frequency in Hz.
        hz: u32,
    },
    /// A stride of the IDROM does not fit into the address space.
    #[error("a stride of {found:#X} bytes in the IDROM: it was misread, or is not right")]
    Stride {
        /// The stride.
        found: u32,
    },
    /// A module names a clock that is none.
    #[error(
        "module descriptor {index}, {gtag}, has clock tag {found}, expected 1 (ClockLow) or 2 \
         (ClockHigh): the IDROM was misread, or is not right"
    )]
    ClockTag {
        /// Number of the descriptor, from 0 on.
        index: u8,
        /// The module.
        gtag: Gtag,
        /// The clock tag.
        found: u8,
    },
    /// A module names strides that the IDROM does not have.
    #[error(
        "module descriptor {index}, {gtag}, chooses register stride {register} and instance stride \
         {instance}, the IDROM has 0 and 1: it was misread, or is not right"
    )]
    StrideChoice {
        /// Number of the descriptor, from 0 on.
        index: u8,
        /// The module.
        gtag: Gtag,
        /// The choice of the register stride.
        register: u8,
        /// The choice of the instance stride.
        instance: u8,
    },
    /// Registers of a module lie outside of the address space.
    #[error(
        "module descriptor {index}, {gtag}, has registers outside of the 16-bit address space, or \
         not at multiples of 4: base {base:#06X}, {registers} registers, {instances} instances; the \
         IDROM was misread, or is not right"
    )]
    ModuleOutsideAddressSpace {
        /// Number of the descriptor, from 0 on.
        index: u8,
        /// The module.
        gtag: Gtag,
        /// Its base address.
        base: u16,
        /// Its registers.
        registers: u8,
        /// Its instances.
        instances: u8,
    },
}

/// A part of the firmware's description.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum IdromPart {
    /// The header.
    Header,
    /// The module descriptors.
    Modules,
    /// The pin descriptors.
    Pins,
}

impl fmt::Display for IdromPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Header => "IDROM header words",
            Self::Modules => "module descriptors",
            Self::Pins => "pin descriptors",
        })
    }
}

/// A module that was asked for and that the firmware does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "this firmware has no {wanted}; it has {present}; load a firmware for the boards that are \
     connected"
)]
pub struct MissingModule {
    /// What was asked for.
    pub wanted: Gtag,
    /// What is there.
    pub present: GtagList,
}

/// Why a module could not be located.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LocateError {
    /// The firmware does not have it.
    #[error(transparent)]
    Missing(#[from] MissingModule),
    /// It is there and can not be used.
    #[error(transparent)]
    Module(#[from] ModuleError),
}

/// Something odd in a firmware's description that does not keep it from being used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Warning {
    /// The number of I/O port instances is not the number of ports.
    PortInstances {
        /// Ports according to the IDROM.
        ports: u32,
        /// Instances according to the module descriptor.
        instances: u8,
    },
    /// There are two descriptors for a kind of module; the first is used.
    DuplicateModule {
        /// The module.
        gtag: Gtag,
    },
    /// A descriptor has no instances.
    NoInstances {
        /// The module.
        gtag: Gtag,
    },
    /// A module has a version that real clients complain about, or do not know.
    Version {
        /// The module.
        gtag: Gtag,
        /// Its version.
        version: u8,
    },
    /// A pin is not a pin of an I/O port.
    PrimaryTag {
        /// Number of the pin.
        pin: u16,
        /// What it says that it is.
        found: Gtag,
    },
    /// A pin belongs to a module that there is no descriptor of.
    PinWithoutModule {
        /// Number of the pin.
        pin: u16,
        /// The module.
        gtag: Gtag,
    },
    /// The strides are not the usual ones (FACTS 9.1).
    Strides,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PortInstances { ports, instances } => write!(
                f,
                "the IDROM has {ports} I/O ports, the module descriptor {instances}"
            ),
            Self::DuplicateModule { gtag } => {
                write!(f, "{gtag} has two descriptors; the first is used")
            }
            Self::NoInstances { gtag } => write!(f, "{gtag} has no instances"),
            Self::Version { gtag, version } => {
                write!(
                    f,
                    "{gtag} has version {version}, which is not known to work"
                )
            }
            Self::PrimaryTag { pin, found } => {
                write!(f, "pin {pin} is a pin of {found}, expected an I/O port")
            }
            Self::PinWithoutModule { pin, gtag } => {
                write!(f, "pin {pin} belongs to {gtag}, which has no descriptor")
            }
            Self::Strides => f.write_str("strides are not 4/0x40 and 0x100/0x100"),
        }
    }
}
