//! Parameters that remotes keep: writing them, which is only possible in setup mode.

use core::time::Duration;

use crate::bus::{Access, BusError, Clock, RegisterBus};
use crate::discovery::{DataRecord, PortMemory};
use crate::hal::AnyValue;
use crate::modules::watchdog::WatchdogRegisters;
use crate::remote::{ParameterError, RemotePins};
use crate::sslbp::{Channel, Port, PortError, StartFailure, StartMode, StartedRemote};

use super::configure::WATCHDOG_FEEDS;
use super::{BoardState, Driver};
use crate::modules::serial::WATCHDOG_PARAMETER;

/// Why a parameter of a remote was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RemoteParameterError<E: BusError> {
    /// There is no such port.
    #[error("there is no serial port {port}: this driver has {ports}")]
    NoSuchPort {
        /// The port.
        port: u8,
        /// How many there are.
        ports: usize,
    },
    /// No remote takes part there.
    #[error(
        "no remote takes part on port {port}, channel {channel}; `Driver::missing` says why, if it \
         was configured"
    )]
    NoSuchRemote {
        /// The port.
        port: u8,
        /// The channel.
        channel: u8,
    },
    /// The remote does not have it.
    #[error(
        "port {port}, channel {channel}: the remote has no parameter of that name; its parameters are in \
         `RemoteStatus::descriptor`"
    )]
    NoSuchParameter {
        /// The port.
        port: u8,
        /// The channel.
        channel: Channel,
    },
    /// The value is a watchdog's, and shorter than what the period feeds. Nothing was stopped.
    #[error(
        "a watchdog of {watchdog:?} can not be fed with a period of {period:?}: a transfer that is \
         lost must not let it bite, so it needs 2 x {period:?} = {needed:?}; choose more \
         milliseconds, or a shorter period"
    )]
    WatchdogTooShort {
        /// What was to be written.
        watchdog: Duration,
        /// What it must be at least.
        needed: Duration,
        /// The period.
        period: Duration,
    },
    /// The remote did not start in setup mode.
    #[error(transparent)]
    DidNotStart(StartFailure),
    /// Another device is on the channel; nothing was written.
    #[error(
        "channel {channel}: another device answers ({found}); nothing was written: plug the right one in"
    )]
    AnotherDevice {
        /// The channel.
        channel: Channel,
        /// What answers.
        found: crate::discovery::RemoteName,
    },
    /// The port or the bus failed, or the remote did not keep a non-volatile value.
    #[error(transparent)]
    Port(PortError<E>),
    /// The parameter can not have this value, and nothing was stopped; or the remote did not take it.
    #[error(transparent)]
    Parameter(ParameterError<PortError<E>>),
    /// The board is not set up, so that its serial lines are no lines.
    #[error("the board is not running ({state:?}), and reaches no remote: call `rearm` first")]
    BoardNotRunning {
        /// What it is.
        state: BoardState,
    },
}

/// The board's watchdog while nobody feeds it: longer than everything can take together, accesses
/// that are tried again included.
const UNFED: Duration = Duration::from_secs(8);

/// One parameter of one remote, and what it is to be.
#[derive(Clone, Debug)]
pub(super) struct ParameterWrite {
    /// Its place in [`RemotePins::parameters`].
    pub place: usize,
    record: DataRecord,
    value: AnyValue,
    pub raw: u64,
}

/// Refuses a remote's watchdog that the period can not feed; 0 switches it off.
pub(super) fn check_watchdog<E: BusError>(
    name: &str,
    value: AnyValue,
    period: Duration,
) -> Result<(), RemoteParameterError<E>> {
    let millis = match value {
        AnyValue::U32(value) => Some(u64::from(value)),
        AnyValue::U64(value) => Some(value),
        AnyValue::S32(value) => u64::try_from(value).ok(),
        AnyValue::S64(value) => u64::try_from(value).ok(),
        _ => None,
    };
    let needed = period.saturating_mul(WATCHDOG_FEEDS);
    let watchdog = millis.map(Duration::from_millis).unwrap_or_default();
    if !name.eq_ignore_ascii_case(WATCHDOG_PARAMETER) || watchdog.is_zero() || watchdog >= needed {
        return Ok(());
    }
    Err(RemoteParameterError::WatchdogTooShort {
        watchdog,
        needed,
        period,
    })
}

impl ParameterWrite {
    /// Checks everything that can be checked before anything is stopped.
    pub fn new<E: BusError>(
        (port, channel): (u8, Channel),
        pins: &RemotePins,
        name: &str,
        value: AnyValue,
    ) -> Result<Self, RemoteParameterError<E>> {
        let mut parameters = pins.parameters.iter().enumerate();
        let found = parameters.find(|(_, parameter)| parameter.record.is_named(name));
        let Some((place, parameter)) = found else {
            return Err(RemoteParameterError::NoSuchParameter { port, channel });
        };
        Ok(Self {
            place,
            record: parameter.record.clone(),
            value,
            raw: parameter.record.raw_of(value)?,
        })
    }

    /// Writes it to a remote in setup mode, and reads it back.
    pub fn write<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        port: &mut Port,
        channel: Channel,
    ) -> Result<(), RemoteParameterError<B::Error>> {
        let mut memory = PortMemory { port, bus, channel };
        Ok(self.record.write_parameter(&mut memory, self.value)?)
    }
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Writes a parameter that the remote on `channel` of `port` keeps, for example
    /// `nvwatchdogtimeout`, and reads it back. `name` is as the remote spells it, or as LinuxCNC
    /// does.
    ///
    /// A remote takes parameters in setup mode only, which costs the machine this: everything that
    /// the driver drives becomes safe, the port is stopped with all its remotes, and nothing else
    /// is served until the call returns. Remotes of other ports go without process data for so
    /// long that their watchdogs may bite; the board's own gets 8 s for the time. Afterwards the
    /// remotes of the port are started again in the next cycles, and everything waits for
    /// [`rearm`](Self::rearm). The same holds if it fails after the name and the value were checked.
    /// Go on with the cycle at once: the board's watchdog has its usual time again.
    ///
    /// A non-volatile parameter is written only if it is another than before, and the remote uses
    /// it from its next power-up on.
    ///
    /// # Errors
    /// [`RemoteParameterError`]. If it is about port, remote, name or value, nothing was stopped.
    ///
    /// # Real time
    /// Not for the cycle: 2 ms for the START, some accesses of 40 us, and 10 to 130 ms more where
    /// non-volatile memory is written; 55 ms if the remote is absent.
    pub fn write_remote_parameter(
        &mut self,
        port: u8,
        channel: Channel,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), RemoteParameterError<B::Error>> {
        let ports = self.parts.ports.len();
        let Some(found) = self.parts.ports.get(usize::from(port)) else {
            return Err(RemoteParameterError::NoSuchPort { port, ports });
        };
        let Some(remote) = found.remote(channel) else {
            let channel = channel.index();
            return Err(RemoteParameterError::NoSuchRemote { port, channel });
        };
        let value = value.into();
        let write = ParameterWrite::new((port, channel), remote.pins, name, value)?;
        check_watchdog(name, value, self.period)?;
        let started = *remote.started;
        // The remotes of other ports are not served either: all are told safe values.
        self.last_transfer().map_err(RemoteParameterError::Port)?;
        if !self.is_running() {
            let state = self.state;
            return Err(RemoteParameterError::BoardNotRunning { state });
        }
        let usual = self.parts.watchdog.timeout();
        let fed = self.feed_for(UNFED);
        let result = fed.and_then(|()| self.write_in_setup(port, &started, &write));
        self.make_safe();
        self.pacer.forget_started(&mut *self.bus, &mut self.image);
        self.look_closely = true;
        self.feed_for(usual)?;
        result
    }

    /// Feeds the board's watchdog, once, for this time. A bite stays to be seen, and so does a reset:
    /// the watchdog is restarted before it has the time.
    fn feed_for(&mut self, time: Duration) -> Result<(), RemoteParameterError<B::Error>> {
        let watchdog = self.parts.watchdog.registers;
        let words = &mut [WatchdogRegisters::PET, watchdog.time_for(time)];
        let accesses = [
            Access::write(watchdog.reset, 0, 1),
            Access::write(watchdog.time, 1, 1),
        ];
        self.bus
            .exchange(&accesses, words)
            .map_err(|error| RemoteParameterError::Port(PortError::Bus(error)))
    }

    fn write_in_setup(
        &mut self,
        port: u8,
        remote: &StartedRemote,
        write: &ParameterWrite,
    ) -> Result<(), RemoteParameterError<B::Error>> {
        let bus = &mut *self.bus;
        let ports = self.parts.ports.len();
        let Some(found) = self.parts.ports.get_mut(usize::from(port)) else {
            return Err(RemoteParameterError::NoSuchPort { port, ports });
        };
        let result = in_setup(bus, &mut found.port, remote, write);
        let stopped = found.port.stop_all(bus);
        found.taken_over(&mut self.pins, bus.now());
        result?;
        found.parameter_written(&mut self.pins, remote.channel, write.place, write.raw);
        stopped.map_err(RemoteParameterError::Port)
    }
}

/// Starts one remote in setup mode and writes; whatever ran before is stopped.
fn in_setup<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    remote: &StartedRemote,
    write: &ParameterWrite,
) -> Result<(), RemoteParameterError<B::Error>> {
    let channel = remote.channel;
    port.stop_all(bus).map_err(RemoteParameterError::Port)?;
    let report = port
        .start(bus, StartMode::Setup, &[(channel, remote.software_mode)])
        .map_err(RemoteParameterError::Port)?;
    match report.outcome(channel) {
        Some(Ok(found)) if (found.name, found.unit_number) == (remote.name, remote.unit_number) => {
            write.write(bus, port, channel)
        }
        Some(Ok(found)) => Err(RemoteParameterError::AnotherDevice {
            channel,
            found: found.name,
        }),
        Some(Err(failure)) => Err(RemoteParameterError::DidNotStart(failure)),
        None => Err(RemoteParameterError::NoSuchRemote {
            port: port.layout().instance,
            channel: channel.index(),
        }),
    }
}
