//! Ports and remotes, from reset to the first transfer.

use alloc::vec::Vec;

use crate::boards::check_identity;
use crate::bus::{BusError, Clock, RegisterBus};
use crate::discovery::{Discovered, DiscoveryOptions, PortMemory, discover_port};
use crate::driver::configure::Plan;
use crate::driver::configure::WATCHDOG_FEEDS;
use crate::driver::remark;
use crate::driver::{
    MissingReason, MissingRemote, Presence, Remark, SerialConfig, SerialPort, StartError,
};
use crate::hostmot2::PinDescriptor;
use crate::modules::RegisterError;
use crate::modules::serial::FoundRemote;
use crate::remote::{ParameterError, RemoteLocation, RemotePins};
use crate::sslbp::{
    Channel, Layout, MAX_CHANNELS, Port, PortError, PortParameters, StartMode, StartedRemote,
};

/// A serial port while its board is configured.
#[derive(Debug)]
pub(in crate::driver) struct PortStage {
    pub port: Port,
    pub(super) serial: SerialConfig,
    /// Known once it is discovered.
    parameters: Option<PortParameters>,
    /// By channel.
    pub(super) remotes: Vec<FoundRemote>,
}

impl PortStage {
    pub(super) fn number(&self) -> u8 {
        self.port.layout().instance
    }

    /// The remote on a channel, and its place.
    pub(super) fn place(&self, channel: u8) -> Option<(usize, &FoundRemote)> {
        let mut remotes = self.remotes.iter().enumerate();
        remotes.find(|(_, found)| found.started.channel.index() == channel)
    }
}

impl Plan {
    /// Finds the ports of the firmware and takes their I/O pins.
    pub fn locate_ports<E: BusError>(&mut self) -> Result<Vec<PortStage>, StartError<E>> {
        let module = self.firmware.require_sserial().ok().copied();
        let ports = module.map_or(0, |module| module.instances);
        for (&port, serial) in &self.settings.serial_ports {
            if port >= ports {
                return Err(StartError::NoSuchPort { port, ports });
            }
            if let Some((&channel, _)) = serial.channels.range(MAX_CHANNELS..).next() {
                return Err(StartError::NoSuchChannel { port, channel });
            }
        }
        let Some(module) = module else {
            return Ok(Vec::new());
        };
        let mut located = Vec::new();
        for instance in 0..ports {
            let layout = Layout::locate(&self.firmware, instance).map_err(RegisterError::from)?;
            let serial = self.settings.serial_ports.remove(&instance);
            let serial = serial.unwrap_or_default();
            // As in LinuxCNC, the pins of channels that are not used are plain I/O.
            let is_used = |pin: PinDescriptor| {
                let number = pin.secondary_pin & 0x0F;
                let channel = number.checked_sub(1);
                channel.is_none_or(|channel| serial.channels.contains_key(&channel))
            };
            self.io
                .use_module(&self.firmware, module.gtag, instance, is_used)
                .map_err(RegisterError::from)?;
            located.push(PortStage {
                port: Port::new(layout),
                serial,
                parameters: None,
                remotes: Vec::new(),
            });
        }
        Ok(located)
    }

    /// Resets the ports and discovers their remotes, which are in setup mode then.
    pub fn discover<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stages: &mut [PortStage],
    ) -> Result<(), StartError<B::Error>> {
        for stage in stages {
            stage.parameters = Some(stage.port.reset(bus)?);
            self.discover_on(bus, stage)?;
            for (channel, config) in stage.serial.channels.clone() {
                if config.presence == Presence::Optional {
                    self.make_optional(stage, channel, config)?;
                }
            }
        }
        Ok(())
    }

    /// Starts the remotes in normal mode.
    pub fn start_ports<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stages: &mut [PortStage],
    ) -> Result<Vec<SerialPort>, StartError<B::Error>> {
        let mut ports = Vec::new();
        for stage in stages {
            let Some(parameters) = stage.parameters else {
                debug_assert!(false, "a port is discovered before it is started");
                continue;
            };
            stage.port.stop_all(bus)?;
            let remotes = self.start_normal(bus, stage)?;
            let now = bus.now();
            let status = self.status;
            let port = (stage.port.clone(), parameters);
            let port =
                self.register(bus, status, |r| SerialPort::register(r, port, remotes, now))?;
            self.check_port(&port)?;
            ports.push(port);
        }
        Ok(ports)
    }

    /// Whether the period is long enough for the transfers of a port, and short enough for the
    /// watchdogs of its remotes.
    fn check_port<E: BusError>(&self, port: &SerialPort) -> Result<(), StartError<E>> {
        let period = self.settings.period;
        let instance = port.layout().instance;
        let needed = port.expected_time.usual;
        if needed > period {
            return Err(StartError::PeriodTooShort {
                port: instance,
                needed,
                period,
            });
        }
        let needed = period * WATCHDOG_FEEDS;
        for remote in port.remotes() {
            if let Some(watchdog) = remote.watchdog.time().filter(|time| *time < needed) {
                return Err(StartError::RemoteWatchdogTooShort {
                    port: instance,
                    channel: remote.started.channel,
                    watchdog,
                    needed,
                    period,
                });
            }
        }
        Ok(())
    }

    fn discover_on<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stage: &mut PortStage,
    ) -> Result<(), StartError<B::Error>> {
        let wanted = self.existing(stage)?;
        let options = DiscoveryOptions {
            tables: &self.tables,
            ..DiscoveryOptions::default()
        };
        for outcome in discover_port(&mut stage.port, bus, &wanted, &options)? {
            match outcome.map_err(|failure| (failure.channel, MissingReason::DidNotStart(failure)))
            {
                Ok(discovered) => self.take_part(bus, stage, discovered)?,
                Err((channel, reason)) => self.miss(stage, channel, reason)?,
            }
        }
        let of = stage.remotes.iter();
        let of = of.map(|found| (found.started.channel, &found.descriptor));
        self.remarks.extend(remark::on_order(stage.number(), of));
        Ok(())
    }

    /// The channels to start; those that do not exist and were asked for by name are missing.
    fn existing<E: BusError>(
        &mut self,
        stage: &PortStage,
    ) -> Result<Vec<(Channel, u8)>, StartError<E>> {
        let channels = stage.port.layout().channels;
        let mut starts = Vec::new();
        for (&number, remote) in &stage.serial.channels {
            let Some(channel) = Channel::new(number) else {
                continue;
            };
            if number < channels {
                starts.push((channel, remote.mode));
            } else if remote.presence == Presence::Required {
                let reason = MissingReason::NoSuchChannel { channels };
                self.miss(stage, channel, reason)?;
            }
        }
        Ok(starts)
    }

    /// A remote does not take part. Fails if the machine can not do without it.
    fn miss<E: BusError>(
        &mut self,
        stage: &PortStage,
        channel: Channel,
        reason: MissingReason,
    ) -> Result<(), StartError<E>> {
        let missing = MissingRemote {
            port: stage.number(),
            channel,
            reason,
        };
        let config = stage.serial.channels.get(&channel.index());
        if config.is_some_and(|config| config.presence == Presence::Required) {
            return Err(StartError::Missing(missing));
        }
        self.missing.push(missing);
        Ok(())
    }

    fn take_part<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stage: &mut PortStage,
        discovered: Discovered,
    ) -> Result<(), StartError<B::Error>> {
        let pins = match self.candidate(stage, &discovered) {
            Ok(pins) => pins,
            Err(reason) => return self.miss(stage, discovered.started.channel, reason),
        };
        let mut found = FoundRemote {
            started: discovered.started,
            descriptor: discovered.descriptor,
            problems: discovered.problems,
            pins,
            is_absent: false,
        };
        self.read_parameters(bus, &mut stage.port, &mut found)?;
        stage.remotes.push(found);
        Ok(())
    }

    /// Makes the pins of a remote that is the right one and that is understood.
    fn candidate(
        &mut self,
        stage: &PortStage,
        discovered: &Discovered,
    ) -> Result<RemotePins, MissingReason> {
        let descriptor = &discovered.descriptor;
        let channel = discovered.started.channel.index();
        let expected = stage.serial.channels.get(&channel);
        let expected = expected.copied().unwrap_or_default();
        let identity = check_identity(descriptor, expected.kind, expected.unit_number);
        identity.map_err(MissingReason::WrongRemote)?;
        let plan = discovered.plan.as_ref();
        let plan = plan.map_err(|problem| MissingReason::Tables(problem.clone()))?;
        let location = RemoteLocation {
            board: &self.name,
            port: stage.number(),
            channel,
        };
        let table = self.tables.iter().find(|table| table.matches(descriptor));
        let table = table.copied();
        let pins = RemotePins::new(&mut self.pins, location, descriptor, plan, table);
        let pins = pins.map_err(MissingReason::Pins)?;
        let remarks = Remark::on(stage.number(), discovered, &self.tables, table);
        self.remarks.extend(remarks);
        Ok(pins)
    }

    /// Reads the parameters of a remote in setup mode. One that can not be read stays unknown.
    fn read_parameters<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        port: &mut Port,
        found: &mut FoundRemote,
    ) -> Result<(), StartError<B::Error>> {
        let channel = found.started.channel;
        let mut memory = PortMemory { port, bus, channel };
        for parameter in &mut found.pins.parameters {
            match parameter.record.read_parameter(&mut memory) {
                Ok(value) => parameter.publish(&mut self.pins, value.raw),
                Err(ParameterError::Memory(PortError::Bus(error))) => {
                    return Err(StartError::Bus(error));
                }
                Err(_) => {}
            }
        }
        Ok(())
    }

    fn start_normal<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stage: &mut PortStage,
    ) -> Result<Vec<FoundRemote>, StartError<B::Error>> {
        let there = stage.remotes.iter().filter(|found| !found.is_absent);
        let starts: Vec<_> = there
            .map(|found| (found.started.channel, found.started.software_mode))
            .collect();
        let report = stage.port.start(bus, StartMode::Normal, &starts)?;
        let mut remotes = Vec::new();
        for found in core::mem::take(&mut stage.remotes) {
            let channel = found.started.channel;
            let name = found.started.name;
            match report.outcome(channel) {
                None if found.is_absent => remotes.push(found),
                Some(Ok(started)) if is_same(&started, &found.started) => {
                    remotes.push(FoundRemote { started, ..found });
                }
                Some(Err(failure)) => {
                    let reason = MissingReason::DidNotStart(failure);
                    self.miss(stage, channel, reason)?;
                }
                _ => self.miss(stage, channel, MissingReason::Changed { name })?,
            }
        }
        Ok(remotes)
    }
}

/// Whether normal START found what setup START had found.
fn is_same(normal: &StartedRemote, setup: &StartedRemote) -> bool {
    let key = |remote: &StartedRemote| {
        (
            remote.name,
            remote.unit_number,
            remote.ptoc,
            remote.gtoc,
            remote.sizes,
        )
    };
    key(normal) == key(setup)
}
