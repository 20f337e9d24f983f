//! Results of discovery.

use super::configure::{Assembly, Configured};
use super::{DriverError, Remark};
use crate::bus::{BusLayer, Clock, RegisterBus};
use crate::hal::PinStore;
use crate::hostmot2::RemoteId;
use crate::modules::serial::RemotePart;
use crate::remote::RemotePins;
use crate::sslbp::PortLink;

impl<B: RegisterBus + Clock> Configured<B> {
    /// The remotes that take part, with their addresses, port by port; absent optional ones
    /// included.
    pub fn remotes(&self) -> impl Iterator<Item = (RemoteId, &RemotePart)> {
        let stages = self.0.stages.iter();
        stages.flat_map(|stage| {
            let number = stage.number();
            let remotes = stage.remotes.iter();
            remotes.map(move |remote| {
                let id = RemoteId::new(number, remote.started.channel.index());
                (id, remote)
            })
        })
    }

    /// Remotes that were configured and do not take part, with the reason. They are searched for
    /// again at the next start; see [`Presence::Optional`](super::Presence::Optional).
    pub fn missing(&self) -> &[Remark] {
        &self.0.plan.missing
    }

    /// Remarks about the remotes that take part.
    pub fn remarks(&self) -> &[Remark] {
        &self.0.plan.remarks
    }

    /// The memory and the pins of a remote in setup mode.
    pub(super) fn in_setup(
        &mut self,
        remote: RemoteId,
    ) -> Result<(PortLink<'_, B>, &mut PinStore, &mut RemotePins), DriverError> {
        let Assembly {
            bus, plan, stages, ..
        } = &mut self.0;
        let stage = stages.get_mut(usize::from(remote.port));
        let found = stage.and_then(|stage| {
            let is_it = |found: &&mut RemotePart| {
                found.started.channel.index() == remote.channel && !found.is_absent()
            };
            Some((&mut stage.port, stage.remotes.iter_mut().find(is_it)?))
        });
        let (port, found) = found.ok_or_else(|| DriverError::no_remote(remote))?;
        let memory = PortLink {
            port,
            bus: bus.inner_mut(),
            channel: found.started.channel,
        };
        Ok((memory, &mut plan.pins, &mut found.pins))
    }
}
