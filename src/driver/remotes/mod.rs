//! Remotes while a board is configured: what discovery found, their parameters, their handles.

mod ports;

pub(super) use ports::PortStage;

use alloc::string::ToString;
use alloc::vec::Vec;

use super::configure::Plan;
use super::parameters::{ParameterWrite, RemoteParameterError, check_watchdog};
use super::{MissingRemote, Remark, RemoteConfig, StartError};
use crate::boards::{AttachError, RemoteHandles};
use crate::bus::{Clock, RegisterBus};
use crate::discovery::{PackingPlan, PortMemory, RemoteTable};
use crate::hal::AnyValue;
use crate::modules::serial::FoundRemote;
use crate::remote::{ParameterError, ParameterValue, RemoteLocation, RemotePins};
use crate::sslbp::{Channel, CsStatus, ProcessDataSizes, ReplyFormat, StartedRemote};

/// The remotes of a board that is being configured. They are in setup mode: nothing is driven, and
/// parameters can be read and written.
#[derive(Debug)]
pub struct Remotes<'a, B> {
    bus: &'a mut B,
    plan: &'a mut Plan,
    ports: &'a mut [PortStage],
}

/// One remote in setup mode.
#[derive(Debug)]
pub struct RemoteInSetup<'a, B> {
    bus: &'a mut B,
    plan: &'a mut Plan,
    port: &'a mut PortStage,
    place: usize,
}

impl<'a, B: RegisterBus + Clock> Remotes<'a, B> {
    pub(super) fn new(bus: &'a mut B, plan: &'a mut Plan, ports: &'a mut [PortStage]) -> Self {
        Self { bus, plan, ports }
    }

    /// The remote on `channel` (0 to 7) of `port`, to read and write its parameters.
    ///
    /// # Errors
    /// [`StartError::NoRemote`] if none takes part there now.
    pub fn at(
        &mut self,
        port: u8,
        channel: u8,
    ) -> Result<RemoteInSetup<'_, B>, StartError<B::Error>> {
        let stage = self.ports.get_mut(usize::from(port));
        let found = stage.and_then(|stage| {
            let place = stage.place(channel).filter(|found| !found.1.is_absent)?.0;
            Some((stage, place))
        });
        let (stage, place) = found.ok_or(StartError::NoRemote { port, channel })?;
        Ok(RemoteInSetup {
            bus: self.bus,
            plan: self.plan,
            port: stage,
            place,
        })
    }

    /// All that take part, port by port.
    pub fn iter(&self) -> impl Iterator<Item = (u8, &FoundRemote)> {
        let stages = self.ports.iter();
        stages.flat_map(|stage| {
            stage
                .remotes
                .iter()
                .map(move |found| (stage.number(), found))
        })
    }

    /// Remotes that were configured and do not take part, with the reason. They are looked for
    /// again at the next start; see [`Presence::Optional`](super::Presence::Optional).
    pub fn missing(&self) -> &[MissingRemote] {
        &self.plan.missing
    }

    /// What is odd about the remotes that take part.
    pub fn remarks(&self) -> &[Remark] {
        &self.plan.remarks
    }
}

impl<B: RegisterBus + Clock> RemoteInSetup<'_, B> {
    /// Reads a parameter from the remote. `name` is as the remote spells it, or as LinuxCNC does.
    ///
    /// # Errors
    /// [`StartError::RemoteParameter`]: the remote does not have it, or the access failed.
    pub fn read(&mut self, name: &str) -> Result<ParameterValue, StartError<B::Error>> {
        let (port, channel) = self.location();
        let Some(found) = self.port.remotes.get_mut(self.place) else {
            return Err(self.failed(
                name,
                RemoteParameterError::NoSuchParameter { port, channel },
            ));
        };
        let Some(record) = found.descriptor.parameter(name) else {
            return Err(self.failed(
                name,
                RemoteParameterError::NoSuchParameter { port, channel },
            ));
        };
        let mut memory = PortMemory {
            port: &mut self.port.port,
            bus: self.bus,
            channel,
        };
        let result = record.read_parameter(&mut memory);
        result.map_err(|error| self.failed(name, error.into()))
    }

    /// Writes a parameter that the remote keeps, for example `NVWatchDogTimeout`, and reads it back.
    /// `name` is as the remote spells it, or as LinuxCNC does.
    ///
    /// A non-volatile one is written only if it is another than before, and the remote uses it from
    /// its next power-up on.
    ///
    /// # Errors
    /// [`StartError::RemoteParameter`]: the remote does not have it, or can not take the value; or
    /// it is a watchdog's, and shorter than what the period feeds.
    pub fn write(
        &mut self,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Result<(), StartError<B::Error>> {
        let value = value.into();
        let written = self.write_checked(name, value);
        written.map_err(|source| self.failed(name, source))
    }

    fn write_checked(
        &mut self,
        name: &str,
        value: AnyValue,
    ) -> Result<(), RemoteParameterError<B::Error>> {
        let location = self.location();
        check_watchdog(name, value, self.plan.settings.period)?;
        let (port, channel) = location;
        let Some(found) = self.port.remotes.get_mut(self.place) else {
            return Err(RemoteParameterError::NoSuchParameter { port, channel });
        };
        let write = ParameterWrite::new(location, &found.pins, name, value)?;
        write.write(self.bus, &mut self.port.port, channel)?;
        if let Some(parameter) = found.pins.parameters.get_mut(write.place) {
            parameter.publish(&mut self.plan.pins, write.raw);
        }
        Ok(())
    }

    fn location(&self) -> (u8, Channel) {
        let found = self.port.remotes.get(self.place);
        let channel = found.map_or(Channel::ALL[0], |found| found.started.channel);
        (self.port.number(), channel)
    }

    fn failed(&self, name: &str, source: RemoteParameterError<B::Error>) -> StartError<B::Error> {
        let (port, channel) = self.location();
        StartError::RemoteParameter {
            port,
            channel: channel.index(),
            name: name.into(),
            source,
        }
    }
}

/// What nothing is known of.
const ANY: RemoteTable = RemoteTable::new("remote of any kind", [0; 4], &[]);

/// Handles of remotes.
impl Plan {
    pub fn attach<T: RemoteHandles>(
        &self,
        ports: &[PortStage],
        (port, channel): (u8, u8),
    ) -> Result<T, AttachError> {
        let stage = ports.get(usize::from(port));
        let found = stage.and_then(|stage| stage.place(channel));
        let Some((_, found)) = found else {
            let expected = T::TABLE.title;
            return Err(AttachError::NoRemote {
                port,
                channel,
                expected,
            });
        };
        let names = (&*self.pins, &*found.pins.prefix);
        RemoteTable::attach(names, &found.descriptor, (port, channel))
    }

    /// Makes the pins of a remote that is not there, if none is there: of this kind, and in the
    /// software mode it is configured for.
    pub fn make_optional(
        &mut self,
        stage: &mut PortStage,
        number: u8,
        config: RemoteConfig,
    ) -> Result<(), AttachError> {
        if stage.place(number).is_some() {
            return Ok(());
        }
        let port = stage.number();
        let RemoteConfig { mode, kind, .. } = config;
        let table = kind.unwrap_or(&ANY);
        let channel = Channel::new(number).filter(|_| number < stage.port.layout().channels);
        let Some(channel) = channel else {
            return Err(AttachError::NoRemote {
                port,
                channel: number,
                expected: table.title,
            });
        };
        let unusable = |why| AttachError::Table {
            kind: table.title,
            mode,
            why,
        };
        let descriptor = table.descriptor(mode);
        let descriptor =
            descriptor.ok_or_else(|| unusable("it does not say all of its process data".into()))?;
        let packing = PackingPlan::new(&descriptor, stage.port.layout().interface_registers);
        let packing = packing.map_err(|problem| unusable(problem.to_string()))?;
        let contents = table.contents.iter().find(|contents| contents.mode == mode);
        let mut started = StartedRemote {
            channel,
            software_mode: mode,
            unit_number: descriptor.unit_number,
            name: descriptor.name,
            ptoc: contents.map_or(0, |contents| contents.ptoc),
            gtoc: contents.map_or(0, |contents| contents.gtoc),
            sizes: ProcessDataSizes {
                rx: packing.input_bytes() as u8,
                tx: packing.output_bytes() as u8,
            },
            cs: CsStatus::default(),
        };
        if started.reply_format() == ReplyFormat::FaultByteFirst {
            started.sizes.rx += 1;
        }
        let location = RemoteLocation {
            board: &self.name,
            port,
            channel: number,
        };
        let pins = &mut self.pins;
        let pins = RemotePins::new(pins, location, &descriptor, &packing, Some(table));
        let pins = pins.map_err(|error| unusable(error.to_string()))?;
        let is_it = |missing: &MissingRemote| (missing.port, missing.channel) == (port, channel);
        self.missing.retain(|missing| !is_it(missing));
        stage.remotes.push(FoundRemote {
            started,
            descriptor,
            problems: Vec::new(),
            pins,
            is_absent: true,
        });
        stage.remotes.sort_by_key(|found| found.started.channel);
        Ok(())
    }
}

impl<E: crate::bus::BusError> From<ParameterError<crate::sslbp::PortError<E>>>
    for RemoteParameterError<E>
{
    fn from(error: ParameterError<crate::sslbp::PortError<E>>) -> Self {
        match error {
            ParameterError::Memory(error) => Self::Port(error),
            error => Self::Parameter(error),
        }
    }
}
