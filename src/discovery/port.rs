//! Discovery of all remotes of a port.

use super::{Discovery, DiscoveryOptions, ModeType, ProblemKind, Table, discover};
use crate::{
    bus::{Clock, RegisterBus},
    lbp::{RemoteLink, RemoteLinkError},
    sslbp::{
        Channel, LocalLocation, Port, PortLink, PortResult, RemoteAccess, RemoteFaults,
        StartFailure, StartMode, StartedRemote,
    },
};
use alloc::{string::ToString, vec::Vec};

/// Stops the port, starts `channels` in setup mode and discovers the remotes there. The results are
/// in the order of `channels`; a channel on which no remote started has the reason instead.
///
/// Leaves the port in setup mode, so that parameters can be read and written. A remote with damaged
/// tables does not disturb the others.
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
) -> PortResult<Vec<Result<Discovery, StartFailure>>> {
    port.on(bus).stop_all()?;
    let outcomes = port.on(bus).start(StartMode::Setup, channels)?.into_iter();
    Ok(outcomes
        .map(|outcome| outcome.map(|started| discover_remote(port, bus, &started, options)))
        .collect())
}

fn discover_remote<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    started: &StartedRemote,
    options: &DiscoveryOptions<'_>,
) -> Discovery {
    let registers = port.layout().interface_registers;
    let channel = started.channel;
    let mut memory = PortLink { port, bus, channel };
    let shown = show_tables(&mut memory, started);
    let mut found = discover(&mut memory, started, registers, options);
    let modes = found.descriptor.modes.iter();
    let modes = modes.filter(|known| known.mode_type == ModeType::Software);
    let known: Vec<u8> = modes.map(|known| known.index).collect();
    let is_legal = has_mode(&mut memory, started, &known);
    if let Ok(false) = is_legal {
        let mode = started.software_mode;
        let kind = ProblemKind::IllegalSoftwareMode { mode, known };
        found.note(Table::Process, started.ptoc, kind);
    }
    for error in [shown.err(), is_legal.err()].into_iter().flatten() {
        found.read_error.get_or_insert(error.to_string());
    }
    found
}

/// Selects the memory that contains the tables. A host that ended during an access to non-volatile
/// memory has left that memory selected in its place; a START does not change that. FACTS 6.3.
fn show_tables<M: RemoteLink>(
    memory: &mut M,
    started: &StartedRemote,
) -> Result<(), RemoteLinkError> {
    if started.ptoc == 0 && started.gtoc == 0 {
        return Ok(());
    }
    let select = RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, 0);
    memory.access(None, select).map(drop)
}

/// True if the remote is in the software mode in which it was started, and lists that mode if it
/// lists any.
///
/// A setup START does not check the fault byte, and so succeeds in a software mode that the remote
/// does not have (FACTS 4.1); the tables are then those of another mode.
fn has_mode<M: RemoteLink>(
    memory: &mut M,
    started: &StartedRemote,
    known: &[u8],
) -> Result<bool, RemoteLinkError> {
    /// Value written to [`LocalLocation::CLEAR_FAULTS`].
    const CLEAR: u8 = 0xFF;
    let mode = started.software_mode;
    if !known.is_empty() && !known.contains(&mode) {
        return Ok(false);
    }
    // Remotes that predate discovery have one mode.
    if started.ptoc == 0 || is_accepted(memory)? {
        return Ok(true);
    }
    // The fault may be left from an earlier START, because nothing has cleared it since.
    for (location, value) in [
        (LocalLocation::CLEAR_FAULTS, CLEAR),
        (LocalLocation::SOFTWARE_MODE, mode),
    ] {
        memory.access(None, RemoteAccess::WriteLocal(location, value))?;
    }
    is_accepted(memory)
}

fn is_accepted<M: RemoteLink>(memory: &mut M) -> Result<bool, RemoteLinkError> {
    let read = RemoteAccess::ReadLocal(LocalLocation::FAULTS);
    let faults = RemoteFaults::from_bits_retain(memory.access(None, read)? as u8);
    Ok(!faults.contains(RemoteFaults::ILLEGAL_MODE))
}
