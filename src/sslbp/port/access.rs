//! Pass-through accesses to remotes in setup mode.

use super::{Port, PortResult};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, CsStatus, LocalLocation, NonvolatileMemory, Operation, PortError, PortState,
        RemoteAccess, StartMode,
    },
};
use alloc::{format, vec::Vec};
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
    /// Reads or writes the remote on `channel`, and gives what was read. Tried again when the reply
    /// is lost: all accesses are such that doing them twice is doing them once.
    ///
    /// Manual: 7I77, "REMOTE READ EXAMPLE", "REMOTE WRITE EXAMPLE"; FACTS 6.1.
    ///
    /// # Errors
    /// [`PortError::Channel`] if there is no good reply; [`PortError::WrongState`] if the channel
    /// does not run in setup mode.
    pub fn access<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        access: RemoteAccess,
    ) -> PortResult<u64, B> {
        self.require_running(PortState::Started(StartMode::Setup), channel.mask())?;
        let registers = self.registers(channel)?;
        let data = access.data_words().into_iter().flatten();
        let mut writes: Vec<_> = registers.interfaces().zip(data).collect();
        writes.push((registers.cs, access.cs_word()));
        let mut cs = CsStatus::default();
        for _ in 0..ATTEMPTS {
            let operation = Operation::Access(channel, access);
            let (complete, snapshot) = self.run(bus, operation, &writes)?;
            if complete.good.contains(channel) {
                return Ok(access.value(snapshot.interface(channel)));
            }
            cs = snapshot.status(channel);
            bus.wait(QUIET);
        }
        Err(PortError::Channel {
            port: self.layout.instance,
            channel,
            failed: format!("{access}: no good reply in {ATTEMPTS} attempts"),
            cs,
            hint: "check the cable; if only this address fails, the remote does not have it",
        })
    }

    /// Reads or writes non-volatile memory of the remote on `channel`, and gives what is there then.
    ///
    /// What is written is read back until it has been kept. A value that is there already is not
    /// written: such memory wears out. Access to it is switched off again, whatever happens: the
    /// reply to the selection may have been lost after it was done. FACTS 6.3.
    ///
    /// # Errors
    /// As [`access`](Self::access), and [`PortError::NotKept`].
    pub fn nonvolatile_access<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        memory: NonvolatileMemory,
        access: RemoteAccess,
    ) -> PortResult<u64, B> {
        self.require_running(PortState::Started(StartMode::Setup), channel.mask())?;
        let select = |code| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, code);
        let result = self
            .access(bus, channel, select(memory.code()))
            .and_then(|_| self.access_selected(bus, channel, access));
        match self.access(bus, channel, select(0)) {
            Ok(_) => result,
            Err(PortError::Channel { port, cs, .. }) => Err(PortError::Channel {
                port,
                channel,
                failed: "access to non-volatile memory could not be switched off".into(),
                cs,
                hint: "power the remote off and on before anything else is written to it",
            }),
            Err(other) => Err(other),
        }
    }

    fn access_selected<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        access: RemoteAccess,
    ) -> PortResult<u64, B> {
        let mut read = self.access(bus, channel, access.read_back())?;
        let Some(written) = access.written().filter(|&value| value != read) else {
            return Ok(read);
        };
        self.access(bus, channel, access)?;
        let mut pause = KEEP_FIRST;
        for _ in 0..=KEEP_ATTEMPTS {
            bus.wait(pause);
            read = self.access(bus, channel, access.read_back())?;
            if read == written {
                return Ok(read);
            }
            pause = KEEP_PAUSE;
        }
        Err(PortError::NotKept {
            port: self.layout.instance,
            place: format!("channel {channel}: non-volatile memory ({access})"),
            written,
            read,
            hint: "it may be write-protected (see the card's jumpers) or worn out",
        })
    }
}
