//! Writes of remotes' parameters in the cycle, an access at a time, while their port is restarted.

use crate::bus::Instant;
use crate::lbp::{AccessRetry, ParameterSequence, SequenceStep};
use crate::remote::ParameterWrite;
use crate::sslbp::PortOperation;

/// A write that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WrittenParameter {
    pub write: ParameterWrite,
    /// The value that the remote has, as read back; `None` if it is not known: the write may have
    /// been executed, although its reply was lost.
    pub kept: Option<u64>,
}

impl WrittenParameter {
    /// True if the remote has the requested value.
    pub fn is_as_requested(&self) -> bool {
        self.kept == self.write.access.written()
    }
}

/// Writes the parameters of one remote after the other. The caller performs the accesses, and
/// returns their outcome.
///
/// # Real time
/// Every function takes constant time and does not allocate.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ParameterWriter {
    current: Option<(ParameterWrite, ParameterSequence)>,
    retry: AccessRetry,
    /// No access before this time.
    not_before: Instant,
    /// Idle writes since the last write ended.
    quiet: u8,
}

/// Writes without an access between the last access and the STOP: the network can deliver an access
/// late, or twice, and after the START its data would be taken for process data.
const QUIET_WRITES: u8 = 4;

impl ParameterWriter {
    /// Begins a write; nothing else may be in progress.
    pub fn begin(&mut self, write: ParameterWrite) {
        debug_assert!(self.current.is_none(), "a write is in progress");
        let sequence = ParameterSequence::new(write.memory, write.access, write.mask);
        self.current = Some((write, sequence));
        (self.retry, self.quiet) = (AccessRetry::default(), 0);
    }

    /// True while a write is in progress.
    pub const fn is_busy(&self) -> bool {
        self.current.is_some()
    }

    /// The access of this write of the cycle; `None` to wait.
    pub fn next(&self, now: Instant) -> Option<PortOperation> {
        let (write, sequence) = self.current.as_ref()?;
        match sequence.next(now) {
            SequenceStep::Access(access) if now >= self.not_before => {
                Some(PortOperation::Access(write.channel, access))
            }
            _ => None,
        }
    }

    /// Counts a write of the cycle without an access, after the last parameter; true if there were
    /// enough of them.
    pub fn count_quiet_write(&mut self) -> bool {
        self.quiet = self.quiet.saturating_add(1);
        self.quiet > QUIET_WRITES
    }

    /// Takes the outcome of the access: the value that it read, or `None` if it failed. Returns the
    /// write if it has ended with that.
    pub fn accessed(&mut self, now: Instant, value: Option<u64>) -> Option<WrittenParameter> {
        let (write, sequence) = self.current.as_mut()?;
        if value.is_some() {
            self.retry.succeeded();
        } else {
            self.not_before = now.after(AccessRetry::PAUSE);
            if self.retry.failed() {
                return None;
            }
        }
        sequence.accessed(now, value);
        let SequenceStep::Done(outcome) = sequence.next(now) else {
            return None;
        };
        let write = *write;
        self.give_up();
        let kept = outcome.value;
        Some(WrittenParameter { write, kept })
    }

    /// Gives up the write in progress, because the port was used for something else; returns it.
    pub fn give_up(&mut self) -> Option<ParameterWrite> {
        let (write, _) = self.current.take()?;
        self.quiet = 0;
        Some(write)
    }
}
