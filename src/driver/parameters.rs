//! Parameters of remotes: reading and writing, which is only possible in setup mode.

use core::time::Duration;

use super::{Configured, Driver, DriverError, Remark, RemarkKind, RemoteStatus, remark};
use crate::bus::{Access, Clock, RegisterBus};
use crate::discovery::DataRecord;
use crate::hal::AnyValue;
use crate::hostmot2::RemoteId;
use crate::lbp::{RemoteAccess, RemoteLinkErrorKind};
use crate::modules::serial::WATCHDOG_PARAMETER;
use crate::modules::watchdog::WatchdogRegisters;
use crate::remote::{ParameterError, ParameterValue, RemotePins};
use crate::sslbp::{Port, PortLink, RemoteLabel, StartMode, StartedRemote};

/// Time of the board's watchdog while it is not fed: longer than all steps together, including
/// repeated accesses.
pub(super) const UNFED: Duration = Duration::from_secs(8);

/// Attempts to feed the board's watchdog.
const TRIES: u32 = 3;

/// A parameter of a remote.
#[derive(Clone, Copy, Debug)]
struct KeptParameter<'a> {
    remote: RemoteLabel,
    name: &'a str,
}

impl<'a> KeptParameter<'a> {
    fn new(pins: &RemotePins, name: &'a str) -> Self {
        Self {
            remote: pins.label,
            name,
        }
    }

    fn failed(self, source: ParameterError) -> DriverError {
        if let ParameterError::Link(error) = &source
            && let RemoteLinkErrorKind::Bus(error) = error.kind()
        {
            return DriverError::Bus(error);
        }
        DriverError::Parameter {
            remote: self.remote,
            name: self.name.into(),
            source,
        }
    }

    fn record(self, pins: &RemotePins) -> Result<&DataRecord, DriverError> {
        let parameter = pins.parameter(self.name);
        let record = parameter.map(|parameter| &parameter.record);
        record.ok_or_else(|| self.failed(ParameterError::Unknown))
    }

    /// Checks everything that can be checked before anything is stopped.
    fn check(
        self,
        record: &'a DataRecord,
        value: AnyValue,
        period: Duration,
    ) -> Result<CheckedWrite<'a>, DriverError> {
        let raw = record.raw_of(value).map_err(|error| self.failed(error))?;
        // 0 switches the watchdog off.
        if self.name.eq_ignore_ascii_case(WATCHDOG_PARAMETER) && raw != 0 {
            let time = Duration::from_millis(raw);
            DriverError::check_watchdog(Some(self.remote), time, period)?;
        }
        Ok(CheckedWrite {
            parameter: self,
            record,
            value,
            raw,
        })
    }
}

/// A value for a parameter that passed all checks.
#[derive(Clone, Copy, Debug)]
struct CheckedWrite<'a> {
    parameter: KeptParameter<'a>,
    record: &'a DataRecord,
    value: AnyValue,
    /// The bits of the value.
    raw: u64,
}

impl CheckedWrite<'_> {
    /// Writes the parameter of a remote in setup mode, and reads it back.
    fn write<B: RegisterBus + Clock>(
        self,
        memory: &mut PortLink<'_, B>,
    ) -> Result<(), DriverError> {
        let written = self.record.write_parameter(memory, self.value);
        written.map_err(|error| self.parameter.failed(error))
    }

    /// Starts only the parameter's remote in setup mode, whatever ran before, and writes the
    /// parameter.
    fn start_and_write<B: RegisterBus + Clock>(
        self,
        bus: &mut B,
        port: &mut Port,
        is: &StartedRemote,
    ) -> Result<(), DriverError> {
        let (remote, channel) = (self.parameter.remote, is.channel);
        let mut on_bus = port.on(bus);
        on_bus.stop_all()?;
        let outcomes = on_bus.start(StartMode::Setup, &[(channel, is.software_mode)])?;
        let Some(outcome) = outcomes.into_iter().next() else {
            return Err(DriverError::no_remote(remote.id));
        };
        let missing = |kind| DriverError::Missing(Remark::new(remote, kind));
        let found = outcome.map_err(|failure| missing(RemarkKind::DidNotStart(failure)))?;
        remark::is_same(is, Ok(found)).map_err(|_| {
            missing(RemarkKind::Changed {
                name: is.name,
                found: found.name,
            })
        })?;
        self.write(&mut PortLink { port, bus, channel })
    }
}

impl<B: RegisterBus + Clock> Configured<B> {
    /// Reads a parameter of a remote. `name` is spelled as by the remote or as by LinuxCNC.
    ///
    /// # Errors
    /// [`DriverError::Attach`] if no remote takes part there now. [`DriverError::Parameter`]: the
    /// remote does not have the parameter. [`DriverError::Port`], [`DriverError::Bus`]: the access
    /// failed.
    pub fn read_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
    ) -> Result<ParameterValue, DriverError> {
        let (mut memory, _, pins) = self.in_setup(remote.into())?;
        let parameter = KeptParameter::new(pins, name);
        let read = parameter.record(pins)?.read_parameter(&mut memory);
        read.map_err(|error| parameter.failed(error))
    }

    /// Writes a parameter that a remote stores, for example `NVWatchDogTimeout`, and reads it back.
    /// `name` is spelled as by the remote or as by LinuxCNC. Nothing is driven in this stage.
    ///
    /// A non-volatile parameter is written only if its value changes, and the remote uses it from
    /// its next power-up on.
    ///
    /// # Errors
    /// [`DriverError::Attach`] if no remote takes part there now. [`DriverError::Parameter`]: the
    /// remote does not have the parameter, or cannot take the value.
    /// [`DriverError::WatchdogTooShort`]: the time of a watchdog is shorter than the period
    /// requires.
    pub fn write_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), DriverError> {
        let (value, period) = (value.into(), self.0.plan.settings.period);
        let (mut memory, store, pins) = self.in_setup(remote.into())?;
        let parameter = KeptParameter::new(pins, name);
        let record = parameter.record(pins)?;
        let write = parameter.check(record, value, period)?;
        write.write(&mut memory)?;
        let raw = write.raw;
        pins.publish_parameter(store, name, raw);
        Ok(())
    }
}

impl<B: RegisterBus + Clock> Configured<B> {
    /// Accesses the memory of a remote, or one of its local locations, for what is no parameter:
    /// its fault byte, or process data in its memory. Returns the value that a read reads.
    ///
    /// # Errors
    /// [`DriverError::Attach`] if no remote takes part there now. [`DriverError::Port`],
    /// [`DriverError::Bus`]: the access failed.
    ///
    /// # Real time
    /// Not for the cycle: about 70 us, 50 ms without a reply.
    pub fn access_remote(
        &mut self,
        remote: impl Into<RemoteId>,
        access: RemoteAccess,
    ) -> Result<u64, DriverError> {
        let (memory, ..) = self.in_setup(remote.into())?;
        Ok(memory.port.on(memory.bus).access(memory.channel, access)?)
    }
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Writes a parameter that a remote stores, for example `nvwatchdogtimeout`, and reads it back.
    /// `name` is spelled as by the remote or as by LinuxCNC.
    ///
    /// A remote takes parameters in setup mode only, which affects the machine: everything that the
    /// driver drives becomes safe, the port is stopped with all its remotes, and there is no other
    /// exchange until the call returns. Remotes of other ports go without process data for a time
    /// in which their watchdogs may bite; the board's own is set to 8 s meanwhile. Afterwards the
    /// remotes of the port are started again in the next cycles, and everything waits for
    /// [`rearm`](Self::rearm). The same holds if the call fails after the name and the value were
    /// checked. Continue with the cycle at once: the board's watchdog has its usual time again.
    ///
    /// A non-volatile parameter is written only if its value changes, and the remote uses it from
    /// its next power-up on.
    ///
    /// # Errors
    /// [`DriverError`]. If it concerns port, remote, name or value, nothing was stopped.
    ///
    /// # Real time
    /// Not for the cycle: 2 ms for the START, some accesses of 40 us, and 10 to 150 ms more where
    /// non-volatile memory is written; 55 ms if the remote is absent.
    pub fn write_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), DriverError> {
        let (value, remote) = (value.into(), remote.into());
        let status = self.status(remote)?;
        let parameter = KeptParameter::new(status.pins, name);
        let record = parameter.record(status.pins)?.clone();
        let write = parameter.check(&record, value, self.pacer.period)?;
        let started = *status.started;
        // The remotes of other ports get no process data either, so all of them get safe values.
        self.all_off()?;
        let usual = self.cycle.parts.watchdog.timeout();
        let fed = self.feed_for(UNFED);
        let result = fed.and_then(|()| self.write_in_setup(write, &started));
        self.cycle.make_safe();
        self.forget_started();
        self.cycle.look_closely();
        self.feed_for(usual)?;
        result
    }

    /// Requests the write of a parameter that a remote stores, for the next time that its port is
    /// switched on: with the pin `sserial.port-N.run`, false and then true, as in LinuxCNC. `name`
    /// is spelled as by the remote or as by LinuxCNC.
    ///
    /// Nothing is stopped by this call. While the port starts again, in the cycles after `run`
    /// became true, its remotes with requests are started in setup mode, their parameters are
    /// written and read back, an access in each cycle, and all its remotes are started for process
    /// data. The remotes of other ports transfer meanwhile. The parameter's pin shows the new value
    /// when the remote has it; otherwise it keeps its value, and
    /// [`EventKind::ParameterNotWritten`](crate::driver::EventKind::ParameterNotWritten) reports
    /// that. A port that is switched on again before it has stopped writes at its next whole
    /// restart.
    ///
    /// A second request for a parameter replaces the first. A non-volatile parameter is written
    /// only if its value changes, and the remote uses it from its next power-up on.
    ///
    /// # Errors
    /// [`DriverError`], if it concerns remote, name or value; nothing is requested then.
    ///
    /// # Real time
    /// Bounded by the number of the remote's parameters; allocates for an error only.
    pub fn request_remote_parameter(
        &mut self,
        remote: impl Into<RemoteId>,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), DriverError> {
        let (value, remote) = (value.into(), remote.into());
        let status = self.status(remote)?;
        let parameter = KeptParameter::new(status.pins, name);
        let record = parameter.record(status.pins)?;
        let raw = parameter.check(record, value, self.pacer.period)?.raw;
        let write = status.pins.write_of(status.started.channel, name, raw);
        let write = write.ok_or_else(|| parameter.failed(ParameterError::Unknown))?;
        let port = self.cycle.parts.ports.get_mut(usize::from(remote.port));
        debug_assert!(port.is_some(), "the remote was found there");
        if let Some(port) = port {
            port.request_parameter(write);
        }
        Ok(())
    }

    fn status(&self, remote: RemoteId) -> Result<RemoteStatus<'_>, DriverError> {
        self.remote(remote)
            .ok_or_else(|| DriverError::no_remote(remote))
    }

    /// Feeds the board's watchdog, once, for this time. A bite remains visible, and so does a
    /// reset: the watchdog is restarted before it has the time.
    pub(super) fn feed_for(&mut self, time: Duration) -> Result<(), DriverError> {
        let watchdog = self.cycle.parts.watchdog.registers;
        let pet = (watchdog.reset, WatchdogRegisters::PET);
        let (accesses, mut words) = Access::writes([pet, (watchdog.time, watchdog.time_for(time))]);
        let mut tries = 1..TRIES;
        loop {
            let at = self.bus.now();
            let fed = self.bus.exchange(&accesses, &mut words);
            let by = self.bus.now();
            let watchdog = &mut self.cycle.parts.watchdog;
            watchdog.fed_outside(at, by, time, fed.is_ok());
            if fed.is_ok() || tries.next().is_none() {
                return fed.map_err(DriverError::Bus);
            }
        }
    }

    fn write_in_setup(
        &mut self,
        write: CheckedWrite<'_>,
        started: &StartedRemote,
    ) -> Result<(), DriverError> {
        let bus = &mut self.bus;
        let KeptParameter { remote, name } = write.parameter;
        let ports = &mut self.cycle.parts.ports;
        let Some(serial) = ports.get_mut(usize::from(remote.id.port)) else {
            return Err(DriverError::no_remote(remote.id));
        };
        let result = write.start_and_write(bus, &mut serial.port, started);
        let stopped = serial.port.on(bus).stop_all();
        serial.taken_over(&mut self.cycle.pins, bus.now());
        result?;
        serial.parameter_written(&mut self.cycle.pins, started.channel, name, write.raw);
        Ok(stopped?)
    }
}
