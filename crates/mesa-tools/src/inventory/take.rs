//! Taking an inventory: identification, then discovery port by port.

use core::time::Duration;
use std::collections::BTreeMap;

use super::error::Taken;
use super::remote::take_remote;
use super::setup_position::{self, take_silent};
use super::{
    ChannelContent, Inventory, InventoryChannel, InventoryError, InventoryEthernet,
    InventoryFirmware, InventoryModule, InventoryPin, InventoryPort, PinDirection, terminals,
};
use crate::advice::{told, with_advice};
use crate::diagnosis::board::t_board;
use mesa_hal::boards::REMOTES;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::discovery::{Discovery, DiscoveryOptions, RemoteTable, discover_port};
use mesa_hal::driver::silent_part;
use mesa_hal::hostmot2::{HostMot2, IoPorts, PinDescriptor};
use mesa_hal::modules::undriven;
use mesa_hal::modules::watchdog::WatchdogRegisters;
use mesa_hal::sslbp::{
    Channel as Line, ComState, CsStatus, Port, PortLayout, PortParameters, PortPlace, StartFailure,
    StartFailureReason,
};
use mesa_hal::{MesaError, RemoteId, advice};

/// Watchdog time during the inventory of a port: longer than the inventory takes with the worst
/// wiring.
const AT_MOST: Duration = Duration::from_secs(40);

/// Takes the inventory of a board.
///
/// `modes` contains the software modes in which remotes are started; others start in mode zero.
/// `goes_on` is called before each port; once it returns false, the remaining ports are left out.
///
/// The inventory stops the serial ports and leaves all pins as inputs: not for a running machine.
///
/// # Errors
/// [`InventoryError`].
///
/// # Real time
/// Not for the cycle. Bounded; up to some seconds with many remotes.
pub fn take<B: RegisterBus + Clock>(
    bus: &mut B,
    mut ethernet: Option<InventoryEthernet>,
    modes: &BTreeMap<RemoteId, u8>,
    mut goes_on: impl FnMut() -> bool,
) -> Taken<Inventory> {
    let firmware = HostMot2::identify(bus)?;
    if let Some(ethernet) = &mut ethernet {
        if firmware.idrom.is_7i97t() {
            ethernet.identity.set_7i97t();
        }
        ethernet.t_board = t_board(&ethernet.identity.card, &firmware.idrom);
    }
    check_modes(&firmware, modes)?;
    let left = left_behind(bus, &firmware)?;
    let (mut ports, mut findings) = (Vec::new(), Vec::from_iter(left));
    let undriven = undriven(&firmware, &[]);
    findings.extend(
        undriven
            .iter()
            .map(|one| with_advice(one, one.reason.advice())),
    );
    for place in PortLayout::ports(&firmware) {
        if !goes_on() {
            break;
        }
        let port = PortOf {
            firmware: &firmware,
            place,
            modes,
        };
        let (port, odd) = port.take(bus)?;
        ports.push(port);
        findings.extend(odd);
    }
    let mut inventory = Inventory {
        findings,
        ethernet,
        firmware: of_firmware(&firmware),
        serial_ports: ports,
    };
    inventory.judge();
    Ok(inventory)
}

/// State left behind by a program that ended without stopping the board: read before anything is
/// changed.
fn left_behind<B: RegisterBus>(bus: &mut B, firmware: &HostMot2) -> Taken<Option<String>> {
    let bus_failed = InventoryError::Bus;
    let watchdog = WatchdogRegisters::locate(firmware)?;
    let status = bus.read(watchdog.status).map_err(bus_failed)?;
    let drives = IoPorts::locate(firmware)?.drives(bus);
    let drives = drives.map_err(bus_failed)?;
    let mut runs = false;
    for PortPlace { layout, .. } in PortLayout::ports(firmware) {
        for line in (0..layout.channels).filter_map(Line::new) {
            let Some(cs) = layout.cs(line) else {
                continue;
            };
            let cs = CsStatus(bus.read(cs).map_err(bus_failed)?);
            // A remote in setup mode drives nothing, so it does not count as running.
            runs |= matches!(cs.state(), ComState::Chatter | ComState::ProcessData);
        }
    }
    let has_bitten = status & WatchdogRegisters::HAS_BIT != 0;
    // A watchdog bite turns all pins into inputs, so present outputs were configured after it.
    Ok(match (drives, runs, has_bitten) {
        (false, false, _) => None,
        (false, true, true) => Some(
            "it was not stopped: the program that drove it was killed, or its packets did not arrive. \
             The board's watchdog has bitten, so that its own outputs are off; those of a remote are off \
             by its own watchdog. The ports are stopped by now"
                .to_owned(),
        ),
        _ => Some(
            "it was not stopped, and nothing has switched it off: outputs may have been on until this \
             looked. They are off by now, those of a remote by its own watchdog"
                .to_owned(),
        ),
    })
}

/// Refuses a mode for a channel that does not exist, which is a typing error.
fn check_modes(firmware: &HostMot2, modes: &BTreeMap<RemoteId, u8>) -> Taken<()> {
    let places = PortLayout::ports(firmware);
    for &RemoteId { port, channel } in modes.keys() {
        let place = places.get(usize::from(port));
        match place.map(|place| place.layout.channels) {
            None => {
                let ports = places.len() as u8;
                return Err(InventoryError::NoSuchPort { port, ports });
            }
            Some(channels) if channel >= channels => {
                return Err(InventoryError::NoSuchChannel {
                    port,
                    channel,
                    channels,
                });
            }
            Some(_) => {}
        }
    }
    Ok(())
}

pub(crate) fn of_firmware(firmware: &HostMot2) -> InventoryFirmware {
    let idrom = &firmware.idrom;
    let modules = firmware.modules.iter().map(|module| InventoryModule {
        module: module.gtag.to_string(),
        gtag: module.gtag.0,
        version: module.version,
        instances: module.instances,
        base: module.base,
        clock_hz: module.clock_hz,
    });
    let pins = (0..).zip(&firmware.pins).map(|(number, pin)| {
        let terminals = terminals::of(firmware, usize::from(number), *pin);
        one_pin(number, terminals, *pin)
    });
    let local_pins = (0..).zip(&firmware.local_pins);
    let local_pins = local_pins.map(|(number, pin)| one_pin(number, String::new(), *pin));
    InventoryFirmware {
        board: idrom.board_name.clone(),
        io_pins: idrom.io_width,
        connectors: idrom.io_ports,
        clock_low_hz: idrom.clock_low_hz,
        clock_high_hz: idrom.clock_high_hz,
        warnings: firmware.warnings.clone(),
        modules: modules.collect(),
        trailing: firmware.trailing.iter().map(ToString::to_string).collect(),
        pins: pins.collect(),
        local_pins: local_pins.collect(),
    }
}

fn one_pin(number: u16, terminals: String, pin: PinDescriptor) -> InventoryPin {
    InventoryPin {
        number,
        terminals,
        function: pin.to_string(),
        direction: match (pin.has_module(), pin.is_output()) {
            (true, true) => PinDirection::Out,
            (true, false) => PinDirection::In,
            (false, _) => PinDirection::Either,
        },
        driven_by_module: pin.is_output(),
    }
}

/// A port, and findings about its channels.
type PortTaken = (InventoryPort, Vec<String>);

/// A serial port of the firmware, and the software modes to start remotes in.
#[derive(Clone, Copy)]
struct PortOf<'a> {
    firmware: &'a HostMot2,
    place: PortPlace,
    modes: &'a BTreeMap<RemoteId, u8>,
}

impl PortOf<'_> {
    fn take<B: RegisterBus + Clock>(self, bus: &mut B) -> Taken<PortTaken> {
        let bus_failed = InventoryError::Bus;
        let mut io_ports = IoPorts::locate(self.firmware)?;
        let inputs = io_ports.clone();
        let watchdog = WatchdogRegisters::locate(self.firmware)?;
        // A bite during discovery would turn the port's pins into inputs, hence the long time. If
        // this program ends early, the bite is wanted.
        for (address, word) in [
            (watchdog.time, watchdog.time_for(AT_MOST)),
            (watchdog.reset, WatchdogRegisters::PET),
            (watchdog.status, 0),
        ] {
            bus.write(address, word).map_err(bus_failed)?;
        }
        let PortPlace { gtag, unit, .. } = self.place;
        io_ports.use_module(self.firmware, gtag, unit, |_| true)?;
        io_ports.apply(bus).map_err(bus_failed)?;
        let taken = self.take_channels(bus);
        // Restored after a failure as well; the error of that failure then takes precedence.
        let restored = inputs.apply(bus);
        let port = taken?;
        restored.map_err(bus_failed)?;
        let disabled = bus.write(watchdog.time, WatchdogRegisters::DISABLED);
        disabled.map_err(bus_failed)?;
        Ok(port)
    }

    fn take_channels<B: RegisterBus + Clock>(self, bus: &mut B) -> Taken<PortTaken> {
        let mut port = Port::new(self.place.layout);
        let taken = take_remotes(bus, &mut port, self.modes);
        // Stopped after a failure as well, so that nothing is left running.
        let stopped = port.on(bus).stop_all();
        let report = taken?;
        stopped?;
        Ok(report)
    }
}

fn take_remotes<B: RegisterBus + Clock>(
    bus: &mut B,
    port: &mut Port,
    modes: &BTreeMap<RemoteId, u8>,
) -> Taken<PortTaken> {
    let (number, channels) = (port.layout().instance, port.layout().channels);
    let parameters = port.on(bus).reset()?;
    let lines = (0..channels).filter_map(Line::new);
    let mode = |line: Line| modes.get(&RemoteId::new(number, line.index())).copied();
    let starts: Vec<_> = lines.map(|line| (line, mode(line).unwrap_or(0))).collect();
    let options = DiscoveryOptions {
        tables: &REMOTES,
        ..DiscoveryOptions::default()
    };
    let outcomes = discover_port(port, bus, &starts, &options)?;
    let failures = starts.iter().zip(&outcomes).filter_map(|(start, outcome)| {
        let failure = outcome.as_ref().err()?;
        Some((*start, failure.reason))
    });
    let silent: Vec<_> = failures
        .clone()
        .filter_map(|(start, reason)| (reason == StartFailureReason::NoReply).then_some(start))
        .collect();
    let odd = failures.filter_map(|((line, _), reason)| {
        let odd = not_started(&starts, &outcomes, line, reason)?;
        Some((line, odd))
    });
    let mut odd: Vec<_> = odd.collect();
    let old = parameters.is_old().then(|| {
        let (major, minor) = (parameters.major, parameters.minor);
        let why = PortParameters::OLD_VERSION;
        let facts = format_args!("port {number} has SSLBP {major}.{minor}: {why}");
        with_advice(facts, Some(advice::LOAD_NEWER_FIRMWARE))
    });
    let mut channels = Vec::new();
    for (&(line, _), outcome) in starts.iter().zip(outcomes) {
        channels.push(InventoryChannel {
            channel: line.index(),
            found: match outcome {
                Ok(found) => ChannelContent::Remote(Box::new(take_remote(bus, port, found))),
                Err(failure) => ChannelContent::NotStarted(told(&failure.reason)),
            },
        });
    }
    for (line, remote) in take_silent(bus, port, &silent, &options)? {
        odd.retain(|(other, _)| *other != line);
        odd.push((line, setup_position::finding(&remote)));
        let mut channels = channels.iter_mut();
        if let Some(channel) = channels.find(|channel| channel.channel == line.index()) {
            channel.found = ChannelContent::Remote(Box::new(remote));
        }
    }
    let odd = odd
        .into_iter()
        .map(|(line, odd)| format!("{}: {odd}", RemoteId::new(number, line.index())));
    let findings = old.into_iter().chain(odd).collect();
    let port = InventoryPort {
        port: number,
        sslbp: format!("{}.{}", parameters.major, parameters.minor),
        clock_hz: parameters.clock_hz,
        channels,
    };
    Ok((port, findings))
}

/// Finding about a channel on which nothing started. An empty channel is in order; a remote that
/// answers has to start, and so has each part of a card of which another part started.
fn not_started(
    starts: &[(Line, u8)],
    outcomes: &[Result<Discovery, StartFailure>],
    line: Line,
    reason: StartFailureReason,
) -> Option<String> {
    if reason != StartFailureReason::NoReply {
        return Some(format!("nothing started: {}", told(&reason)));
    }
    let is = |channel, table: &RemoteTable| {
        let mut all = starts.iter().zip(outcomes);
        all.any(|((line, _), outcome)| {
            let found = outcome.as_ref();
            Some(line.index()) == channel
                && found.is_ok_and(|found| table.matches(&found.descriptor))
        })
    };
    silent_part(is, line.index()).map(|kind| told(&kind))
}
