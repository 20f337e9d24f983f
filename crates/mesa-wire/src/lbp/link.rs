//! A line to one remote in setup mode, independent of the carrier, and access to its memories.

use core::error::Error;
use core::time::Duration;

use super::{LocalLocation, NonvolatileMemory, RemoteAccess};

/// A line to one remote in setup mode: a channel of the FPGA (`sslbp::PortLink` of `mesa-hal`), or
/// a serial port of the host (`SerialHost` of `mesa-tools`). Discovery, parameters and updates use
/// it only.
pub trait RemoteLink {
    /// Error of an access.
    type Error: Error + 'static;

    /// Reads or writes, and returns the value read, right-justified; 0 for a write. Repeated if the
    /// reply is lost, so that every access must be idempotent.
    ///
    /// # Errors
    /// No valid reply within a bounded time.
    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, Self::Error>;

    /// Waits for `time`.
    fn wait(&mut self, time: Duration);

    /// The error for a problem with non-volatile memory in this access.
    fn nonvolatile_error(
        &mut self,
        access: RemoteAccess,
        problem: NonvolatileProblem<Self::Error>,
    ) -> Self::Error;

    /// Reads or writes the working memory, or a non-volatile one, and returns its value afterwards.
    ///
    /// A value written to non-volatile memory is read back until the memory has kept it. A value
    /// that is already there is not written, because such memory wears out. The memory is
    /// deselected again in every case: the selection may have been executed although its reply was
    /// lost. FACTS 6.3.
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

/// A problem with non-volatile memory over a working line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NonvolatileProblem<E> {
    /// The memory could not be deselected.
    StillSelected(E),
    /// The memory does not keep the value.
    NotKept {
        /// The value written.
        written: u64,
        /// The value read last.
        read: u64,
    },
}

/// Wait before the first check that non-volatile memory has kept a value.
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
