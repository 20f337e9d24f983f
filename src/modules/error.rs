//! Why a module can not be used.

use crate::bus::ImageError;
use crate::hal::PinError;
use crate::hostmot2::HostMot2Error;

/// Why a module was not registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// The firmware does not have it, or has one that is not known, or an I/O pin can not be used as
    /// asked for.
    #[error(transparent)]
    Firmware(#[from] HostMot2Error),
    /// A pin can not be made.
    #[error("a pin of the board: {0}")]
    Pin(#[from] PinError),
    /// A register can not be part of a cycle.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A register was not read.
    #[error("register {address:#06X} was not read, because the bus failed")]
    Peek {
        /// The register.
        address: u16,
    },
    /// More encoders were asked for than the firmware has.
    #[error(
        "{count} encoders were asked for, and this firmware has {all}; ask for at most {all} \
         (`EncoderSetup::count`), or load a firmware that has more"
    )]
    TooManyEncoders {
        /// How many were asked for.
        count: u8,
        /// How many there are.
        all: u8,
    },
    /// The rate of the thread is out of reach of the phase-locked loop, or its DDS is not known.
    #[error(
        "the DPLL can not follow {hz} Hz: with a clock of {clock_hz} Hz and a DDS of {dds_bits} bits \
         (1 to 63), prescale {prescale} (1 to 255) and base rate {base_rate} (1 to 2^32-1) would be \
         needed; choose another thread period, or go on without it (`Settings::no_dpll`)"
    )]
    DpllRate {
        /// What was asked for.
        hz: f64,
        /// The clock.
        clock_hz: u32,
        /// Size of the DDS, as the DPLL reports it.
        dds_bits: u8,
        /// The prescale that would be needed.
        prescale: f64,
        /// The base rate that would be needed.
        base_rate: f64,
    },
}
