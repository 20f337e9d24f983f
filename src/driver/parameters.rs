//! Parameters that remotes keep: reading and writing them, which is only possible in setup mode.

use core::time::Duration;

use super::error::remote_watchdog;
use super::{Board, Driver, DriverError, Remark, remark};
use crate::bus::{Access, BusError, Clock, RegisterBus};
use crate::discovery::DataRecord;
use crate::hal::AnyValue;
use crate::hostmot2::RemoteId;
use crate::modules::serial::WATCHDOG_PARAMETER;
use crate::modules::watchdog::WatchdogRegisters;
use crate::remote::{ParameterError, ParameterValue, RemotePins};
use crate::sslbp::{Port, PortError, PortLink, StartMode, StartedRemote};

/// The board's watchdog while nobody feeds it: longer than everything can take together, accesses
/// that are tried again included.
pub(super) const UNFED: Duration = Duration::from_secs(8);

/// How often the board's watchdog is tried to be fed.
const TRIES: u32 = 3;

/// A parameter of a remote.
#[derive(Clone, Copy, Debug)]
struct Parameter<'a> {
    remote: RemoteId,
    name: &'a str,
}

impl Parameter<'_> {
    fn failed<E: BusError>(self, source: ParameterError<PortError<E>>) -> DriverError<E> {
        match source {
            ParameterError::Memory(error) => error.into(),
            source => DriverError::Parameter {
                remote: self.remote,
                name: self.name.into(),
                source,
            },
        }
    }

    fn record<E: BusError>(self, pins: &RemotePins) -> Result<&DataRecord, DriverError<E>> {
        let parameter = pins.parameter(self.name);
        let record = parameter.map(|parameter| &parameter.record);
        record.ok_or_else(|| self.failed(ParameterError::Unknown))
    }

    /// Checks everything that can be checked before anything is stopped.
    fn check<E: BusError>(
        self,
        record: &DataRecord,
        value: AnyValue,
        period: Duration,
    ) -> Result<u64, DriverError<E>> {
        let raw = record.raw_of(value).map_err(|error| self.failed(error))?;
        // 0 switches it off.
        if self.name.eq_ignore_ascii_case(WATCHDOG_PARAMETER) && raw != 0 {
            let of = remote_watchdog(self.remote);
            DriverError::check_watchdog(&of, Duration::from_millis(raw), period)?;
        }
        Ok(raw)
    }

    /// Starts its remote alone in setup mode, whatever ran before, and writes it.
    fn start_and_write<B: RegisterBus + Clock>(
        self,
        bus: &mut B,
        port: &mut Port,
        is: &StartedRemote,
        (record, value): (&DataRecord, AnyValue),
    ) -> Result<(), DriverError<B::Error>> {
        let channel = is.channel;
        let mut on_bus = port.on(bus);
        on_bus.stop_all()?;
        let outcomes = on_bus.start(StartMode::Setup, &[(channel, is.software_mode)])?;
        let Some(outcome) = outcomes.into_iter().next() else {
            return Err(DriverError::no_remote(self.remote));
        };
        let missing = |kind| DriverError::Missing(Remark::new(self.remote, kind));
        remark::is_same(is, outcome).map_err(missing)?;
        let mut memory = PortLink { port, bus, channel };
        let written = record.write_parameter(&mut memory, value);
        written.map_err(|error| self.failed(error))
    }
}

impl<B: RegisterBus + Clock> Board<B> {
    /// Reads a parameter of a remote. `name` is as the remote
    /// spells it, or as LinuxCNC does. After [`discover`](Self::discover).
    ///
    /// # Errors
    /// [`DriverError::Attach`] if no remote takes part there now. [`DriverError::Parameter`]: the
    /// remote does not have it. [`DriverError::Port`], [`DriverError::Bus`]: the access failed.
    pub fn read_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
    ) -> Result<ParameterValue, DriverError<B::Error>> {
        let remote = remote.into();
        let parameter = Parameter { remote, name };
        let (mut memory, _, pins) = self.in_setup(remote)?;
        let read = parameter.record(pins)?.read_parameter(&mut memory);
        read.map_err(|error| parameter.failed(error))
    }

    /// Writes a parameter that a remote keeps, for example
    /// `NVWatchDogTimeout`, and reads it back. `name` is as the remote spells it, or as LinuxCNC
    /// does. After [`discover`](Self::discover): nothing is driven.
    ///
    /// A non-volatile one is written only if it is another than before, and the remote uses it from
    /// its next power-up on.
    ///
    /// # Errors
    /// [`DriverError::Attach`] if no remote takes part there now. [`DriverError::Parameter`]: the
    /// remote does not have it, or can not take the value. [`DriverError::WatchdogTooShort`]: it is
    /// a watchdog's, and shorter than what the period feeds.
    pub fn write_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), DriverError<B::Error>> {
        let (value, period) = (value.into(), self.plan.settings.period);
        let remote = remote.into();
        let parameter = Parameter { remote, name };
        let (mut memory, store, pins) = self.in_setup(remote)?;
        let record = parameter.record(pins)?;
        let raw = parameter.check(record, value, period)?;
        let written = record.write_parameter(&mut memory, value);
        written.map_err(|error| parameter.failed(error))?;
        pins.publish_parameter(store, name, raw);
        Ok(())
    }
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Writes a parameter that a remote keeps, for example
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
    /// [`DriverError`]. If it is about port, remote, name or value, nothing was stopped.
    ///
    /// # Real time
    /// Not for the cycle: 2 ms for the START, some accesses of 40 us, and 10 to 130 ms more where
    /// non-volatile memory is written; 55 ms if the remote is absent.
    pub fn write_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), DriverError<B::Error>> {
        let (value, remote) = (value.into(), remote.into());
        let parameter = Parameter { remote, name };
        let Some(status) = self.remote(remote) else {
            return Err(DriverError::no_remote(remote));
        };
        let record = parameter.record(status.pins)?.clone();
        let raw = parameter.check(&record, value, self.pacer.period)?;
        let started = *status.started;
        // The remotes of other ports are not served either: all get safe values.
        self.all_off()?;
        let usual = self.cycle.parts.watchdog.timeout();
        let fed = self.feed_for(UNFED);
        let result =
            fed.and_then(|()| self.write_in_setup(parameter, &started, (&record, value, raw)));
        self.cycle.make_safe();
        self.forget_started();
        self.cycle.look_closely();
        self.feed_for(usual)?;
        result
    }

    /// Feeds the board's watchdog, once, for this time. A bite stays to be seen, and so does a reset:
    /// the watchdog is restarted before it has the time.
    pub(super) fn feed_for(&mut self, time: Duration) -> Result<(), DriverError<B::Error>> {
        let watchdog = self.cycle.parts.watchdog.registers;
        let pet = (watchdog.reset, WatchdogRegisters::PET);
        let (accesses, mut words) = Access::writes([pet, (watchdog.time, watchdog.time_for(time))]);
        // A long time that stays would look like a reset.
        let mut fed = self.bus.exchange(&accesses, &mut words);
        for _ in 1..TRIES {
            if fed.is_err() {
                fed = self.bus.exchange(&accesses, &mut words);
            }
        }
        fed.map_err(DriverError::Bus)
    }

    fn write_in_setup(
        &mut self,
        parameter: Parameter<'_>,
        started: &StartedRemote,
        (record, value, raw): (&DataRecord, AnyValue, u64),
    ) -> Result<(), DriverError<B::Error>> {
        let bus = &mut *self.bus;
        let port = self
            .cycle
            .parts
            .ports
            .get_mut(usize::from(parameter.remote.port));
        let Some(serial) = port else {
            return Err(DriverError::no_remote(parameter.remote));
        };
        let result = parameter.start_and_write(bus, &mut serial.port, started, (record, value));
        let stopped = serial.port.on(bus).stop_all();
        serial.taken_over(&mut self.cycle.pins, bus.now());
        result?;
        serial.parameter_written(&mut self.cycle.pins, started.channel, parameter.name, raw);
        Ok(stopped?)
    }
}
