//! Writes of remotes' parameters in the cycle, an access at a time, while their port is restarted.

use core::time::Duration;

use crate::bus::Instant;
use crate::lbp::LocalLocation;
use crate::remote::ParameterWrite;
use crate::sslbp::{PortOperation, RemoteAccess};

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

/// Step of a write. FACTS 6.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Selects the memory.
    Select,
    /// Reads the present value: non-volatile memory wears out, and is written only if it differs.
    Compare,
    Write,
    /// Reads the value back, with the number of earlier readings that found another value.
    ReadBack(u8),
    /// Deselects the memory.
    Deselect {
        kept: Option<u64>,
    },
}

/// Writes the parameters of one remote after the other. The caller performs the accesses, and
/// returns their outcome.
///
/// # Real time
/// Every function takes constant time and does not allocate.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ParameterWriter {
    current: Option<(ParameterWrite, Step)>,
    /// Failed attempts of the access of this step.
    failed: u8,
    /// No access before this time.
    not_before: Instant,
    /// Idle writes since the last write ended.
    quiet: u8,
}

/// Attempts of an access.
const ATTEMPTS: u8 = 3;

/// Pause after a failed access: longer than its timer, so that neither the timer nor a late reply
/// is attributed to the next access (FACTS 5.4).
const PAUSE: Duration = Duration::from_millis(60);

/// Wait before non-volatile memory is read back, and between two readings.
const KEEP_TIME: Duration = Duration::from_millis(20);
/// Readings of non-volatile memory that may find another value than the one written.
const READINGS: u8 = 7;

/// Writes without an access between the last access and the STOP: the network can deliver an access
/// late, or twice, and after the START its data would be taken for process data.
const QUIET_WRITES: u8 = 4;

impl ParameterWriter {
    /// Begins a write; nothing else may be in progress.
    pub fn begin(&mut self, write: ParameterWrite) {
        debug_assert!(self.current.is_none(), "a write is in progress");
        let first = match write.memory {
            Some(_) => Step::Select,
            None => Step::Write,
        };
        self.current = Some((write, first));
        (self.failed, self.quiet) = (0, 0);
    }

    /// True while a write is in progress.
    pub const fn is_busy(&self) -> bool {
        self.current.is_some()
    }

    /// The access of this write of the cycle; `None` to wait.
    pub fn next(&self, now: Instant) -> Option<PortOperation> {
        let (write, step) = self.current?;
        if now < self.not_before {
            return None;
        }
        let select = |memory| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, memory);
        let access = match step {
            Step::Select => select(write.memory.map_or(0, |memory| memory as u8)),
            Step::Compare | Step::ReadBack(_) => write.access.read_back(),
            Step::Write => write.access,
            Step::Deselect { .. } => select(0),
        };
        Some(PortOperation::Access(write.channel, access))
    }

    /// Counts a write of the cycle without an access, after the last parameter; true if there were
    /// enough of them.
    pub fn is_quiet(&mut self) -> bool {
        self.quiet = self.quiet.saturating_add(1);
        self.quiet > QUIET_WRITES
    }

    /// Takes the outcome of the access: the value that it read, or `None` if it failed. Returns the
    /// write if it has ended with that.
    pub fn accessed(&mut self, now: Instant, value: Option<u64>) -> Option<WrittenParameter> {
        let (write, step) = self.current?;
        let Some(value) = value else {
            return self.access_failed(now);
        };
        self.failed = 0;
        let value = value & write.mask;
        let kept = Some(value);
        let is_there = kept == write.access.written();
        let next = match step {
            Step::Select => Step::Compare,
            Step::Compare if is_there => Step::Deselect { kept },
            Step::Compare => Step::Write,
            Step::Write => {
                if write.memory.is_some() {
                    self.not_before = now.after(KEEP_TIME);
                }
                Step::ReadBack(0)
            }
            Step::ReadBack(read) if !is_there && write.memory.is_some() && read < READINGS => {
                self.not_before = now.after(KEEP_TIME);
                Step::ReadBack(read.saturating_add(1))
            }
            Step::ReadBack(_) => return self.go_to_end(kept),
            Step::Deselect { kept } => return self.end(kept),
        };
        self.current = Some((write, next));
        None
    }

    /// Repeats the access, or gives the write up. A memory that was selected is deselected, also if
    /// the reply to the selection was lost.
    fn access_failed(&mut self, now: Instant) -> Option<WrittenParameter> {
        let (_, step) = self.current?;
        self.not_before = now.after(PAUSE);
        self.failed = self.failed.saturating_add(1);
        if self.failed < ATTEMPTS {
            return None;
        }
        self.failed = 0;
        match step {
            Step::Deselect { kept } => self.end(kept),
            _ => self.go_to_end(None),
        }
    }

    /// Deselects the memory if one is selected; ends the write otherwise.
    fn go_to_end(&mut self, kept: Option<u64>) -> Option<WrittenParameter> {
        let (write, _) = self.current?;
        if write.memory.is_none() {
            return self.end(kept);
        }
        self.current = Some((write, Step::Deselect { kept }));
        None
    }

    fn end(&mut self, kept: Option<u64>) -> Option<WrittenParameter> {
        let write = self.give_up()?;
        Some(WrittenParameter { write, kept })
    }

    /// Gives up the write in progress, because the port was used for something else; returns it.
    pub fn give_up(&mut self) -> Option<ParameterWrite> {
        let (write, _) = self.current.take()?;
        self.quiet = 0;
        Some(write)
    }
}
