//! Ports and remotes, from reset to the first transfer.

use alloc::vec::Vec;

use super::configure::Plan;
use super::settings::{ParameterChoice, WATCHDOG_FEEDS};
use crate::boards::{IdentityError, RemoteTable};
use crate::bus::{BusError, Clock, RegisterBus};
use crate::discovery::{
    DiscoveredRemote, DiscoveryLimits, ModeType, PortMemory, RemoteDescriptor, discover_port,
};
use crate::driver::parameters::{ParameterWrite, RemoteParameterError};
use crate::driver::remark;
use crate::driver::{
    MissingReason, MissingRemote, Remark, RemoteConfig, SerialConfig, SerialPort, StartError,
};
use crate::hostmot2::{Gtag, PinDescriptor};
use crate::modules::RegisterError;
use crate::modules::serial::{Remote, RemoteFaultPins};
use crate::remote::{PackingPlan, ParameterError, RemoteLocation, RemotePins};
use crate::sslbp::{
    Channel, ChannelStart, Layout, Port, PortError, SslbpModule, StartMode, StartedRemote,
};

/// A port, and what is expected on it.
pub(super) type Located = (Port, SerialConfig);

impl Plan {
    /// Finds the ports of the firmware and takes their I/O pins.
    pub fn locate_ports<E: BusError>(&mut self) -> Result<Vec<Located>, StartError<E>> {
        let config = &self.settings;
        let module = [Gtag::SSERIAL, Gtag::SSERIAL_B]
            .into_iter()
            .find_map(|gtag| self.firmware.find(gtag))
            .copied();
        let ports = module.map_or(0, |module| module.instances);
        let last = (0u8..)
            .zip(&config.ports)
            .filter(|(_, config)| config.is_some())
            .map(|(port, _)| port)
            .last();
        let last = last.max(config.parameters.iter().map(|choice| choice.port).max());
        if let Some(port) = config.port_beyond.or(last).filter(|&port| port >= ports) {
            return Err(StartError::NoSuchPort { port, ports });
        }
        let beyond =
            |(port, serial): (u8, &Option<SerialConfig>)| Some((port, serial.as_ref()?.beyond?));
        if let Some((port, channel)) = (0u8..).zip(&config.ports).find_map(beyond) {
            return Err(StartError::NoSuchChannel { port, channel });
        }
        let Some(module) = module else {
            return Ok(Vec::new());
        };
        let description = SslbpModule {
            gtag: module.gtag.0,
            base: module.base,
            registers: module.registers,
            register_stride: module.register_stride,
            instance_stride: module.instance_stride,
            multiple_registers: module.multiple_registers,
            instances: module.instances,
        };
        let mut located = Vec::new();
        for (instance, serial) in (0..ports).zip(config.ports) {
            let channels = self.firmware.sserial_channels(module.gtag, instance);
            let layout = Layout::new(&description, instance, channels)?;
            let serial = serial.unwrap_or_default();
            // As in LinuxCNC, the pins of channels that are not used are plain I/O.
            let is_used = |pin: PinDescriptor| {
                let number = pin.secondary_pin & 0x0F;
                let channel = number.checked_sub(1);
                channel.is_none_or(|channel| serial.channel(channel).is_some())
            };
            self.io
                .use_some(&self.firmware, module.gtag, instance, is_used)
                .map_err(RegisterError::from)?;
            located.push((Port::new(layout), serial));
        }
        Ok(located)
    }

    /// Resets the ports, discovers their remotes and starts them.
    pub fn start_ports<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        located: &mut [Located],
    ) -> Result<Vec<SerialPort>, StartError<B::Error>> {
        let parameters = core::mem::take(&mut self.settings.parameters);
        let mut ports = Vec::new();
        for (port, serial) in located {
            let of_port = port.reset(bus)?;
            let remotes = self.start_port(bus, port, serial, &parameters)?;
            let now = bus.now();
            let status = self.status;
            let port = self.register(bus, status, |r| {
                SerialPort::register(r, (port.clone(), of_port), remotes, now)
            })?;
            self.check_port(&port)?;
            ports.push(port);
        }
        self.check_parameters(&ports, &parameters)?;
        Ok(ports)
    }

    /// Whether the period is long enough for the transfers of a port, and short enough for the
    /// watchdogs of its remotes.
    fn check_port<E: BusError>(&self, port: &SerialPort) -> Result<(), StartError<E>> {
        let period = self.settings.period;
        let instance = port.layout().instance();
        let needed = port.expected_time().usual;
        if needed > period {
            return Err(StartError::PeriodTooShort {
                port: instance,
                needed,
                period,
            });
        }
        let needed = period * WATCHDOG_FEEDS;
        for remote in port.remotes() {
            if let Some(watchdog) = remote.watchdog().time().filter(|time| *time < needed) {
                return Err(StartError::RemoteWatchdogTooShort {
                    port: instance,
                    channel: remote.started().channel,
                    watchdog,
                    needed,
                    period,
                });
            }
        }
        Ok(())
    }

    /// Whether every parameter was for a remote that there is, or that is known to be missing.
    fn check_parameters<E: BusError>(
        &self,
        ports: &[SerialPort],
        choices: &[ParameterChoice],
    ) -> Result<(), StartError<E>> {
        for ParameterChoice {
            port,
            channel,
            name,
            ..
        } in choices
        {
            let (port, channel) = (*port, *channel);
            let found = ports.get(usize::from(port));
            let is_there = Channel::new(channel)
                .is_some_and(|channel| found.is_some_and(|port| port.remote(channel).is_some()));
            let is_missing = self
                .missing
                .iter()
                .any(|missing| (missing.port, missing.channel.index()) == (port, channel));
            if !is_there && !is_missing {
                return Err(StartError::RemoteParameter {
                    port,
                    channel,
                    name: name.clone(),
                    source: RemoteParameterError::NoSuchRemote { port, channel },
                });
            }
        }
        Ok(())
    }

    /// Discovery in setup mode, then normal START, as LinuxCNC does it.
    fn start_port<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        port: &mut Port,
        serial: &SerialConfig,
        parameters: &[ParameterChoice],
    ) -> Result<Vec<Remote>, StartError<B::Error>> {
        let wanted = self.existing(port, serial)?;
        let inventory = discover_port(port, bus, &wanted, DiscoveryLimits::default())?;
        for failure in &inventory.failures {
            let reason = MissingReason::DidNotStart(*failure);
            self.miss(port, serial, failure.channel, reason)?;
        }
        let mut candidates = Vec::new();
        for found in inventory.remotes {
            let channel = found.remote.channel;
            let expected = serial.channel(channel.index()).unwrap_or_default();
            match self.candidate(port, &found, expected) {
                Ok(pins) => {
                    let mut remote = (found, pins);
                    self.read_parameters(bus, port, &mut remote)?;
                    self.write_parameters(bus, port, &mut remote, parameters)?;
                    candidates.push(remote);
                }
                Err(reason) => self.miss(port, serial, channel, reason)?,
            }
        }
        let of = candidates.iter();
        let of = of.map(|(found, _)| (found.remote.channel, &found.discovered.descriptor));
        let instance = port.layout().instance();
        self.remarks.extend(remark::on_order(instance, of));
        port.stop_all(bus)?;
        self.start_normal(bus, port, serial, candidates)
    }

    /// The channels to start; those that do not exist and were asked for by name are missing.
    fn existing<E: BusError>(
        &mut self,
        port: &Port,
        serial: &SerialConfig,
    ) -> Result<Vec<ChannelStart>, StartError<E>> {
        let channels = port.layout().channels();
        let mut starts = Vec::new();
        for (channel, remote) in serial.iter() {
            if channel.index() < channels {
                starts.push(ChannelStart::new(channel).with_software_mode(remote.mode));
            } else if remote.required {
                let reason = MissingReason::NoSuchChannel { channels };
                self.miss(port, serial, channel, reason)?;
            }
        }
        Ok(starts)
    }

    /// A remote does not take part. Fails if the machine can not do without it.
    fn miss<E: BusError>(
        &mut self,
        port: &Port,
        serial: &SerialConfig,
        channel: Channel,
        reason: MissingReason,
    ) -> Result<(), StartError<E>> {
        let missing = MissingRemote {
            port: port.layout().instance(),
            channel,
            reason,
        };
        let config = serial.channel(channel.index());
        if config.is_some_and(|config| config.required) {
            return Err(StartError::Missing(missing));
        }
        self.missing.push(missing);
        Ok(())
    }

    /// Makes the pins of a remote that is the right one and that is understood.
    fn candidate<E>(
        &mut self,
        port: &Port,
        found: &DiscoveredRemote<E>,
        expected: RemoteConfig,
    ) -> Result<RemotePins, MissingReason> {
        let descriptor = &found.discovered.descriptor;
        let name = descriptor.name;
        check_identity(descriptor, expected).map_err(MissingReason::WrongRemote)?;
        check_mode(descriptor)?;
        if let Some(problem) = found
            .discovered
            .problems
            .iter()
            .find(|problem| problem.affects_process_data())
        {
            let problem = *problem;
            return Err(MissingReason::Tables { name, problem });
        }
        let plan = PackingPlan::new(descriptor, port.layout().interface_registers());
        let plan = plan.map_err(|problem| MissingReason::Tables { name, problem })?;
        check_sizes(&found.remote, &plan)?;
        let location = RemoteLocation {
            board: &self.name,
            port: port.layout().instance(),
            channel: found.remote.channel.index(),
        };
        let table = RemoteTable::for_remote(descriptor);
        let pins = RemotePins::new(&mut self.pins, location, descriptor, plan, table);
        let pins = pins.map_err(|error| MissingReason::Pins { name, error })?;
        let (port, channel) = (location.port, found.remote.channel);
        self.remarks
            .extend(Remark::on(port, channel, &found.discovered, table));
        Ok(pins)
    }

    /// Reads the parameters of a remote in setup mode. One that can not be read stays unknown.
    fn read_parameters<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        port: &mut Port,
        (found, pins): &mut (DiscoveredRemote<PortError<B::Error>>, RemotePins),
    ) -> Result<(), StartError<B::Error>> {
        let mut memory = PortMemory::new(port, bus, found.remote.channel);
        for parameter in pins.parameters_mut() {
            let records = &found.discovered.descriptor.parameters;
            let Some(record) = records.get(parameter.record) else {
                continue;
            };
            match record.read_parameter(&mut memory) {
                Ok(value) => parameter.publish(&mut self.pins, value.raw),
                Err(ParameterError::Memory(PortError::Bus(error))) => {
                    return Err(StartError::Bus(error));
                }
                Err(_) => {}
            }
        }
        Ok(())
    }

    /// Writes the parameters that were chosen for a remote in setup mode.
    fn write_parameters<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        port: &mut Port,
        (found, pins): &mut (DiscoveredRemote<PortError<B::Error>>, RemotePins),
        choices: &[ParameterChoice],
    ) -> Result<(), StartError<B::Error>> {
        let place = (port.layout().instance(), found.remote.channel);
        let own = choices
            .iter()
            .filter(|choice| (choice.port, choice.channel) == (place.0, place.1.index()));
        for choice in own {
            let failed = |source| StartError::RemoteParameter {
                port: place.0,
                channel: place.1.index(),
                name: choice.name.clone(),
                source,
            };
            let parts = (&found.discovered.descriptor, &*pins);
            let write =
                ParameterWrite::new(place, parts, &choice.name, choice.value).map_err(failed)?;
            write.write(bus, port, place.1).map_err(failed)?;
            if let Some(parameter) = pins.parameters_mut().get_mut(write.place) {
                parameter.publish(&mut self.pins, write.raw);
            }
        }
        Ok(())
    }

    fn start_normal<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        port: &mut Port,
        serial: &SerialConfig,
        candidates: Vec<(DiscoveredRemote<PortError<B::Error>>, RemotePins)>,
    ) -> Result<Vec<Remote>, StartError<B::Error>> {
        let starts: Vec<ChannelStart> = candidates
            .iter()
            .map(|(found, _)| {
                ChannelStart::new(found.remote.channel)
                    .with_software_mode(found.remote.software_mode)
            })
            .collect();
        let report = port.start(bus, StartMode::Normal, &starts)?;
        let mut remotes = Vec::new();
        for (found, pins) in candidates {
            let channel = found.remote.channel;
            let name = found.remote.name;
            match report.outcome(channel) {
                Some(Ok(started)) if is_same(&started, &found.remote) => {
                    let fault_pins =
                        RemoteFaultPins::new(&mut self.pins, self.status, pins.prefix())
                            .map_err(RegisterError::from)?;
                    let descriptor = found.discovered.descriptor;
                    remotes.push(Remote::new(started, descriptor, pins, fault_pins));
                }
                Some(Err(failure)) => {
                    let reason = MissingReason::DidNotStart(failure);
                    self.miss(port, serial, channel, reason)?;
                }
                _ => self.miss(port, serial, channel, MissingReason::Changed { name })?,
            }
        }
        Ok(remotes)
    }
}

fn check_identity(
    descriptor: &RemoteDescriptor,
    expected: RemoteConfig,
) -> Result<(), IdentityError> {
    let name = descriptor.name;
    if let Some(expected) = expected.name.filter(|&expected| expected != name) {
        return Err(IdentityError::Name {
            expected,
            actual: name,
        });
    }
    let actual = descriptor.unit_number;
    let class = (actual >> 24) as u8;
    if let Some(expected) = expected.unit_class.filter(|&expected| expected != class) {
        return Err(IdentityError::Class {
            name,
            expected,
            actual,
        });
    }
    match expected.unit_number {
        Some(expected) if expected != actual => Err(IdentityError::Unit {
            name,
            expected,
            actual,
        }),
        _ => Ok(()),
    }
}

/// A remote that tells its software modes must know the one it was started in.
fn check_mode(descriptor: &RemoteDescriptor) -> Result<(), MissingReason> {
    let mode = descriptor.software_mode;
    let mut known = descriptor
        .modes
        .iter()
        .filter(|known| known.mode_type == ModeType::Software)
        .peekable();
    if known.peek().is_none() || known.any(|known| known.index == mode) {
        return Ok(());
    }
    let name = descriptor.name;
    Err(MissingReason::UnknownMode { name, mode })
}

/// What the remote transfers must be what its tables describe.
fn check_sizes(remote: &StartedRemote, plan: &PackingPlan) -> Result<(), MissingReason> {
    let fault_byte = u32::from(remote.sizes.rx.saturating_sub(remote.input_bytes()));
    let plan_rx = plan.input_bytes() + fault_byte;
    let plan_tx = plan.transmit_size();
    if u32::from(remote.sizes.rx) == plan_rx && u32::from(remote.sizes.tx) == plan_tx {
        return Ok(());
    }
    Err(MissingReason::Sizes {
        name: remote.name,
        rx: remote.sizes.rx,
        tx: remote.sizes.tx,
        plan_rx,
        plan_tx,
    })
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
