//! A port as a state machine: determines the command that may be written now, and evaluates
//! COMMAND, DATA, CS and the interface registers afterwards. The machine is independent of bus and
//! clock, and never waits.
//!
//! A step consists of [`observe`](PortMachine::observe) with the result of a read,
//! [`begin`](PortMachine::begin) of an operation if the port is idle, the write of its registers
//! and its command, and [`written`](PortMachine::written). For set-up, [`Port`](super::Port) runs
//! an operation to its end over a bus; the cycle performs one step for each read and write.

// Runs in the cycle.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod failure;
mod link;

pub use failure::{Failure, FailureCounts};
pub use link::{ChannelLink, TransferResult};

use super::operation::OperationTimes;
use super::{
    COMMAND_IGNORED, Channel, ChannelMask, CsStatus, PerChannel, PortOperation, StartMode,
    StartedRemote,
};
use crate::bus::Instant;
use core::time::Duration;
use core::{array, fmt};

/// Common state of the running channels of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PortState {
    /// Not known: possibly left by another program.
    #[default]
    Unknown,
    /// All channels are stopped.
    Stopped,
    /// Started, for process data or for pass-through accesses.
    Started(StartMode),
}

impl fmt::Display for PortState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "in an unknown state",
            Self::Stopped => "stopped",
            Self::Started(StartMode::Setup) => "in setup mode",
            Self::Started(StartMode::Normal) => "in normal mode",
        })
    }
}

/// The registers of a port from one read. COMMAND is read first: if it is 0, everything read after
/// it is valid.
pub trait PortImage {
    /// COMMAND.
    fn command(&self) -> u32;
    /// DATA.
    fn data(&self) -> u32;
    /// CS of a channel.
    fn cs(&self, channel: Channel) -> u32;
    /// Interface registers 0 to 2 of a channel; requested only when a START is complete.
    fn interfaces(&self, channel: Channel) -> [u32; 3];
}

/// State of the operation in flight, as shown by a read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PortEvent {
    /// No operation is in flight, and the port is idle.
    Idle,
    /// The operation is not complete.
    Busy,
    /// COMMAND is 0; the other registers are valid from this time on.
    Settling(Instant),
    /// The operation is complete, and the port is idle.
    Complete(CompletedOperation),
}

/// A completed operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct CompletedOperation {
    /// The operation.
    pub operation: PortOperation,
    /// Time at which it was written.
    pub issued: Instant,
    /// Earliest time at which it may have begun: the host may be suspended between that and the end
    /// of the write.
    pub sent_from: Instant,
    /// Number of reads between then and now that did not show it complete, failed ones included.
    pub reads_before: u32,
    /// True if the port certainly received it, once and in order. If false, the data of a transfer
    /// is attributed to no operation, and only the faults that it shows count.
    pub certain: bool,
    /// The channels on which the operation succeeded: they are stopped, run, or have new and sound
    /// data.
    pub good: ChannelMask,
    /// The other requested channels with something to report: for a transfer, their
    /// [`verdict`](ChannelLink::verdict).
    pub bad: ChannelMask,
}

/// An operation that was written and is not known to be complete.
#[derive(Clone, Copy, Debug)]
struct PendingOperation {
    /// Its present description: no channel is good or bad yet.
    complete: CompletedOperation,
    busy_reads: u32,
    /// Time at which COMMAND first read 0.
    cleared: Option<Instant>,
}

impl PendingOperation {
    const fn new(operation: PortOperation, issued: Instant, certain: bool) -> Self {
        Self {
            complete: CompletedOperation {
                operation,
                issued,
                sent_from: issued,
                reads_before: 0,
                certain,
                good: ChannelMask::NONE,
                bad: ChannelMask::NONE,
            },
            busy_reads: 0,
            cleared: None,
        }
    }

    const fn seen_busy(&mut self) {
        self.busy_reads = self.busy_reads.saturating_add(1);
        self.complete.reads_before = self.complete.reads_before.saturating_add(1);
    }
}

/// An SSLBP port, independent of its bus.
///
/// # Real time
/// Every function is bounded by the number of channels and does not allocate.
#[derive(Clone, Debug)]
pub struct PortMachine {
    channels: ChannelMask,
    pub(super) state: PortState,
    pub(super) running: ChannelMask,
    links: PerChannel<ChannelLink>,
    /// COMMAND was 0 at the last read, and nothing was written since.
    idle: bool,
    in_flight: Option<PendingOperation>,
    /// The operation that `written` records once its write is done.
    begun: Option<PortOperation>,
    /// Time from which it may be executed.
    sent_from: Option<Instant>,
}

/// Number of busy reads, however far apart, before a busy COMMAND is considered stuck.
const MIN_BUSY_READS: u32 = 3;

/// Factor of the times of the slowest port, of 33 MHz, against the recorded ones.
const SLOWEST: u32 = 3;

impl PortMachine {
    /// A port with these channels, in an unknown state.
    pub fn new(channels: ChannelMask) -> Self {
        Self {
            channels,
            state: PortState::Unknown,
            running: ChannelMask::NONE,
            links: PerChannel(array::from_fn(|_| ChannelLink::new())),
            idle: false,
            in_flight: None,
            begun: None,
            sent_from: None,
        }
    }

    /// State of a channel.
    pub fn link(&self, channel: Channel) -> &ChannelLink {
        &self.links[channel]
    }

    /// True if an operation may be begun.
    pub const fn is_idle(&self) -> bool {
        self.idle
    }

    /// The operation that was written and is not known to be complete, with the time of its write.
    pub fn in_flight(&self) -> Option<(PortOperation, Instant)> {
        let pending = &self.in_flight.as_ref()?.complete;
        Some((pending.operation, pending.issued))
    }

    /// True if COMMAND stays busy for longer than the operation in flight can take; only
    /// [`PortOperation::Free`] helps then.
    pub fn is_stuck(&self, now: Instant) -> bool {
        self.in_flight.as_ref().is_some_and(|pending| {
            let CompletedOperation {
                operation, issued, ..
            } = pending.complete;
            pending.busy_reads >= MIN_BUSY_READS && now.since(issued) > operation.times().longest
        })
    }

    /// What is left of the longest time that the operation in flight can take; 0 without one, and
    /// for a transfer, whose time is that of the cycle.
    pub fn time_left(&self, now: Instant) -> Duration {
        match self.in_flight() {
            None | Some((PortOperation::Transfer(_), _)) => Duration::ZERO,
            Some((operation, issued)) => {
                let longest = operation.times().longest;
                longest.saturating_sub(now.since(issued))
            }
        }
    }

    /// The word for COMMAND that begins `operation`; a word that the register ignores while the
    /// port is not idle. [`written`](Self::written) must follow.
    ///
    /// A transfer of a channel that does not run in normal mode is an error in the program, on
    /// which a debug build panics: nothing is sent to the remote, and its bit in DATA has no
    /// meaning (FACTS 5.5).
    pub fn begin(&mut self, operation: PortOperation) -> u32 {
        if !self.idle && !operation.interrupts() {
            self.begun = None;
            return COMMAND_IGNORED;
        }
        if let PortOperation::Transfer(mask) = operation {
            debug_assert!(
                mask.difference(self.running).is_empty()
                    && self.state == PortState::Started(StartMode::Normal),
                "a channel that does not run is in a DOIT"
            );
        }
        self.begun = Some(operation);
        operation.command()
    }

    /// Declares that the next write begins no operation.
    pub const fn begin_nothing(&mut self) {
        self.begun = None;
    }

    /// Records that the write of the begun operation starts now. Without this call, the operation
    /// is assumed to begin at the end of its write.
    pub const fn sending(&mut self, now: Instant) {
        self.sent_from = Some(now);
    }

    /// Records that the begun operation was written. `arrived`: false if the write failed, so that
    /// the port may not have received it.
    pub fn written(&mut self, now: Instant, arrived: bool) {
        let sent_from = self.sent_from.take().unwrap_or(now);
        let Some(operation) = self.begun.take() else {
            return;
        };
        self.idle = false;
        if matches!(operation, PortOperation::Reset) {
            self.forget();
        }
        let mut in_flight = PendingOperation::new(operation, now, arrived);
        in_flight.complete.sent_from = sent_from;
        self.in_flight = Some(in_flight);
    }

    /// Evaluates a read. `certain`: everything written before has arrived, once and in order.
    pub fn observe(&mut self, now: Instant, seen: &impl PortImage, certain: bool) -> PortEvent {
        self.begun = None;
        let is_busy = seen.command() != 0;
        if self.in_flight.is_none() && !is_busy {
            self.idle = true;
            return PortEvent::Idle;
        }
        let foreign = || PendingOperation::new(PortOperation::Foreign, now, false);
        let pending = self.in_flight.get_or_insert_with(foreign);
        // Also while busy, because the operation that keeps it busy is not known.
        pending.complete.certain &= certain;
        if is_busy {
            self.idle = false;
            pending.seen_busy();
            return PortEvent::Busy;
        }
        let CompletedOperation {
            operation, issued, ..
        } = pending.complete;
        let OperationTimes { usual, settle, .. } = operation.times();
        if !settle.is_zero() {
            let cleared = *pending.cleared.get_or_insert(now);
            // COMMAND may have been 0 for a while when it is seen, but not for longer than that.
            // The pause after the stop of single channels is enough for the slowest port, too.
            let latest = match operation {
                PortOperation::Stop(_) => issued.after(usual),
                _ => issued.after(usual.saturating_mul(SLOWEST)),
            };
            let settled = cleared.min(latest).after(settle);
            if now < settled {
                return PortEvent::Settling(settled);
            }
        }
        let complete = pending.complete;
        self.in_flight = None;
        self.idle = true;
        PortEvent::Complete(self.complete(complete, seen))
    }

    /// Records a failed read: the state of COMMAND is unknown.
    pub const fn not_observed(&mut self) {
        self.idle = false;
        self.begun = None;
        if let Some(pending) = &mut self.in_flight {
            pending.complete.reads_before = pending.complete.reads_before.saturating_add(1);
        }
    }

    /// Records that the port was used for something else: an operation in flight is not the
    /// caller's, and the next read determines the state of COMMAND.
    pub(crate) fn taken_over(&mut self) {
        self.idle = false;
        self.begun = None;
        self.in_flight = None;
    }

    /// Records that the operation in flight may not have happened.
    pub const fn doubt(&mut self) {
        if let Some(pending) = &mut self.in_flight {
            pending.complete.certain = false;
        }
    }

    fn complete(
        &mut self,
        mut complete: CompletedOperation,
        seen: &impl PortImage,
    ) -> CompletedOperation {
        let asked = complete.operation.channels().intersection(self.channels);
        match complete.operation {
            PortOperation::Transfer(_) => self.judge(asked, seen, &mut complete),
            PortOperation::StopAll | PortOperation::Stop(_) => {
                complete.good = with_cs(asked, seen, CsStatus::is_stopped);
                complete.bad = asked.difference(complete.good);
                self.running = self.running.difference(asked);
                if matches!(complete.operation, PortOperation::StopAll) {
                    self.forget();
                    if complete.bad.is_empty() {
                        self.state = PortState::Stopped;
                    }
                }
            }
            PortOperation::Start(mode, _) => {
                complete.good = with_cs(asked, seen, |cs| cs.has_started(mode));
                complete.bad = asked.difference(complete.good);
                for channel in asked.iter() {
                    self.links[channel]
                        .started(CsStatus(seen.cs(channel)), seen.interfaces(channel));
                }
                if !complete.good.is_empty() {
                    self.state = PortState::Started(mode);
                    self.running = self.running.union(complete.good);
                }
            }
            PortOperation::Access(..) => {
                complete.bad = failed(seen).intersection(asked);
                complete.good = asked.difference(complete.bad);
            }
            PortOperation::Release => self.state = PortState::Stopped,
            PortOperation::ReadLocal(_)
            | PortOperation::WriteLocal(_)
            | PortOperation::Free
            | PortOperation::Reset
            | PortOperation::Foreign => {}
        }
        complete
    }

    fn judge(
        &mut self,
        asked: ChannelMask,
        seen: &impl PortImage,
        complete: &mut CompletedOperation,
    ) {
        let failed = failed(seen);
        for channel in asked.iter() {
            let (cs, mask) = (CsStatus(seen.cs(channel)), channel.mask());
            let link = &mut self.links[channel];
            if !complete.certain {
                // The transfer may not have happened: its data is not used, but a fault is still
                // reported.
                if link.judge_doubtful(cs) {
                    complete.bad = complete.bad.union(mask);
                }
                continue;
            }
            let verdict = link.judge(cs, failed.contains(channel));
            if verdict == TransferResult::Good {
                complete.good = complete.good.union(mask);
            } else {
                complete.bad = complete.bad.union(mask);
            }
            if verdict == TransferResult::Failed(Failure::NotRunning) {
                self.running = self.running.difference(mask);
            }
        }
    }

    /// Sets the sizes of a remote's process data, and whether its replies have a fault byte.
    pub fn set_sizes(&mut self, remote: &StartedRemote) {
        let link = &mut self.links[remote.channel];
        link.sizes = remote.sizes;
        link.has_fault_byte = remote.has_fault_byte();
    }

    /// Discards the state: no channel is certain to run.
    const fn forget(&mut self) {
        self.state = PortState::Unknown;
        self.running = ChannelMask::NONE;
    }
}

/// DATA after a START or DOIT: the channels on which the operation failed. Bits of other channels
/// have no meaning: channels that do not exist are reported as failed (FACTS 3). A remote fault
/// never sets a bit after DOIT (FACTS 5.3).
///
/// Manual: 7I77, "NORMAL START", "DOIT".
fn failed(seen: &impl PortImage) -> ChannelMask {
    ChannelMask::from_bits(seen.data() as u8)
}

fn with_cs(
    asked: ChannelMask,
    seen: &impl PortImage,
    condition: impl Fn(CsStatus) -> bool,
) -> ChannelMask {
    let fits = |channel: &Channel| condition(CsStatus(seen.cs(*channel)));
    asked.iter().filter(fits).collect()
}
