//! A line to one remote in setup mode, whatever carries it, and what is done over any of them.

use core::error::Error;
use core::time::Duration;

use super::{LocalLocation, NonvolatileMemory, RemoteAccess};

/// A line to one remote in setup mode: a channel of the FPGA
/// (`sslbp::PortLink` of `mesa-hal`), or a serial port of the host
/// (`SerialHost` of `mesa-tools`). Discovery, parameters and updates use no other.
pub trait RemoteLink {
    /// Why an access failed.
    type Error: Error + 'static;

    /// Reads or writes, and gives what was read, right-justified; 0 for a write. Tried again when the
    /// reply is lost: all accesses are such that doing them twice is doing them once.
    ///
    /// # Errors
    /// There is no good reply, within a bounded time.
    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, Self::Error>;

    /// Lets time pass.
    fn wait(&mut self, time: Duration);

    /// The error for what went wrong with non-volatile memory in this access.
    fn nonvolatile_error(
        &mut self,
        access: RemoteAccess,
        problem: NonvolatileProblem<Self::Error>,
    ) -> Self::Error;

    /// Reads or writes the working memory, or one that survives a power cycle, and gives what is
    /// there then.
    ///
    /// What is written to one that survives is read back until it has been kept. A value that is
    /// there already is not written: such memory wears out. Access to it is switched off again,
    /// whatever happens: the reply to the selection may have been lost after it was done. FACTS 6.3.
    ///
    /// # Errors
    /// The access failed, or the memory does not keep the value.
    fn access(
        &mut self,
        memory: Option<NonvolatileMemory>,
        access: RemoteAccess,
    ) -> Result<u64, Self::Error> {
        let Some(memory) = memory else {
            return self.exchange(access);
        };
        let select = |code| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, code);
        let selected = self.exchange(select(memory as u8));
        let result = selected.and_then(|_| access_selected(self, access));
        match self.exchange(select(0)) {
            Ok(_) => result,
            Err(error) => {
                Err(self.nonvolatile_error(access, NonvolatileProblem::StillSelected(error)))
            }
        }
    }
}

/// What goes wrong with non-volatile memory, where the line does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NonvolatileProblem<E> {
    /// Access to it could not be switched off again.
    StillSelected(E),
    /// It does not keep the value.
    NotKept {
        /// What was written.
        written: u64,
        /// What was read last.
        read: u64,
    },
}

/// How long non-volatile memory may take to keep a value.
const KEEP_FIRST: Duration = Duration::from_millis(10);
const KEEP_PAUSE: Duration = Duration::from_millis(20);
const KEEP_ATTEMPTS: u8 = 6;

fn access_selected<L: RemoteLink + ?Sized>(
    link: &mut L,
    access: RemoteAccess,
) -> Result<u64, L::Error> {
    let mut read = link.exchange(access.read_back())?;
    let Some(written) = access.written().filter(|&value| value != read) else {
        return Ok(read);
    };
    link.exchange(access)?;
    let mut pause = KEEP_FIRST;
    for _ in 0..=KEEP_ATTEMPTS {
        link.wait(pause);
        read = link.exchange(access.read_back())?;
        if read == written {
            return Ok(read);
        }
        pause = KEEP_PAUSE;
    }
    Err(link.nonvolatile_error(access, NonvolatileProblem::NotKept { written, read }))
}
