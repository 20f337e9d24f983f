//! A line to one remote in setup mode, whatever carries it, and what is done over any of them.

use core::error::Error;
use core::time::Duration;

use super::{LocalLocation, NonvolatileMemory, RemoteAccess};

/// A line to one remote in setup mode: a channel of the FPGA
/// ([`PortMemory`](crate::discovery::PortMemory)), or a serial port of the host
/// ([`SerialHost`](crate::setup::SerialHost)).
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
}

/// Why an access to non-volatile memory failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NonvolatileError<E> {
    /// An access failed.
    Link(E),
    /// Access to non-volatile memory could not be switched off again.
    StillSelected(E),
    /// The memory does not keep the value.
    NotKept {
        /// What was written.
        written: u64,
        /// What was read last.
        read: u64,
    },
}

impl<E> From<E> for NonvolatileError<E> {
    fn from(error: E) -> Self {
        Self::Link(error)
    }
}

/// How long non-volatile memory may take to keep a value.
const KEEP_FIRST: Duration = Duration::from_millis(10);
const KEEP_PAUSE: Duration = Duration::from_millis(20);
const KEEP_ATTEMPTS: u8 = 6;

/// Reads or writes non-volatile memory of a remote, and gives what is there then.
///
/// What is written is read back until it has been kept. A value that is there already is not written:
/// such memory wears out. Access to it is switched off again, whatever happens: the reply to the
/// selection may have been lost after it was done. FACTS 6.3.
///
/// # Errors
/// [`NonvolatileError`].
pub fn nonvolatile_access<L: RemoteLink>(
    link: &mut L,
    memory: NonvolatileMemory,
    access: RemoteAccess,
) -> Result<u64, NonvolatileError<L::Error>> {
    let select = |code| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, code);
    let result = match link.exchange(select(memory as u8)) {
        Ok(_) => access_selected(link, access),
        Err(error) => Err(error.into()),
    };
    match link.exchange(select(0)) {
        Ok(_) => result,
        Err(error) => Err(NonvolatileError::StillSelected(error)),
    }
}

fn access_selected<L: RemoteLink>(
    link: &mut L,
    access: RemoteAccess,
) -> Result<u64, NonvolatileError<L::Error>> {
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
    Err(NonvolatileError::NotKept { written, read })
}
