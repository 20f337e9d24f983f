//! Errors of configuring a board, and of the cycle.

use alloc::boxed::Box;
use alloc::format;
use alloc::string::String;
use core::time::Duration;

use super::{BoardState, Remark};
use crate::Rounded;
use crate::advice::{self, Advice, MesaError};
use crate::boards::AttachError;
use crate::bus::{BusError, BusErrorKind};
use crate::hostmot2::{IdentifyError, RemoteId};
use crate::modules::RegisterError;
use crate::modules::serial::WATCHDOG_PARAMETER;
use crate::remote::ParameterError;
use crate::sslbp::{PortError, RemoteLabel};

/// Error of configuring or starting a board, or of reading or writing a parameter of a remote.
///
/// If a start fails, everything that was started is stopped again.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DriverError {
    /// The bus failed.
    #[error(transparent)]
    Bus(BusError),
    /// This crate does not support the firmware.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A module cannot be used.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// A serial port does not execute commands.
    #[error(transparent)]
    Port(PortError),
    /// The board was reset, or lost its power, during the start. It drives nothing.
    #[error("the board was reset or lost power while {during}: it drives nothing")]
    Unsteady {
        /// The step of the start.
        during: &'static str,
    },
    /// A serial port was configured that the firmware does not have.
    #[error("serial port {port} does not exist: this firmware has {ports}")]
    NoSuchPort {
        /// The port.
        port: u8,
        /// Number of ports.
        ports: u8,
    },
    /// A required remote does not take part.
    #[error("{0}")]
    Missing(Remark),
    /// Handles do not exist for a board or a remote, or no remote takes part there.
    #[error(transparent)]
    Attach(#[from] AttachError),
    /// A parameter of a remote was not read or written.
    #[error("{remote}, parameter {name}: {source}")]
    Parameter {
        /// The remote.
        remote: RemoteLabel,
        /// The requested name of the parameter.
        name: Box<str>,
        /// The reason.
        source: ParameterError,
    },
    /// The board should pace the cycle, and cannot.
    #[error("the board cannot pace the cycle: {why}")]
    NotPaced {
        /// The missing function.
        why: &'static str,
    },
    /// The period is out of range.
    #[error("a period of {} cannot be kept", Rounded(.period))]
    BadPeriod {
        /// The period.
        period: Duration,
    },
    /// The period cannot be changed any more.
    #[error(
        "the period can be changed before the first write only, and only where the host paces the cycle"
    )]
    PeriodInUse,
    /// The period is too long to feed a watchdog.
    #[error(
        "{of} bites after {}, and is fed once in a period of {}; a write or transfer that is lost must \
         not let it bite, so it needs 2 x {} = {}",
        Rounded(.watchdog),
        Rounded(.period),
        Rounded(.period),
        Rounded(.needed)
    )]
    WatchdogTooShort {
        /// Name of the watchdog, and of its setting.
        of: Box<str>,
        /// The remote that has the watchdog; `None` for the board's.
        remote: Option<RemoteLabel>,
        /// The time of the watchdog; 50 ms for a remote without a known time.
        watchdog: Duration,
        /// The least time that the period requires.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// The period is shorter than the transfers in it.
    #[error(
        "port {port}: a transfer takes up to {}, and the period is {}",
        Rounded(.needed),
        Rounded(.period)
    )]
    PeriodTooShort {
        /// The port.
        port: u8,
        /// The usual duration of a transfer.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// The board did not confirm that its outputs are off, so that its watchdog was not set to the
    /// time that the call needs. Everything is safe until it is re-armed.
    #[error(
        "the board does not confirm that its outputs are off, because writes are lost: all outputs stay \
         off until re-armed, and nothing else was done"
    )]
    NotConfirmed,
    /// A remote did not answer after it had been left without process data, so that nothing is
    /// known of its watchdog. Everything is safe until it is re-armed.
    #[error(
        "{remote}: no reply after a time without process data, so that its watchdog is not known to \
         have bitten: all outputs stay off until re-armed"
    )]
    NotHeard {
        /// The remote.
        remote: RemoteLabel,
    },
    /// The board is not set up, so that its serial lines are not connected.
    #[error("{state}: no remote can be reached")]
    NotRunning {
        /// The state of the board.
        state: BoardState,
    },
}

/// Number of times that a watchdog must be fed within its time: a write, or a transfer, may be
/// lost.
const WATCHDOG_FEEDS: u32 = 2;

/// Returns the name of a watchdog, and of its parameter.
fn watchdog_name(remote: Option<RemoteLabel>) -> String {
    match remote {
        Some(remote) => format!("{remote}: the remote's watchdog ({WATCHDOG_PARAMETER} in ms)"),
        None => "the board's watchdog".into(),
    }
}

impl DriverError {
    /// Refuses a watchdog of a remote or of the board that is too short for the period.
    pub(super) fn check_watchdog(
        remote: Option<RemoteLabel>,
        watchdog: Duration,
        period: Duration,
    ) -> Result<(), Self> {
        let needed = period.saturating_mul(WATCHDOG_FEEDS);
        if watchdog >= needed {
            return Ok(());
        }
        Err(Self::WatchdogTooShort {
            of: watchdog_name(remote).into(),
            remote,
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

impl MesaError for DriverError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Bus(error) => error.advice(),
            Self::Identify(error) => error.advice(),
            Self::Register(error) => error.advice(),
            Self::Port(error) => error.advice(),
            Self::Unsteady { .. } => Some(advice::CHECK_SUPPLY),
            Self::NoSuchPort { .. } => Some(advice::LEAVE_PORT_OUT),
            Self::Missing(remark) => remark.advice(),
            Self::Attach(error) => error.advice(),
            Self::Parameter { source, .. } => source.advice(),
            Self::NotPaced { .. } => Some(advice::CHOOSE_HOST_PACE),
            Self::BadPeriod { .. } => Some(advice::CHOOSE_PERIOD),
            Self::PeriodInUse => Some(advice::SET_PERIOD_FIRST),
            Self::WatchdogTooShort { .. } => Some(advice::LENGTHEN_WATCHDOG),
            Self::PeriodTooShort { .. } => Some(advice::LENGTHEN_PERIOD),
            Self::NotConfirmed => Some(advice::CHECK_LINK),
            Self::NotHeard { .. } => Some(advice::CHECK_CARD_POWER),
            Self::NotRunning { .. } => Some(advice::REARM_FIRST),
        }
    }
}

impl From<PortError> for DriverError {
    fn from(error: PortError) -> Self {
        match error {
            PortError::Bus(error) => Self::Bus(error),
            error => Self::Port(error),
        }
    }
}

/// Error of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CycleError {
    /// The read failed: no input was taken.
    #[error("failed read, {consecutive} in a row: {source}")]
    Read {
        /// The error of the bus.
        source: BusError,
        /// Number of consecutive failed reads, including this one.
        consecutive: u32,
    },
    /// The write failed, or may have.
    #[error("failed write, {consecutive} in a row: {source}")]
    Write {
        /// The error of the bus.
        source: BusError,
        /// Number of consecutive failed writes, including this one.
        consecutive: u32,
    },
    /// The words that were read are not from a HostMot2 board: no input was taken.
    #[error(
        "no HostMot2 board: address 0x0100 reads {found:#010X}, expected 0x55AACAFE ({consecutive} failed \
         reads in a row)"
    )]
    NotThere {
        /// The word in place of the cookie.
        found: u32,
        /// Number of consecutive failed reads, including this one.
        consecutive: u32,
    },
    /// Another board, or another firmware, answers than at the driver's start. It did not get this
    /// driver's set-up.
    #[error("another board or another firmware answers than at the start: it is not set up")]
    OtherFirmware,
}

impl CycleError {
    /// The kind of the bus error; [`BusErrorKind::Device`] for a board that is absent or another
    /// one.
    pub fn kind(&self) -> BusErrorKind {
        match self {
            Self::Read { source, .. } | Self::Write { source, .. } => source.kind(),
            Self::NotThere { .. } | Self::OtherFirmware => BusErrorKind::Device,
        }
    }
}

impl MesaError for CycleError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Read { source, .. } | Self::Write { source, .. } => source.advice(),
            Self::NotThere { .. } => Some(advice::CHECK_BOARD_POWER),
            Self::OtherFirmware => Some(advice::START_ANEW),
        }
    }
}
