//! Discovery of all remotes of a port.

use super::{
    Discovered, DiscoveryLimits, ModeSet, PortMemory, Problem, ProblemKind, RemoteIdentity, Table,
    discover,
};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, ChannelStart, LocalLocation, Port, PortError, PortResult, RemoteFaults,
        StartFailure, StartMode, StartedRemote,
    },
};
use alloc::vec::Vec;

/// A remote, and what discovery found out about it.
#[derive(Clone, Debug, PartialEq)]
pub struct DiscoveredRemote<E> {
    /// What START told.
    pub remote: StartedRemote,
    /// What its tables told.
    pub discovered: Discovered<E>,
}

/// Everything on a port.
#[derive(Clone, Debug, PartialEq)]
pub struct Inventory<E> {
    /// The remotes, by channel.
    pub remotes: Vec<DiscoveredRemote<E>>,
    /// The channels that did not start, with the reason.
    pub failures: Vec<StartFailure>,
}

impl<E> Inventory<E> {
    /// The remote on `channel`.
    pub fn on(&self, channel: Channel) -> Option<&DiscoveredRemote<E>> {
        self.remotes
            .iter()
            .find(|found| found.remote.channel == channel)
    }
}

/// Stops the port, starts `channels` in setup mode and discovers what is there.
///
/// Leaves the port in setup mode, so that parameters can be read and written. A remote whose tables
/// are damaged does not disturb the others.
///
/// Manual: 7I77, "DISCOVERY SEQUENCE".
pub fn discover_port<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    channels: &[ChannelStart],
    limits: DiscoveryLimits,
) -> PortResult<Inventory<PortError<B::Error>>, B> {
    port.stop_all(bus)?;
    let report = port.start(bus, StartMode::Setup, channels)?;
    let layout = *port.layout();
    let mut remotes = Vec::new();
    for remote in report.remotes() {
        let identity = RemoteIdentity::new(remote, &layout);
        let in_place = show_tables(port, bus, remote);
        let mut memory = PortMemory::new(port, bus, remote.channel);
        let mut discovered = discover(&mut memory, &identity, limits);
        if let Err(error) = in_place {
            discovered.read_error.get_or_insert(error);
        }
        check_mode(port, bus, remote, &mut discovered);
        remotes.push(DiscoveredRemote {
            remote: *remote,
            discovered,
        });
    }
    Ok(Inventory {
        remotes,
        failures: report.failures().copied().collect(),
    })
}

/// A host that ended in the middle of an access to non-volatile memory has left that memory where
/// the tables are; a START does not change that. FACTS 6.3.
fn show_tables<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    remote: &StartedRemote,
) -> PortResult<(), B> {
    if remote.ptoc == 0 && remote.gtoc == 0 {
        return Ok(());
    }
    port.remote_local_write(bus, remote.channel, LocalLocation::NONVOLATILE, 0)
}

/// A setup START does not look at the fault byte, and so succeeds in a software mode that the
/// remote does not have (FACTS 4.1); the tables are then those of another mode.
fn check_mode<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    remote: &StartedRemote,
    discovered: &mut Discovered<PortError<B::Error>>,
) {
    if remote.ptoc == 0 {
        // Remotes older than discovery have one mode.
        return;
    }
    match is_mode_illegal(port, bus, remote) {
        Ok(false) => {}
        Ok(true) => discovered.problems.push(Problem {
            name: remote.name,
            unit_number: remote.unit_number,
            table: Table::Process,
            record: remote.ptoc,
            kind: ProblemKind::IllegalSoftwareMode {
                mode: remote.software_mode,
                known: ModeSet::software(&discovered.descriptor.modes),
            },
        }),
        Err(error) => discovered.read_error = Some(error),
    }
}

fn is_mode_illegal<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    remote: &StartedRemote,
) -> PortResult<bool, B> {
    let channel = remote.channel;
    if !reports_illegal_mode(port, bus, channel)? {
        return Ok(false);
    }
    // The fault may be left from an earlier START: nothing has cleared it since.
    port.remote_local_write(bus, channel, LocalLocation::CLEAR_FAULTS, CLEAR)?;
    let mode = remote.software_mode;
    port.remote_local_write(bus, channel, LocalLocation::SOFTWARE_MODE, mode)?;
    reports_illegal_mode(port, bus, channel)
}

/// What is written to [`LocalLocation::CLEAR_FAULTS`].
const CLEAR: u8 = 0xFF;

fn reports_illegal_mode<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    channel: Channel,
) -> PortResult<bool, B> {
    let faults = port.remote_local_read(bus, channel, LocalLocation::FAULTS)?;
    Ok(RemoteFaults::from_bits_retain(faults).contains(RemoteFaults::ILLEGAL_MODE))
}
