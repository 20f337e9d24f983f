//! What goes wrong when a board is configured, and in the cycle.

use alloc::boxed::Box;
use alloc::format;
use alloc::string::String;
use core::time::Duration;

use super::{BoardState, Remark};
use crate::Rounded;
use crate::boards::AttachError;
use crate::bus::{BusError, BusErrorKind};
use crate::hostmot2::{IdentifyError, RemoteId};
use crate::modules::RegisterError;
use crate::modules::serial::WATCHDOG_PARAMETER;
use crate::remote::ParameterError;
use crate::sslbp::PortError;

/// Why a board was not configured or started, or a parameter of a remote not read or written.
///
/// If a start fails, everything that was started is stopped again.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DriverError<E: BusError> {
    /// The bus failed.
    #[error(transparent)]
    Bus(E),
    /// The firmware is not one that this crate knows.
    #[error(transparent)]
    Identify(#[from] IdentifyError<E>),
    /// A module can not be used.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// A serial port does not obey.
    #[error(transparent)]
    Port(PortError<E>),
    /// The board was reset, or lost its power, in the middle of the start. It drives nothing.
    #[error(
        "the board was reset, or lost power, while {during}, and drives nothing: check its supply, and that no other program drives it; then start again"
    )]
    Unsteady {
        /// What was done then.
        during: &'static str,
    },
    /// A serial port was configured that the firmware does not have.
    #[error(
        "there is no serial port {port}: this firmware has {ports}; leave its configuration out"
    )]
    NoSuchPort {
        /// The port.
        port: u8,
        /// How many there are.
        ports: u8,
    },
    /// A remote that is needed does not take part.
    #[error("{0}")]
    Missing(Remark),
    /// There are no handles of a board or a remote, or no remote takes part there.
    #[error(transparent)]
    Attach(#[from] AttachError),
    /// A parameter of a remote was not read or written.
    #[error("{remote}, parameter {name}: {source}")]
    Parameter {
        /// The remote.
        remote: RemoteId,
        /// The parameter, as it was asked for.
        name: Box<str>,
        /// Why.
        source: ParameterError<PortError<E>>,
    },
    /// Something was added when the board was set up already.
    #[error("modules are added before `discover`, which sets the board up; add them first")]
    AddedLate,
    /// The board was asked to pace the cycle, and can not.
    #[error("the board can not pace the cycle: {why}; let the host pace it (`Pace::Host`)")]
    NotPaced {
        /// What is missing.
        why: &'static str,
    },
    /// No cycle has this period.
    #[error(
        "a period of {} can not be kept: choose one of 1 us to 800 ms",
        Rounded(.period)
    )]
    BadPeriod {
        /// The period.
        period: Duration,
    },
    /// The period can not feed a watchdog.
    #[error(
        "{of} bites after {}, and is fed once in a period of {}; a write or transfer that is lost must \
         not let it bite, so it needs 2 x {} = {}: choose a longer time for it, or a shorter period",
        Rounded(.watchdog),
        Rounded(.period),
        Rounded(.period),
        Rounded(.needed)
    )]
    WatchdogTooShort {
        /// Which watchdog, and what sets it.
        of: Box<str>,
        /// Its time. Of a remote that does not say it, 50 ms.
        watchdog: Duration,
        /// What it must be at least.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// A cycle is shorter than the transfers it must hold.
    #[error(
        "port {port} needs up to {} for a transfer, and the period is {}: choose a longer period, or \
         spread the remotes over several ports",
        Rounded(.needed),
        Rounded(.period)
    )]
    PeriodTooShort {
        /// The port.
        port: u8,
        /// What a transfer takes when all is well.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// The board did not confirm that its outputs are off, so that its watchdog was not given the time
    /// that the call needs. Everything is safe until it is re-armed.
    #[error(
        "the board does not confirm that its outputs are off, because writes are lost; nothing else was \
         done, and everything is safe until re-armed: look at its link, then try again"
    )]
    NotConfirmed,
    /// The board is not set up, so that its serial lines are no lines.
    #[error("{state}, and no remote can be reached: call `rearm` first")]
    NotRunning {
        /// What it is.
        state: BoardState,
    },
}

/// How often a watchdog must be fed within its time: a write, or a transfer, may be lost.
const WATCHDOG_FEEDS: u32 = 2;

/// Names the watchdog of a remote, and what sets it.
pub(super) fn remote_watchdog(remote: RemoteId) -> String {
    format!("{remote}: the remote's watchdog ({WATCHDOG_PARAMETER} in ms)")
}

impl<E: BusError> DriverError<E> {
    /// Refuses a watchdog that the period can not feed.
    pub(super) fn check_watchdog(
        of: &str,
        watchdog: Duration,
        period: Duration,
    ) -> Result<(), Self> {
        let needed = period.saturating_mul(WATCHDOG_FEEDS);
        if watchdog >= needed {
            return Ok(());
        }
        Err(Self::WatchdogTooShort {
            of: of.into(),
            watchdog,
            needed,
            period,
        })
    }

    pub(crate) fn no_remote(remote: RemoteId) -> Self {
        Self::Attach(AttachError::NoRemote {
            remote,
            expected: "remote",
        })
    }
}

impl<E: BusError> From<PortError<E>> for DriverError<E> {
    fn from(error: PortError<E>) -> Self {
        match error {
            PortError::Bus(error) => Self::Bus(error),
            error => Self::Port(error),
        }
    }
}

/// Why a cycle brought nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CycleError<E: BusError> {
    /// The read failed: no input was taken.
    #[error("read, failure {consecutive} in a row: {source}")]
    Read {
        /// What the bus says.
        source: E,
        /// How many reads in a row have failed, this one included.
        consecutive: u32,
    },
    /// The write failed, or may have.
    #[error("write, failure {consecutive} in a row: {source}")]
    Write {
        /// What the bus says.
        source: E,
        /// How many writes in a row have failed, this one included.
        consecutive: u32,
    },
    /// What was read is not from a HostMot2 board: no input was taken.
    #[error(
        "address 0x0100 reads {found:#010X}, expected 0x55AACAFE (failure {consecutive} in a row): \
         the board has lost its firmware or its power"
    )]
    NotThere {
        /// What is there.
        found: u32,
        /// How many reads in a row have failed, this one included.
        consecutive: u32,
    },
    /// Another board, or another firmware, answers than the driver was started with. It did not get
    /// this driver's set-up.
    #[error(
        "another board, or another firmware, answers than this driver was started with, and gets none of its set-up: stop the driver and start it anew"
    )]
    OtherFirmware,
}

impl<E: BusError> CycleError<E> {
    /// What the bus says; of a board that is not there or another one, that it is the device's error.
    pub fn kind(&self) -> BusErrorKind {
        match self {
            Self::Read { source, .. } | Self::Write { source, .. } => source.kind(),
            Self::NotThere { .. } | Self::OtherFirmware => BusErrorKind::Device,
        }
    }
}
