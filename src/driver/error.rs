//! What goes wrong when a driver starts, and in the cycle.

use core::time::Duration;

use crate::boards::{AttachError, IdentityError};
use crate::bus::BusError;
use crate::discovery::{Problem, RemoteName};
use crate::hostmot2::IdentifyError;
use crate::modules::RegisterError;
use crate::remote::RemoteError;
use crate::sslbp::{Channel, PortError, StartFailure};

use super::RemoteParameterError;

/// Why a driver did not start. Everything that was started is stopped again.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StartError<E: BusError> {
    /// The bus failed.
    #[error(transparent)]
    Bus(E),
    /// The firmware is not one that this crate knows.
    #[error(transparent)]
    Identify(#[from] IdentifyError<E>),
    /// A module can not be used.
    #[error(transparent)]
    Register(#[from] RegisterError),
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
    /// A channel was configured that no serial port has.
    #[error("there is no channel {channel} on serial port {port}: channels are 0 to 7; correct it")]
    NoSuchChannel {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
    },
    /// A serial port does not do what it is told.
    #[error(transparent)]
    Port(PortError<E>),
    /// A remote that the machine can not do without is missing.
    #[error("port {}, channel {}: {}", .0.port, .0.channel, .0.reason)]
    Missing(MissingRemote),
    /// No remote takes part there.
    #[error(
        "no remote takes part on port {port}, channel {channel}; `missing` says why, if it was configured"
    )]
    NoRemote {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
    },
    /// There are no handles of a board or a remote.
    #[error(transparent)]
    Attach(#[from] AttachError),
    /// Something was added when the board was set up already.
    #[error(
        "modules and kinds of remotes are added before `discover`, which sets the board up; add them first"
    )]
    AddedLate,
    /// A parameter of a remote was not read or written.
    #[error("parameter {name} on port {port}, channel {channel}: {source}")]
    RemoteParameter {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
        /// The parameter, as it was asked for.
        name: alloc::boxed::Box<str>,
        /// Why.
        source: RemoteParameterError<E>,
    },
    /// The board was asked to pace the cycle, and has nothing to do it with.
    #[error(
        "this firmware's phase-locked loop is missing, or left alone, so the board can not pace \
         the cycle; let the host do it (`Pace::Host`)"
    )]
    NoPace,
    /// The bus can not hold reads back until the board's clock begins a period.
    #[error("this bus can not let the board pace the cycle; let the host pace it (`Pace::Host`)")]
    NotPaced,
    /// No cycle has this period.
    #[error("a period of {period:?} can not be kept: choose one of 1 us to 800 ms")]
    BadPeriod {
        /// The period.
        period: Duration,
    },
    /// The period can not feed the board's watchdog.
    #[error(
        "the board's watchdog bites after {watchdog:?}, and is fed once in a period of {period:?}; \
         a write that is lost must not let it bite, so it needs 2 x {period:?} = {needed:?}: choose a \
         longer watchdog (`Settings::watchdog`) or a shorter period"
    )]
    WatchdogTooShort {
        /// The time that was asked for.
        watchdog: Duration,
        /// What it must be at least.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// The period can not feed a remote's watchdog.
    #[error(
        "port {port}, channel {channel}: the remote's watchdog bites after {watchdog:?}, and is fed once in \
         a period of {period:?}; a transfer that is lost must not let it bite, so it needs \
         2 x {period:?} = {needed:?}: choose a shorter period, or set the remote's \
         NVWatchDogTimeout to more milliseconds"
    )]
    RemoteWatchdogTooShort {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
        /// What the remote says, or 50 ms if it says nothing.
        watchdog: Duration,
        /// What it must be at least.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// A cycle is shorter than the transfers it must hold.
    #[error(
        "port {port} needs up to {needed:?} for a transfer, and the period is {period:?}: choose a \
         longer period, or spread the remotes over several ports"
    )]
    PeriodTooShort {
        /// The port.
        port: u8,
        /// What a transfer takes when all is well.
        needed: Duration,
        /// The period.
        period: Duration,
    },
}

impl<E: BusError> From<PortError<E>> for StartError<E> {
    fn from(error: PortError<E>) -> Self {
        match error {
            PortError::Bus(error) => Self::Bus(error),
            error => Self::Port(error),
        }
    }
}

/// A remote that was configured and does not take part.
#[derive(Clone, Debug, PartialEq)]
pub struct MissingRemote {
    /// The port.
    pub port: u8,
    /// The channel.
    pub channel: Channel,
    /// Why.
    pub reason: MissingReason,
}

impl core::fmt::Display for MissingRemote {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self {
            port,
            channel,
            reason,
        } = self;
        write!(f, "port {port}, {channel}: {reason}")
    }
}

/// Why a remote does not take part.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MissingReason {
    /// It did not start; the registers say why.
    #[error(transparent)]
    DidNotStart(StartFailure),
    /// It is another remote than was asked for.
    #[error(transparent)]
    WrongRemote(IdentityError),
    /// Its process data is not known for certain, so that its pins could be wrong.
    #[error(transparent)]
    Tables(Problem),
    /// It did not tell the same in setup mode and in normal mode.
    #[error("{name}: another remote answers in normal mode than in setup mode; is a plug loose?")]
    Changed {
        /// Its name in setup mode.
        name: RemoteName,
    },
    /// Its pins can not be made.
    #[error(transparent)]
    Pins(RemoteError),
    /// There is no such channel.
    #[error("this firmware has only {channels} channels on the port")]
    NoSuchChannel {
        /// How many there are.
        channels: u8,
    },
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
}
