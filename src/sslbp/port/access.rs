//! Pass-through accesses to remotes in setup mode.

use super::{Port, PortResult, run::Wanted};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        AccessSize, Channel, CsStatus, LocalLocation, NonvolatileMemory, PortError, PortState,
        RemoteAccess, machine::Operation,
    },
};
use core::time::Duration;

/// How often an access is tried.
const ATTEMPTS: u8 = 3;

/// After a failed access: longer than its timer, so that neither the timer nor a late reply is
/// taken for the next access (FACTS 5.4).
const QUIET: Duration = Duration::from_millis(60);

/// How long non-volatile memory may take to keep a value.
const KEEP_FIRST: Duration = Duration::from_millis(10);
const KEEP_PAUSE: Duration = Duration::from_millis(20);
const KEEP_ATTEMPTS: u8 = 6;

impl Port {
    /// Reads from the memory of the remote on `channel`.
    ///
    /// Manual: 7I77, "REMOTE READ EXAMPLE".
    pub fn remote_read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        address: u16,
        size: AccessSize,
    ) -> PortResult<u64, B> {
        self.remote_access(bus, channel, RemoteAccess::Read { address, size })
    }

    /// Writes to the memory of the remote on `channel`; bits of `value` above `size` are dropped.
    ///
    /// Manual: 7I77, "REMOTE WRITE EXAMPLE".
    pub fn remote_write<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        address: u16,
        size: AccessSize,
        value: u64,
    ) -> PortResult<(), B> {
        let access = RemoteAccess::Write {
            address,
            size,
            value,
        };
        self.remote_access(bus, channel, access).map(|_| ())
    }

    /// Reads a local location of the remote on `channel`. FACTS 6.1.
    pub fn remote_local_read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        location: LocalLocation,
    ) -> PortResult<u8, B> {
        let value = self.remote_access(bus, channel, RemoteAccess::ReadLocal(location))?;
        Ok(value as u8)
    }

    /// Writes a local location of the remote on `channel`. FACTS 6.1.
    pub fn remote_local_write<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        location: LocalLocation,
        value: u8,
    ) -> PortResult<(), B> {
        let access = RemoteAccess::WriteLocal(location, value);
        self.remote_access(bus, channel, access).map(|_| ())
    }

    /// Reads from the non-volatile memory of the remote on `channel`.
    ///
    /// Access to it is switched off again, whatever happens. FACTS 6.3.
    pub fn nonvolatile_read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        memory: NonvolatileMemory,
        address: u16,
        size: AccessSize,
    ) -> PortResult<u64, B> {
        self.with_nonvolatile(bus, channel, memory, |port, bus| {
            port.remote_read(bus, channel, address, size)
        })
    }

    /// Writes to the non-volatile memory of the remote on `channel`, and reads it back until it
    /// has been kept. A value that is there already is not written: such memory wears out.
    ///
    /// Access to it is switched off again, whatever happens. FACTS 6.3.
    pub fn nonvolatile_write<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        memory: NonvolatileMemory,
        address: u16,
        size: AccessSize,
        value: u64,
    ) -> PortResult<(), B> {
        let written = value & size.mask();
        self.with_nonvolatile(bus, channel, memory, |port, bus| {
            if port.remote_read(bus, channel, address, size)? == written {
                return Ok(());
            }
            port.remote_write(bus, channel, address, size, written)?;
            port.confirm_kept(bus, channel, address, size, written)
        })
    }

    fn confirm_kept<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        address: u16,
        size: AccessSize,
        written: u64,
    ) -> PortResult<(), B> {
        bus.wait(KEEP_FIRST);
        let mut read = self.remote_read(bus, channel, address, size)?;
        for _ in 0..KEEP_ATTEMPTS {
            if read == written {
                return Ok(());
            }
            bus.wait(KEEP_PAUSE);
            read = self.remote_read(bus, channel, address, size)?;
        }
        Err(PortError::NotKept {
            port: self.layout.instance(),
            channel,
            address,
            written,
            read,
        })
    }

    /// Runs `work` with non-volatile memory selected, and deselects it afterwards even if `work`,
    /// or the selection itself, has failed: its reply may have been lost after it was done.
    fn with_nonvolatile<B: RegisterBus + Clock, T>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        memory: NonvolatileMemory,
        work: impl FnOnce(&mut Self, &mut B) -> PortResult<T, B>,
    ) -> PortResult<T, B> {
        self.require_running(PortState::Setup, channel.mask())?;
        let location = LocalLocation::NONVOLATILE;
        let result = self
            .remote_local_write(bus, channel, location, memory.code())
            .and_then(|()| work(self, bus));
        match self.remote_local_write(bus, channel, location, 0) {
            Ok(()) => result,
            Err(PortError::AccessFailed { port, cs, .. }) => {
                Err(PortError::LeftNonvolatile { port, channel, cs })
            }
            Err(other) => Err(other),
        }
    }

    /// One access, tried again when the reply is lost: all accesses are such that doing them twice
    /// is doing them once.
    pub fn remote_access<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        access: RemoteAccess,
    ) -> PortResult<u64, B> {
        self.require_running(PortState::Setup, channel.mask())?;
        let mut cs = CsStatus::default();
        for _ in 0..ATTEMPTS {
            match self.access_once(bus, channel, access)? {
                Ok(value) => return Ok(value),
                Err(status) => cs = status,
            }
            bus.wait(QUIET);
        }
        Err(PortError::AccessFailed {
            port: self.layout.instance(),
            channel,
            access,
            attempts: ATTEMPTS,
            cs,
        })
    }

    fn access_once<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        access: RemoteAccess,
    ) -> PortResult<Result<u64, CsStatus>, B> {
        let registers = self.registers(channel)?;
        let mut writes = alloc::vec::Vec::new();
        if let Some(words) = access.data_words() {
            writes.extend(registers.interfaces().zip(words));
        }
        writes.push((registers.cs(), access.cs_word()));
        let operation = Operation::Access(channel, access);
        let (complete, snapshot) = self.run(bus, operation, &writes, Wanted::Interface(2))?;
        if complete.good.contains(channel) {
            Ok(Ok(access.value(snapshot.interface(channel))))
        } else {
            Ok(Err(snapshot.channel_status(channel)))
        }
    }
}
