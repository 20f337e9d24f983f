//! Serial ports and their remotes while a board is configured: from reset to the first transfer.

use alloc::collections::BTreeMap;
use alloc::string::ToString;
use alloc::vec::Vec;

use super::period::check_port;
use super::plan::Plan;
use super::remark;
use super::{
    Defaults, DriverError, OfflineReason, Presence, Remark, RemarkKind, RemoteConfig, SerialPort,
};
use crate::boards::{AttachError, check_identity};
use crate::bus::{Clock, RegisterBus};
use crate::discovery::{Discovery, DiscoveryOptions, PackingPlan, RemoteTable, discover_port};
use crate::hostmot2::{Gtag, PinDescriptor, RemoteId};
use crate::lbp::RemoteLinkErrorKind;
use crate::modules::RegisterError;
use crate::modules::serial::{RemotePart, StartedPort};
use crate::remote::{ParameterError, RemotePins};
use crate::sslbp::{
    Channel, CsStatus, MAX_CHANNELS, Port, PortLayout, PortLink, PortPlace, ProcessDataSizes,
    StartMode, StartedRemote,
};

/// The table for an absent remote of unknown kind.
const ANY: RemoteTable = RemoteTable::new("remote of any kind", [0; 4], &[]);

/// A serial port while its board is configured.
#[derive(Debug)]
pub(super) struct PortStage {
    pub port: Port,
    /// The channels in use.
    configs: BTreeMap<u8, RemoteConfig>,
    /// The remotes that take part, by channel.
    pub remotes: Vec<RemotePart>,
    /// Its I/O pins, by channel.
    pins: Vec<(u8, u16)>,
    /// The channels on which nothing answers and nothing is expected.
    silent: Vec<u8>,
}

impl PortStage {
    pub fn number(&self) -> u8 {
        self.port.layout().instance
    }

    /// The I/O pins of channels on which nothing answers and nothing is expected.
    pub fn silent_pins(&self) -> impl Iterator<Item = u16> + '_ {
        let pins = self.pins.iter();
        let silent = pins.filter(|(channel, _)| self.silent.contains(channel));
        silent.map(|&(_, number)| number)
    }

    fn config(&self, channel: Channel) -> Option<&RemoteConfig> {
        self.configs.get(&channel.index())
    }

    /// A remark about a channel, with the name of its remote if one takes part.
    fn remark(&self, channel: u8, kind: RemarkKind) -> Remark {
        match self.remote(channel) {
            Some(remote) => Remark::new(remote.label(), kind),
            None => Remark::new(RemoteId::new(self.number(), channel), kind),
        }
    }

    pub fn remote(&self, channel: u8) -> Option<&RemotePart> {
        let mut remotes = self.remotes.iter();
        remotes.find(|remote| remote.started.channel.index() == channel)
    }
}

impl Plan {
    /// Finds the ports of the firmware that are used, and takes their I/O pins.
    pub(super) fn locate_ports(&mut self) -> Result<Vec<PortStage>, DriverError> {
        let mut places = PortLayout::ports(&self.firmware);
        let ports = places.len() as u8;
        if ports == 0 && self.settings.defaults == Defaults::LinuxCnc {
            // There, ports that the firmware does not have are no error.
            return Ok(Vec::new());
        }
        let used = self.settings.limit(Gtag::SSERIAL);
        places.truncate(used.unwrap_or(ports).into());
        let serial_ports = &self.settings.serial_ports;
        if let Some((&port, _)) = serial_ports.range(ports..).next() {
            return Err(DriverError::NoSuchPort { port, ports });
        }
        let mut located = Vec::new();
        for PortPlace { gtag, unit, layout } in places {
            let (port, channels) = (layout.instance, layout.channels);
            let mut wanted = serial_ports
                .get(&port)
                .cloned()
                .unwrap_or_default()
                .channels;
            for (channel, config) in wanted.split_off(&channels) {
                if channel >= MAX_CHANNELS || config.presence != Presence::Any {
                    let kind = RemarkKind::NoSuchChannel { channels };
                    return Err(DriverError::Missing(Remark::new(
                        RemoteId::new(port, channel),
                        kind,
                    )));
                }
            }
            // As in LinuxCNC, the pins of unused channels are plain I/O.
            let is_used = |pin: PinDescriptor| {
                let number = pin.secondary_pin & 0x0F;
                let channel = number.checked_sub(1);
                channel.is_none_or(|channel| wanted.contains_key(&channel))
            };
            self.io
                .use_module(&self.firmware, gtag, unit, is_used)
                .map_err(RegisterError::from)?;
            let pins = self.firmware.pins_of(gtag, unit);
            let pins = pins.filter_map(|(number, pin)| Some((pin.sserial_channel()?, number)));
            let pins = pins.filter(|(channel, _)| wanted.contains_key(channel));
            located.push(PortStage {
                pins: pins.collect(),
                port: Port::new(layout),
                configs: wanted,
                remotes: Vec::new(),
                silent: Vec::new(),
            });
        }
        Ok(located)
    }

    /// Resets a port and discovers its remotes, and leaves them in setup mode.
    pub(super) fn discover<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stage: &mut PortStage,
    ) -> Result<(), DriverError> {
        let parameters = stage.port.on(bus).reset()?;
        if parameters.is_old() {
            let (major, minor) = (parameters.major, parameters.minor);
            let first = stage.configs.keys().next().copied().unwrap_or_default();
            let kind = RemarkKind::OldSslbp { major, minor };
            self.remarks.push(stage.remark(first, kind));
        }
        let unusable = self.find_remotes(bus, stage)?;
        let swapped = remark::swapped(&stage.remotes)
            .map(|channel| stage.remark(channel, RemarkKind::Swapped));
        self.remarks.extend(swapped);
        for (channel, kind) in unusable {
            self.do_without(stage, channel, kind)?;
        }
        stage.remotes.sort_by_key(|remote| remote.started.channel);
        Ok(())
    }

    /// Starts the remotes of a port in setup mode, and adds those that are usable to the stage with
    /// their parameters. Returns the other channels in use, with the reason.
    fn find_remotes<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stage: &mut PortStage,
    ) -> Result<Vec<(Channel, RemarkKind)>, DriverError> {
        let start = |channel| Some((channel, stage.config(channel)?.mode));
        let starts: Vec<_> = Channel::ALL.into_iter().filter_map(start).collect();
        let options = DiscoveryOptions {
            tables: &self.tables,
            ..DiscoveryOptions::default()
        };
        let mut unusable = Vec::new();
        for outcome in discover_port(&mut stage.port, bus, &starts, &options)? {
            let outcome = outcome
                .map_err(|failure| (failure.channel, RemarkKind::DidNotStart(failure)))
                .and_then(|discovered| self.candidate(stage, discovered));
            match outcome {
                Ok(mut remote) => {
                    self.read_parameters(bus, &mut stage.port, &mut remote)?;
                    let (watchdog, name) = (remote.watchdog(), remote.descriptor.name);
                    if watchdog.is_slow() {
                        let kind = RemarkKind::SlowWatchdog { name, watchdog };
                        self.remarks.push(Remark::new(remote.label(), kind));
                    }
                    stage.remotes.push(remote);
                }
                Err(missing) => unusable.push(missing),
            }
        }
        Ok(unusable)
    }

    /// Continues without the remote of a channel: an optional one takes part as an absent remote,
    /// any other is missing. A silent part of a card is reported as that, if the other parts are
    /// there.
    fn do_without(
        &mut self,
        stage: &mut PortStage,
        channel: Channel,
        kind: RemarkKind,
    ) -> Result<(), DriverError> {
        match stage.config(channel) {
            Some(config) if config.presence == Presence::Optional => {
                let remote = self.absent(stage, channel, *config)?;
                stage.remotes.push(remote);
                Ok(())
            }
            _ => {
                let remark = stage.remark(channel.index(), kind);
                if remark.is_silent() {
                    stage.silent.push(channel.index());
                }
                let is = |channel, table: &_| remark::is(&stage.remotes, channel, table);
                let part = remark
                    .is_silent()
                    .then(|| remark::silent_part(is, channel.index()));
                let kind = part.flatten().unwrap_or(remark.kind);
                self.miss(stage, channel, kind)
            }
        }
    }

    /// Notes a remote that does not take part. Fails if the machine cannot do without it.
    fn miss(
        &mut self,
        stage: &PortStage,
        channel: Channel,
        kind: RemarkKind,
    ) -> Result<(), DriverError> {
        let missing = stage.remark(channel.index(), kind);
        let config = stage.config(channel);
        if config.is_some_and(|config| config.presence == Presence::Required) {
            return Err(DriverError::Missing(missing));
        }
        self.missing.push(missing);
        Ok(())
    }

    /// Notes a remote that was found, and does not run: it is offline. Fails if the machine cannot
    /// do without it, unless the remote reports a fault, as it does without field power: it may be
    /// what the application has to start for.
    fn offline(
        &mut self,
        stage: &PortStage,
        remote: &RemotePart,
        reason: OfflineReason,
    ) -> Result<(), DriverError> {
        let remark = Remark::new(remote.label(), RemarkKind::Offline { reason });
        let config = stage.config(remote.started.channel);
        let is_required = config.is_some_and(|config| config.presence == Presence::Required);
        let is_reported = matches!(
            reason,
            OfflineReason::FieldPower(_) | OfflineReason::Reported(_)
        );
        if is_required && !is_reported {
            return Err(DriverError::Missing(remark));
        }
        self.remarks.push(remark);
        Ok(())
    }

    /// Makes the pins of a remote, if it is the right one and its tables are understood.
    fn candidate(
        &mut self,
        stage: &PortStage,
        discovered: Discovery,
    ) -> Result<RemotePart, (Channel, RemarkKind)> {
        let descriptor = &discovered.descriptor;
        let channel = discovered.started.channel;
        let expected = stage.config(channel).copied().unwrap_or_default();
        let identity = check_identity(descriptor, expected.kind, expected.unit_number);
        identity.map_err(|error| (channel, RemarkKind::WrongRemote(error)))?;
        let plan = discovered.plan.as_ref();
        let plan = plan.map_err(|problem| (channel, RemarkKind::Tables(problem.clone())))?;
        let table = self.tables.iter().find(|table| table.matches(descriptor));
        let table = table.copied();
        let at = RemoteId::new(stage.number(), channel.index());
        let pins = RemotePins::new(&mut self.pins, &self.name, at, descriptor, plan, table);
        let pins = pins.map_err(|error| (channel, RemarkKind::Pins(error)))?;
        let remarks = remark::on(&discovered, &self.tables, table).into_iter();
        let remarks = remarks.map(|kind| Remark::new(pins.label, kind));
        self.remarks.extend(remarks);
        Ok(RemotePart {
            started: discovered.started,
            descriptor: discovered.descriptor,
            pins,
            offline: None,
        })
    }

    /// Makes an absent remote, of the configured kind and software mode.
    fn absent(
        &mut self,
        stage: &PortStage,
        channel: Channel,
        config: RemoteConfig,
    ) -> Result<RemotePart, AttachError> {
        let (mode, table) = (config.mode, config.kind.unwrap_or(&ANY));
        let unusable = |why| AttachError::Table {
            kind: table.title,
            mode,
            why,
        };
        let descriptor = table.descriptor(mode);
        let descriptor = descriptor.ok_or_else(|| {
            unusable(
                "the table lacks process data of this mode, or finite limits of a number".into(),
            )
        })?;
        let plan = PackingPlan::new(&descriptor, stage.port.layout().interface_registers);
        let plan = plan.map_err(|problem| unusable(problem.to_string()))?;
        let contents = table.contents.iter().find(|contents| contents.mode == mode);
        let mut expected = StartedRemote {
            channel,
            software_mode: mode,
            unit_number: config.unit_number.unwrap_or(descriptor.unit_number),
            name: descriptor.name,
            ptoc: contents.map_or(0, |contents| contents.ptoc),
            gtoc: contents.map_or(0, |contents| contents.gtoc),
            sizes: ProcessDataSizes::default(),
            cs: CsStatus::default(),
        };
        expected.sizes = plan.sizes(expected.has_fault_byte());
        let (at, of) = (RemoteId::new(stage.number(), channel.index()), Some(table));
        let pins = RemotePins::new(&mut self.pins, &self.name, at, &descriptor, &plan, of);
        Ok(RemotePart {
            started: expected,
            pins: pins.map_err(|error| unusable(error.to_string()))?,
            descriptor,
            offline: Some(OfflineReason::Absent),
        })
    }

    /// Reads the parameters of a remote in setup mode. A parameter that cannot be read stays
    /// unknown.
    fn read_parameters<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        port: &mut Port,
        remote: &mut RemotePart,
    ) -> Result<(), DriverError> {
        let channel = remote.started.channel;
        let mut memory = PortLink { port, bus, channel };
        for parameter in &mut remote.pins.parameters {
            match parameter.record.read_parameter(&mut memory) {
                Ok(value) => parameter.publish(&mut self.pins, value.raw),
                Err(ParameterError::Link(error)) => {
                    if let RemoteLinkErrorKind::Bus(error) = error.kind() {
                        return Err(DriverError::Bus(error));
                    }
                }
                Err(_) => {}
            }
        }
        Ok(())
    }

    /// Starts the remotes of a port in normal mode.
    pub(super) fn start<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        stage: &mut PortStage,
    ) -> Result<SerialPort, DriverError> {
        let mut port = stage.port.on(bus);
        port.stop_all()?;
        let there = stage.remotes.iter().filter(|remote| !remote.is_absent());
        let starts: Vec<_> = there
            .map(|remote| &remote.started)
            .map(|is| (is.channel, is.software_mode))
            .collect();
        let mut outcomes = port.start(StartMode::Normal, &starts)?.into_iter();
        let parameters = port.known_parameters()?;
        let mut remotes = Vec::new();
        for mut remote in core::mem::take(&mut stage.remotes) {
            // An absent remote has no outcome.
            if !remote.is_absent()
                && let Some(outcome) = outcomes.next()
            {
                match remark::is_same(&remote.started, outcome) {
                    Ok(found) => remote.started = found,
                    Err(reason) => {
                        self.offline(stage, &remote, reason)?;
                        remote.offline = Some(reason);
                    }
                }
            }
            remotes.push(remote);
        }
        let (now, status) = (bus.now(), self.status);
        let started = StartedPort {
            port: stage.port.clone(),
            parameters,
            remotes,
            at: now,
        };
        let port = self.register(bus, status, |r| SerialPort::register(r, started))?;
        check_port(&port, self.settings.period)?;
        Ok(port)
    }
}
