//! How discovery reaches a remote's memory.

use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{AccessSize, Channel, NonvolatileMemory, Port, PortError},
};

/// The memory of a remote, as far as discovery needs it.
pub trait RemoteMemory {
    /// Why an access failed.
    type Error: core::error::Error + 'static;

    /// Reads `size` bytes from `address` on, least significant first.
    fn read(&mut self, address: u16, size: AccessSize) -> Result<u64, Self::Error>;
}

/// The memory of a remote, as far as parameters need it.
pub trait RemoteParameters: RemoteMemory {
    /// Writes `size` bytes from `address` on, least significant first.
    fn write(&mut self, address: u16, size: AccessSize, value: u64) -> Result<(), Self::Error>;

    /// Reads from the memory that survives a power cycle.
    fn read_nonvolatile(&mut self, address: u16, size: AccessSize) -> Result<u64, Self::Error>;

    /// Writes to the memory that survives a power cycle, and checks that it was kept.
    fn write_nonvolatile(
        &mut self,
        address: u16,
        size: AccessSize,
        value: u64,
    ) -> Result<(), Self::Error>;
}

impl<M: RemoteMemory + ?Sized> RemoteMemory for &mut M {
    type Error = M::Error;

    fn read(&mut self, address: u16, size: AccessSize) -> Result<u64, Self::Error> {
        (**self).read(address, size)
    }
}

/// The memory of the remote on one channel of a port in setup mode.
#[derive(Debug)]
pub struct PortMemory<'a, B> {
    port: &'a mut Port,
    bus: &'a mut B,
    channel: Channel,
}

impl<'a, B: RegisterBus + Clock> PortMemory<'a, B> {
    /// Through `channel` of `port`.
    pub fn new(port: &'a mut Port, bus: &'a mut B, channel: Channel) -> Self {
        Self { port, bus, channel }
    }
}

impl<B: RegisterBus + Clock> RemoteMemory for PortMemory<'_, B> {
    type Error = PortError<B::Error>;

    fn read(&mut self, address: u16, size: AccessSize) -> Result<u64, Self::Error> {
        self.port.remote_read(self.bus, self.channel, address, size)
    }
}

impl<B: RegisterBus + Clock> RemoteParameters for PortMemory<'_, B> {
    fn write(&mut self, address: u16, size: AccessSize, value: u64) -> Result<(), Self::Error> {
        self.port
            .remote_write(self.bus, self.channel, address, size, value)
    }

    fn read_nonvolatile(&mut self, address: u16, size: AccessSize) -> Result<u64, Self::Error> {
        let memory = NonvolatileMemory::Eeprom;
        self.port
            .nonvolatile_read(self.bus, self.channel, memory, address, size)
    }

    fn write_nonvolatile(
        &mut self,
        address: u16,
        size: AccessSize,
        value: u64,
    ) -> Result<(), Self::Error> {
        let memory = NonvolatileMemory::Eeprom;
        self.port
            .nonvolatile_write(self.bus, self.channel, memory, address, size, value)
    }
}
