//! Takes the inventory of a board: firmware, modules, pins, serial ports and their remotes.

use std::error::Error;
use std::time::Duration;

use mesa_hal::boards::REMOTES;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::{
    DataRecord, Discovered, DiscoveryOptions, ModeRecord, ModeType, PortMemory, RemoteDescriptor,
    RemoteTable, discover_port,
};
use mesa_hal::ethernet::Identity;
use mesa_hal::hostmot2::{Gtag, HostMot2, IoPorts};
use mesa_hal::modules::watchdog::WatchdogRegisters;
use mesa_hal::remote::ParameterValue;
use mesa_hal::sslbp::{Channel, Layout, Port, PortParameters};

use mesa_hal::runner::Stop;

/// Everything that was found.
pub struct Report {
    pub identity: Option<Identity>,
    pub firmware: HostMot2,
    pub ports: Vec<PortReport>,
}

/// One serial port.
pub struct PortReport {
    pub number: u8,
    pub parameters: PortParameters,
    pub channels: Vec<ChannelReport>,
}

/// One channel of a serial port.
pub struct ChannelReport {
    pub number: u8,
    pub remote: Result<RemoteReport, String>,
}

/// A remote and what it tells about itself.
pub struct RemoteReport {
    pub descriptor: RemoteDescriptor,
    pub table: Option<&'static RemoteTable>,
    pub built_in: bool,
    pub sizes: (u8, u8),
    pub parameters: Vec<(DataRecord, Result<ParameterValue, String>)>,
    pub problems: Vec<String>,
    /// Where it differs from the table.
    pub differences: Vec<String>,
    pub accesses: u32,
}

impl RemoteReport {
    /// What was found, and what its parameters are.
    fn new<B: RegisterBus + Clock>(bus: &mut B, port: &mut Port, found: Discovered) -> Self {
        let descriptor = found.descriptor;
        let channel = found.started.channel;
        let mut memory = PortMemory { port, bus, channel };
        let parameters = descriptor.parameters.iter().map(|record| {
            let value = record.read_parameter(&mut memory);
            (record.clone(), value.map_err(|error| error.to_string()))
        });
        let parameters = parameters.collect();
        let problems = found.problems.iter().map(ToString::to_string);
        let table = REMOTES.into_iter().find(|table| table.matches(&descriptor));
        let differences = table.map(|table| table.differences(&descriptor));
        let differences = differences.unwrap_or_default();
        Self {
            table,
            differences: differences.iter().map(ToString::to_string).collect(),
            built_in: found.started.ptoc == 0,
            sizes: (found.started.sizes.rx, found.started.sizes.tx),
            parameters,
            problems: problems.chain(found.read_error).collect(),
            accesses: found.accesses,
            descriptor,
        }
    }

    /// The modes, software modes first.
    pub fn modes(&self) -> impl Iterator<Item = &ModeRecord> {
        self.descriptor.modes.iter()
    }
}

impl Report {
    /// Whether every remote that was to be started in a mode runs in it, and has it.
    pub fn check_modes(&self, modes: &Modes) -> Result<(), String> {
        for &(port, channel, mode) in modes {
            let ports = self.ports.iter().filter(|found| found.number == port);
            let mut channels = ports.flat_map(|found| &found.channels);
            let Some(found) = channels.find(|found| found.number == channel) else {
                continue;
            };
            let place = format!("port {port}, channel {channel}");
            let remote = found.remote.as_ref().map_err(|reason| {
                format!("{place}: nothing started in software mode {mode}: {reason}")
            })?;
            let known: Vec<String> = remote
                .modes()
                .filter(|known| known.mode_type == ModeType::Software)
                .map(|known| format!("{} ({})", known.index, known.name))
                .collect();
            let prefix = format!("{mode} (");
            if !known.is_empty() && !known.iter().any(|known| known.starts_with(&prefix)) {
                return Err(format!(
                    "{place}: the {} has no software mode {mode}; it has {}; ask for one of these",
                    remote.descriptor.name,
                    known.join(", ")
                ));
            }
        }
        Ok(())
    }
}

/// The software modes to start remotes in: port, channel, mode.
pub type Modes = Vec<(u8, u8, u8)>;

/// Takes the inventory. Stops the serial ports and leaves all pins as inputs. When it is told to
/// stop, the ports that are left are left out.
pub fn take<B: RegisterBus + Clock>(
    bus: &mut B,
    identity: Option<Identity>,
    modes: &Modes,
    stop: &Stop,
) -> Result<Report, Box<dyn Error>>
where
    B::Error: Send + Sync,
{
    let firmware = HostMot2::identify(bus)?;
    check_modes(&firmware, modes)?;
    let mut ports = Vec::new();
    for (gtag, number) in serial_ports(&firmware) {
        if stop.signal().is_some() {
            break;
        }
        ports.push(take_port(bus, &firmware, gtag, number, modes)?);
    }
    Ok(Report {
        identity,
        firmware,
        ports,
    })
}

/// A mode for a channel that does not exist is a slip of the pen.
fn check_modes(firmware: &HostMot2, modes: &Modes) -> Result<(), String> {
    for &(port, channel, mode) in modes {
        let channels = serial_ports(firmware).filter(|&(_, number)| number == port);
        let channels = channels.map(|(gtag, _)| firmware.sserial_channels(gtag, port));
        let ask = format!("leave --mode {port}.{channel}={mode} out, or correct it");
        match channels.max() {
            None => {
                let ports = serial_ports(firmware).count();
                return Err(format!(
                    "no serial port {port}, the firmware has {ports}; {ask}"
                ));
            }
            Some(channels) if channel >= channels => {
                return Err(format!(
                    "no channel {channel} on serial port {port}, which has {channels}; {ask}"
                ));
            }
            Some(_) => {}
        }
    }
    Ok(())
}

/// The serial ports of the firmware, by module and number.
fn serial_ports(firmware: &HostMot2) -> impl Iterator<Item = (Gtag, u8)> {
    [Gtag::SSERIAL, Gtag::SSERIAL_B]
        .into_iter()
        .flat_map(|gtag| {
            let instances = firmware.find(gtag).map_or(0, |module| module.instances);
            (0..instances).map(move |number| (gtag, number))
        })
}

fn take_port<B: RegisterBus + Clock>(
    bus: &mut B,
    firmware: &HostMot2,
    gtag: Gtag,
    number: u8,
    modes: &Modes,
) -> Result<PortReport, Box<dyn Error>>
where
    B::Error: Send + Sync,
{
    let mut io_ports = IoPorts::locate(firmware)?;
    let inputs = io_ports.clone();
    let watchdog = WatchdogRegisters::locate(firmware)?;
    // A bite in the middle of discovery would turn the pins of the port into inputs; when nobody
    // is left to do that, it shall.
    bus.write(watchdog.time, watchdog.time_for(AT_MOST))?;
    bus.write(watchdog.reset, WatchdogRegisters::PET)?;
    bus.write(watchdog.status, 0)?;
    io_ports.use_module(firmware, gtag, number, |_| true)?;
    io_ports.apply(bus)?;
    let taken = take_channels(bus, firmware, gtag, number, modes);
    // Also when that has failed; what it failed of is worth more than what this may fail of.
    let restored = inputs.apply(bus);
    let report = taken?;
    restored?;
    bus.write(watchdog.time, WatchdogRegisters::DISABLED)?;
    Ok(report)
}

/// Longer than the inventory of a port takes, however bad its wires are.
const AT_MOST: Duration = Duration::from_secs(40);

fn take_channels<B: RegisterBus + Clock>(
    bus: &mut B,
    firmware: &HostMot2,
    gtag: Gtag,
    number: u8,
    modes: &Modes,
) -> Result<PortReport, Box<dyn Error>>
where
    B::Error: Send + Sync,
{
    let channels = firmware.sserial_channels(gtag, number);
    let module = firmware.require(gtag)?;
    let mut port = Port::new(Layout::new(module, number, channels)?);
    let taken = take_remotes(bus, &mut port, modes);
    // Also when that has failed: nothing is left running.
    let stopped = port.on(bus).stop_all();
    let report = taken?;
    stopped?;
    Ok(report)
}

fn take_remotes<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    modes: &Modes,
) -> Result<PortReport, Box<dyn Error>>
where
    B::Error: Send + Sync,
{
    let (number, channels) = (port.layout().instance, port.layout().channels);
    let parameters = port.on(bus).reset()?;
    let starts: Vec<(Channel, u8)> = (0..channels)
        .filter_map(Channel::new)
        .map(|channel| {
            let wanted = |m: &&(u8, u8, u8)| (m.0, m.1) == (number, channel.index());
            let mode = modes.iter().rev().find(wanted).map_or(0, |m| m.2);
            (channel, mode)
        })
        .collect();
    let options = DiscoveryOptions {
        tables: &REMOTES,
        ..DiscoveryOptions::default()
    };
    let mut channels = Vec::new();
    for (&(channel, _), found) in starts
        .iter()
        .zip(discover_port(port, bus, &starts, &options)?)
    {
        let found = found.map_err(|failure| failure.reason.to_string());
        channels.push(ChannelReport {
            number: channel.index(),
            remote: found.map(|found| RemoteReport::new(bus, port, found)),
        });
    }
    Ok(PortReport {
        number,
        parameters,
        channels,
    })
}
