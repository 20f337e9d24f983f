//! Pass-through accesses to remotes in setup mode.

use super::{Port, PortResult, SetupPort};
use crate::{
    advice,
    bus::{Clock, RegisterBus},
    lbp::{AccessRetry, RemoteLink, RemoteLinkError},
    sslbp::{Channel, PortAccess, PortError, PortOperation, PortState, RemoteAccess, StartMode},
};
use alloc::{format, vec::Vec};
use core::time::Duration;

impl<B: RegisterBus + Clock> SetupPort<'_, B> {
    /// Reads from or writes to the remote on `channel`, and returns the value read. Repeated when
    /// the reply is lost: every access can be done twice with the same effect.
    ///
    /// Manual: 7I77, "REMOTE READ EXAMPLE", "REMOTE WRITE EXAMPLE"; FACTS 6.1.
    ///
    /// # Errors
    /// [`PortError::Channel`] without a good reply; [`PortError::WrongState`] if the channel does
    /// not run in setup mode.
    pub fn access(&mut self, channel: Channel, access: RemoteAccess) -> PortResult<u64> {
        if access.written().is_some() {
            return self.access_once(channel, access);
        }
        let what = format_args!("{access} of channel {channel}");
        self.read_without_doubt(what, |port| port.access_once(channel, access))
    }

    fn access_once(&mut self, channel: Channel, access: RemoteAccess) -> PortResult<u64> {
        let machine = &self.port.machine;
        let is_ready = machine.state == PortState::Started(StartMode::Setup)
            && machine.running.contains(channel);
        let registers = self.port.layout.channel(channel).filter(|_| is_ready);
        let Some(registers) = registers else {
            return Err(self.wrong_state(format!("a setup START of channel {channel}"), None));
        };
        let data = access.data_words().into_iter().flatten();
        let mut writes: Vec<_> = registers.interfaces().zip(data).collect();
        writes.push((registers.cs, access.cs_word()));
        let mut cs;
        let mut retry = AccessRetry::default();
        loop {
            let operation = PortOperation::Access(channel, access);
            let (complete, snapshot) = self.run(operation, &writes)?;
            if complete.good.contains(channel) {
                return Ok(access.value(snapshot.interface(channel)));
            }
            cs = snapshot.status(channel);
            self.bus.wait(AccessRetry::PAUSE);
            if !retry.failed() {
                break;
            }
        }
        Err(PortError::Channel {
            port: self.port.layout.instance,
            channel,
            failed: format!(
                "{access}: no good reply in {} attempts",
                AccessRetry::ATTEMPTS
            ),
            cs,
            advice: Some(advice::CHECK_CABLE_OR_ADDRESS),
        })
    }
}

/// The remote on one channel of a port in setup mode.
#[derive(Debug)]
pub struct PortLink<'a, B> {
    /// The port, in setup mode.
    pub port: &'a mut Port,
    /// Its bus.
    pub bus: &'a mut B,
    /// The remote's channel.
    pub channel: Channel,
}

impl<B: RegisterBus + Clock> RemoteLink for PortLink<'_, B> {
    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, RemoteLinkError> {
        Ok(self.port.on(self.bus).access(self.channel, access)?)
    }

    fn wait(&mut self, time: Duration) {
        self.bus.wait(time);
    }
}
