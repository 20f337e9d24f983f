//! Discovery of all remotes of a port.

use super::{
    Discovered, DiscoveryOptions, ModeType, PortMemory, ProblemKind, RemoteDescriptor, Table,
    discover,
};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, LocalLocation, Port, PortResult, RemoteAccess, RemoteFaults, StartFailure,
        StartMode, StartedRemote,
    },
};
use alloc::{string::ToString, vec::Vec};

/// Stops the port, starts `channels` in setup mode and discovers what is there; in their order, with
/// the reason where nothing started.
///
/// Leaves the port in setup mode, so that parameters can be read and written. A remote whose tables
/// are damaged does not disturb the others.
///
/// Manual: 7I77, "DISCOVERY SEQUENCE".
///
/// # Errors
/// The port or the bus failed.
pub fn discover_port<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    channels: &[(Channel, u8)],
    options: &DiscoveryOptions<'_>,
) -> PortResult<Vec<Result<Discovered, StartFailure>>, B> {
    port.stop_all(bus)?;
    let report = port.start(bus, StartMode::Setup, channels)?;
    let outcomes = channels
        .iter()
        .filter_map(|&(channel, _)| report.outcome(channel));
    Ok(outcomes
        .map(|outcome| outcome.map(|started| discover_remote(port, bus, &started, options)))
        .collect())
}

fn discover_remote<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    started: &StartedRemote,
    options: &DiscoveryOptions<'_>,
) -> Discovered {
    let registers = port.layout().interface_registers;
    let channel = started.channel;
    let shown = show_tables(port, bus, started);
    let mut memory = PortMemory { port, bus, channel };
    let mut found = discover(&mut memory, started, registers, options);
    let is_legal = has_mode(memory.port, memory.bus, started, &found.descriptor);
    if let Ok(false) = is_legal {
        let modes = software_modes(&found.descriptor);
        let kind = ProblemKind::IllegalSoftwareMode {
            mode: started.software_mode,
            known: modes.collect(),
        };
        found.note(Table::Process, started.ptoc, kind);
    }
    for error in [shown.err(), is_legal.err()].into_iter().flatten() {
        found.read_error.get_or_insert(error.to_string());
    }
    found
}

/// A host that ended in the middle of an access to non-volatile memory has left that memory where
/// the tables are; a START does not change that. FACTS 6.3.
fn show_tables<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    started: &StartedRemote,
) -> PortResult<(), B> {
    if started.ptoc == 0 && started.gtoc == 0 {
        return Ok(());
    }
    let select = RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 0);
    port.access(bus, started.channel, select).map(drop)
}

fn software_modes(descriptor: &RemoteDescriptor) -> impl Iterator<Item = u8> {
    let modes = descriptor.modes.iter();
    modes
        .filter(|known| known.mode_type == ModeType::Software)
        .map(|known| known.index)
}

/// Whether the remote is in the software mode it was started in.
///
/// A setup START does not look at the fault byte, and so succeeds in a software mode that the
/// remote does not have (FACTS 4.1); the tables are then those of another mode.
fn has_mode<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    started: &StartedRemote,
    descriptor: &RemoteDescriptor,
) -> PortResult<bool, B> {
    /// What is written to [`LocalLocation::CLEAR_FAULTS`].
    const CLEAR: u8 = 0xFF;
    let (channel, mode) = (started.channel, started.software_mode);
    let mut known = software_modes(descriptor).peekable();
    if known.peek().is_some() && !known.any(|known| known == mode) {
        return Ok(false);
    }
    if started.ptoc == 0 {
        // Remotes older than discovery have one mode.
        return Ok(true);
    }
    if is_accepted(port, bus, channel)? {
        return Ok(true);
    }
    // The fault may be left from an earlier START: nothing has cleared it since.
    let clear = RemoteAccess::WriteLocal(LocalLocation::CLEAR_FAULTS, CLEAR);
    port.access(bus, channel, clear)?;
    let select = RemoteAccess::WriteLocal(LocalLocation::SOFTWARE_MODE, mode);
    port.access(bus, channel, select)?;
    is_accepted(port, bus, channel)
}

fn is_accepted<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    channel: Channel,
) -> PortResult<bool, B> {
    let read = RemoteAccess::ReadLocal(LocalLocation::FAULTS);
    let faults = port.access(bus, channel, read)? as u8;
    let faults = RemoteFaults::from_bits_retain(faults);
    Ok(!faults.contains(RemoteFaults::ILLEGAL_MODE))
}
