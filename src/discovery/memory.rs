//! How discovery and parameters reach a remote's memory.

use core::time::Duration;

use crate::{
    bus::{Clock, RegisterBus},
    lbp::RemoteLink,
    sslbp::{Channel, NonvolatileMemory, Port, PortError, RemoteAccess},
};

/// The memory of a remote in setup mode: over a port of the FPGA ([`PortMemory`]), or over anything
/// else that speaks LBP.
pub trait RemoteMemory {
    /// Why an access failed.
    type Error: core::error::Error + 'static;

    /// Reads or writes the working memory, or one that survives a power cycle, and returns what was
    /// read. What is written to one that survives is read back until it has been kept.
    ///
    /// # Errors
    /// The access failed, or the memory does not keep the value.
    fn access(
        &mut self,
        memory: Option<NonvolatileMemory>,
        access: RemoteAccess,
    ) -> Result<u64, Self::Error>;
}

/// The memory of the remote on one channel of a port in setup mode.
#[derive(Debug)]
pub struct PortMemory<'a, B> {
    /// The port, in setup mode.
    pub port: &'a mut Port,
    /// Its bus.
    pub bus: &'a mut B,
    /// The remote's channel.
    pub channel: Channel,
}

impl<B: RegisterBus + Clock> RemoteMemory for PortMemory<'_, B> {
    type Error = PortError<B::Error>;

    fn access(
        &mut self,
        memory: Option<NonvolatileMemory>,
        access: RemoteAccess,
    ) -> Result<u64, Self::Error> {
        let mut port = self.port.on(self.bus);
        match memory {
            None => port.access(self.channel, access),
            Some(memory) => port.nonvolatile_access(self.channel, memory, access),
        }
    }
}

impl<B: RegisterBus + Clock> RemoteLink for PortMemory<'_, B> {
    type Error = PortError<B::Error>;

    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, Self::Error> {
        self.port.on(self.bus).access(self.channel, access)
    }

    fn wait(&mut self, time: Duration) {
        self.bus.wait(time);
    }
}
