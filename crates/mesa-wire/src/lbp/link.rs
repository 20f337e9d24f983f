//! A line to one remote in setup mode, independent of the carrier, and access to its memories.

use core::time::Duration;

use super::{NonvolatileMemory, ParameterSequence, RemoteAccess, RemoteLinkError, SequenceStep};
use crate::time::Instant;

/// A line to one remote in setup mode: a channel of the FPGA (`sslbp::PortLink` of `mesa-hal`), or
/// a serial port of the host (`SerialHost` of `mesa-tools`). Discovery, parameters and updates use
/// it only.
pub trait RemoteLink {
    /// Reads or writes, and returns the value read, right-justified; 0 for a write. Repeated if the
    /// reply is lost, so that every access must be idempotent.
    ///
    /// # Errors
    /// No valid reply within a bounded time.
    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, RemoteLinkError>;

    /// Waits for `time`.
    fn wait(&mut self, time: Duration);

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
    ) -> Result<u64, RemoteLinkError> {
        let Some(memory) = memory else {
            return self.exchange(access);
        };
        let mut sequence = ParameterSequence::new(Some(memory), access, u64::MAX);
        let mut failed = None;
        // Only the waits are needed of the time: they are the least that has passed.
        let mut now = Instant::default();
        let outcome = loop {
            match sequence.next(now) {
                SequenceStep::Access(access) => {
                    let result = self.exchange(access);
                    sequence.accessed(now, result.as_ref().ok().copied());
                    failed = result.err().or(failed);
                }
                SequenceStep::Wait(until) => {
                    self.wait(until.since(now));
                    now = until;
                }
                SequenceStep::Done(outcome) => break outcome,
            }
        };
        match (failed, outcome.value, access.written()) {
            (Some(error), ..) if outcome.is_still_selected => Err(error.still_selected()),
            (Some(error), ..) => Err(error),
            (None, Some(read), Some(written)) if read != written => {
                Err(RemoteLinkError::not_kept(access, written, read))
            }
            (None, read, _) => Ok(read.unwrap_or(0)),
        }
    }
}
