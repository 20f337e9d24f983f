//! Discovery of all remotes of a port.

use super::{Discovered, DiscoveryLimits, PortMemory, RemoteIdentity, discover};
use crate::{
    bus::RegisterBus,
    sslbp::{
        Channel, ChannelStart, Port, PortError, PortResult, StartFailure, StartMode, StartedRemote,
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
pub fn discover_port<B: RegisterBus>(
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
        let mut memory = PortMemory::new(port, bus, remote.channel);
        let discovered = discover(&mut memory, &identity, limits);
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
