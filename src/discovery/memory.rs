//! How discovery and parameters reach a remote's memory.

use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{AccessSize, Channel, NonvolatileMemory, Port, PortError, RemoteAccess},
};

/// The memory of a remote in setup mode: over a port of the FPGA ([`PortMemory`]), or over anything
/// else that speaks LBP.
pub trait RemoteMemory {
    /// Why an access failed.
    type Error: core::error::Error + 'static;

    /// Reads `size` bytes from `address` on, least significant first: of the working memory, or of
    /// one that survives a power cycle.
    ///
    /// # Errors
    /// The access failed.
    fn read(
        &mut self,
        memory: Option<NonvolatileMemory>,
        address: u16,
        size: AccessSize,
    ) -> Result<u64, Self::Error>;

    /// Writes `size` bytes from `address` on, least significant first. One that survives a power
    /// cycle is read back until it has kept them.
    ///
    /// # Errors
    /// The access failed, or the memory does not keep the value.
    fn write(
        &mut self,
        memory: Option<NonvolatileMemory>,
        address: u16,
        size: AccessSize,
        value: u64,
    ) -> Result<(), Self::Error>;
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

    fn read(
        &mut self,
        memory: Option<NonvolatileMemory>,
        address: u16,
        size: AccessSize,
    ) -> Result<u64, Self::Error> {
        self.access(memory, RemoteAccess::Read { address, size })
    }

    fn write(
        &mut self,
        memory: Option<NonvolatileMemory>,
        address: u16,
        size: AccessSize,
        value: u64,
    ) -> Result<(), Self::Error> {
        let write = RemoteAccess::Write {
            address,
            size,
            value,
        };
        self.access(memory, write).map(drop)
    }
}

impl<B: RegisterBus + Clock> PortMemory<'_, B> {
    fn access(
        &mut self,
        memory: Option<NonvolatileMemory>,
        access: RemoteAccess,
    ) -> Result<u64, PortError<B::Error>> {
        let Self { port, bus, channel } = self;
        match memory {
            None => port.access(*bus, *channel, access),
            Some(memory) => port.nonvolatile_access(*bus, *channel, memory, access),
        }
    }
}
