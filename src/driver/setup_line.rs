//! One remote in setup mode at its own baud rate: for maintenance while a board is configured.

use super::remark::{Remark, RemarkKind};
use super::{Configured, DriverError};
use crate::bus::{BusLayer, Clock, RegisterBus};
use crate::hostmot2::RemoteId;
use crate::sslbp::{Channel, DEFAULT_BAUD_RATE, PortLink, StartMode, StartedRemote};

impl<B: RegisterBus + Clock> Configured<B> {
    /// Stops the serial port of a remote and starts only that remote, in setup mode, at this baud
    /// rate: 115200 for a card with its jumper in the setup position. Returns the line to the
    /// remote, and its identity; a remote with only a running bootloader reports neither unit
    /// number nor tables.
    ///
    /// The channel has to be configured. The remotes that were
    /// discovered on the port are stopped from here on; [`end_setup_at`](Self::end_setup_at)
    /// restores the usual baud rate of the channel.
    ///
    /// # Errors
    /// [`DriverError::Missing`]: the remote does not start, with the reason.
    /// [`DriverError::Attach`]: there is no such port or channel.
    pub fn setup_at(
        &mut self,
        remote: impl Into<RemoteId>,
        baud_rate: u32,
    ) -> Result<(PortLink<'_, B>, StartedRemote), DriverError> {
        let remote = remote.into();
        let PortLink { port, bus, channel } = self.line(remote)?;
        let mut on_bus = port.on(bus);
        on_bus.stop_all()?;
        on_bus.set_baud_rate(channel, baud_rate)?;
        on_bus.stop_all()?;
        let outcomes = on_bus.start(StartMode::Setup, &[(channel, 0)])?;
        match outcomes.into_iter().next() {
            Some(Ok(started)) => Ok((PortLink { port, bus, channel }, started)),
            Some(Err(failure)) => {
                let kind = RemarkKind::DidNotStart(failure);
                Err(DriverError::Missing(Remark::new(remote, kind)))
            }
            None => Err(DriverError::no_remote(remote)),
        }
    }

    /// Stops a serial port, and restores the default baud rate of one of its channels.
    ///
    /// # Errors
    /// The port fails, or does not exist.
    pub fn end_setup_at(&mut self, remote: impl Into<RemoteId>) -> Result<(), DriverError> {
        let PortLink { port, bus, channel } = self.line(remote.into())?;
        let mut port = port.on(bus);
        port.stop_all()?;
        port.set_baud_rate(channel, DEFAULT_BAUD_RATE)?;
        Ok(port.stop_all()?)
    }

    /// The line of an existing channel.
    fn line(&mut self, remote: RemoteId) -> Result<PortLink<'_, B>, DriverError> {
        let stage = self.0.stages.get_mut(usize::from(remote.port));
        let line = stage
            .zip(Channel::new(remote.channel))
            .map(|(stage, channel)| PortLink {
                port: &mut stage.port,
                bus: self.0.bus.inner_mut(),
                channel,
            });
        line.filter(|line| line.port.layout().mask().contains(line.channel))
            .ok_or(DriverError::no_remote(remote))
    }
}
