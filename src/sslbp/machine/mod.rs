//! A port as a state machine: which command may be written now, and what COMMAND, DATA, CS and the
//! interface registers mean afterwards. It knows neither bus nor clock, and never waits.
//!
//! A step is: [`observe`](Machine::observe) what a read brought; [`begin`](Machine::begin) an
//! operation, if the port is idle, and write its registers and its command;
//! [`written`](Machine::written). [`Port`](super::Port) runs it to its end over a bus, for set-up;
//! the cycle does one step for each read and write.

// The cycle runs it.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod failure;
mod link;

pub use failure::{Failure, FailureCounts};
pub use link::{Link, Verdict};

use super::{
    COMMAND_IGNORED, Channel, ChannelMask, CsStatus, Operation, PerChannel, StartMode,
    StartedRemote, Times,
};
use crate::bus::Instant;
use core::{array, fmt};

/// What the channels of a port that run are in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PortState {
    /// Not known: as another program left it.
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

/// The registers of a port as one read brought them. COMMAND is read first: what is read after it
/// is valid if it is 0.
pub trait Observed {
    /// COMMAND.
    fn command(&self) -> u32;
    /// DATA.
    fn data(&self) -> u32;
    /// CS of a channel.
    fn cs(&self, channel: Channel) -> u32;
    /// Interface registers 0 to 2 of a channel; only asked for when a START is complete.
    fn told(&self, channel: Channel) -> [u32; 3];
}

/// What a read says about the operation that is in flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// There is none, and the port is idle.
    Idle,
    /// It is not complete.
    Busy,
    /// COMMAND is 0; the other registers can be relied on from this time on.
    Settling(Instant),
    /// It is complete, and the port is idle.
    Complete(Complete),
}

/// An operation that is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Complete {
    /// The operation.
    pub operation: Operation,
    /// When it was written.
    pub issued: Instant,
    /// When it can have begun: the host may stand still between that and the end of the write.
    pub sent_from: Instant,
    /// How many reads between then and now did not show it complete, failed ones included.
    pub reads_before: u32,
    /// It is certain that the port got it, once and in order. If not, a transfer is no one's, but
    /// for the faults that it shows.
    pub certain: bool,
    /// The channels for which it did what it is for: they are stopped, run, or have new and sound
    /// data.
    pub good: ChannelMask,
    /// The others that were asked for, with something to tell: for a transfer, their
    /// [`verdict`](Link::verdict).
    pub bad: ChannelMask,
}

/// An operation that was written and is not known to be complete.
#[derive(Clone, Copy, Debug)]
struct InFlight {
    /// As it is known so far: no channel is good or bad.
    complete: Complete,
    busy_reads: u32,
    /// When COMMAND was seen to be 0.
    cleared: Option<Instant>,
}

impl InFlight {
    const fn new(operation: Operation, issued: Instant, certain: bool) -> Self {
        Self {
            complete: Complete {
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

/// One SSLBP port, without the bus that it is on.
///
/// # Real time
/// Every function is bounded by the number of channels and does not allocate.
#[derive(Clone, Debug)]
pub struct Machine {
    channels: ChannelMask,
    pub(super) state: PortState,
    pub(super) running: ChannelMask,
    links: PerChannel<Link>,
    /// COMMAND was 0 when it was read last, and nothing was written since.
    idle: bool,
    in_flight: Option<InFlight>,
    /// What `written` has to remember, once it is written.
    begun: Option<Operation>,
    /// From then on it may be executed.
    sent_from: Option<Instant>,
}

/// A busy COMMAND is stuck only after this many reads, however far apart they are.
const MIN_BUSY_READS: u32 = 3;

impl Machine {
    /// A port with these channels, in an unknown state.
    pub fn new(channels: ChannelMask) -> Self {
        Self {
            channels,
            state: PortState::Unknown,
            running: ChannelMask::NONE,
            links: PerChannel(array::from_fn(|_| Link::new())),
            idle: false,
            in_flight: None,
            begun: None,
            sent_from: None,
        }
    }

    /// What is known of a channel.
    pub fn link(&self, channel: Channel) -> &Link {
        &self.links[channel]
    }

    /// Whether an operation may be begun.
    pub const fn is_idle(&self) -> bool {
        self.idle
    }

    /// What was written and is not known to be complete, and when that was.
    pub fn in_flight(&self) -> Option<(Operation, Instant)> {
        let pending = &self.in_flight.as_ref()?.complete;
        Some((pending.operation, pending.issued))
    }

    /// Whether COMMAND stays busy for longer than what is in flight can take: only
    /// [`Operation::Free`] helps then.
    pub fn is_stuck(&self, now: Instant) -> bool {
        self.in_flight.as_ref().is_some_and(|pending| {
            let Complete {
                operation, issued, ..
            } = pending.complete;
            pending.busy_reads >= MIN_BUSY_READS && now.since(issued) > operation.times().longest
        })
    }

    /// The word for COMMAND that begins `operation`; one that the register ignores while the port
    /// is not idle. [`written`](Self::written) must follow.
    ///
    /// A transfer of a channel that does not run in normal mode is a mistake in the program, at which a
    /// debug build panics: nothing is sent to it, and its bit in DATA means nothing (FACTS 5.5).
    pub fn begin(&mut self, operation: Operation) -> u32 {
        if !self.idle && !operation.interrupts() {
            self.begun = None;
            return COMMAND_IGNORED;
        }
        if let Operation::Transfer(mask) = operation {
            debug_assert!(
                mask.difference(self.running).is_empty()
                    && self.state == PortState::Started(StartMode::Normal),
                "a channel that does not run is in a DOIT"
            );
        }
        self.begun = Some(operation);
        operation.command()
    }

    /// Nothing is begun with this write.
    pub const fn begin_nothing(&mut self) {
        self.begun = None;
    }

    /// What was begun is written from now on. Without this call, it is taken to begin at its end.
    pub const fn sending(&mut self, now: Instant) {
        self.sent_from = Some(now);
    }

    /// What was begun was written; `arrived`: it is not known that the port did not get it.
    pub fn written(&mut self, now: Instant, arrived: bool) {
        let sent_from = self.sent_from.take().unwrap_or(now);
        let Some(operation) = self.begun.take() else {
            return;
        };
        self.idle = false;
        if matches!(operation, Operation::Reset) {
            self.forget();
        }
        let mut in_flight = InFlight::new(operation, now, arrived);
        in_flight.complete.sent_from = sent_from;
        self.in_flight = Some(in_flight);
    }

    /// Takes what a read showed. `certain`: everything that was written before has arrived, once
    /// and in order.
    pub fn observe(&mut self, now: Instant, seen: &impl Observed, certain: bool) -> Event {
        self.begun = None;
        let is_busy = seen.command() != 0;
        if self.in_flight.is_none() && !is_busy {
            self.idle = true;
            return Event::Idle;
        }
        let foreign = || InFlight::new(Operation::Foreign, now, false);
        let pending = self.in_flight.get_or_insert_with(foreign);
        // Also while it is busy: with what, is not known.
        pending.complete.certain &= certain;
        if is_busy {
            self.idle = false;
            pending.seen_busy();
            return Event::Busy;
        }
        let Complete {
            operation, issued, ..
        } = pending.complete;
        let Times { usual, settle, .. } = operation.times();
        if !settle.is_zero() {
            let cleared = *pending.cleared.get_or_insert(now);
            let settled = cleared.min(issued.after(usual)).after(settle);
            if now < settled {
                return Event::Settling(settled);
            }
        }
        let complete = pending.complete;
        self.in_flight = None;
        self.idle = true;
        Event::Complete(self.complete(complete, seen))
    }

    /// A read failed: nothing is known about COMMAND.
    pub const fn not_observed(&mut self) {
        self.idle = false;
        self.begun = None;
        if let Some(pending) = &mut self.in_flight {
            pending.complete.reads_before = pending.complete.reads_before.saturating_add(1);
        }
    }

    /// The port was used for something else: what is in flight is not the caller's, and COMMAND is as
    /// the next read shows it.
    pub(crate) fn taken_over(&mut self) {
        self.idle = false;
        self.begun = None;
        self.in_flight = None;
    }

    /// What is in flight may not have happened.
    pub const fn doubt(&mut self) {
        if let Some(pending) = &mut self.in_flight {
            pending.complete.certain = false;
        }
    }

    fn complete(&mut self, mut complete: Complete, seen: &impl Observed) -> Complete {
        let asked = complete.operation.channels().intersection(self.channels);
        match complete.operation {
            Operation::Transfer(_) => self.judge(asked, seen, &mut complete),
            Operation::StopAll | Operation::Stop(_) => {
                complete.good = with_cs(asked, seen, CsStatus::is_stopped);
                complete.bad = asked.difference(complete.good);
                self.running = self.running.difference(asked);
                if matches!(complete.operation, Operation::StopAll) {
                    self.forget();
                    if complete.bad.is_empty() {
                        self.state = PortState::Stopped;
                    }
                }
            }
            Operation::Start(mode, _) => {
                complete.good = with_cs(asked, seen, |cs| cs.has_started(mode));
                complete.bad = asked.difference(complete.good);
                for channel in asked.iter() {
                    self.links[channel].started(CsStatus(seen.cs(channel)), seen.told(channel));
                }
                if !complete.good.is_empty() {
                    self.state = PortState::Started(mode);
                    self.running = self.running.union(complete.good);
                }
            }
            Operation::Access(..) => {
                complete.bad = failed(seen).intersection(asked);
                complete.good = asked.difference(complete.bad);
            }
            Operation::Release => self.state = PortState::Stopped,
            Operation::ReadLocal(_)
            | Operation::WriteLocal(_)
            | Operation::Free
            | Operation::Reset
            | Operation::Foreign => {}
        }
        complete
    }

    fn judge(&mut self, asked: ChannelMask, seen: &impl Observed, complete: &mut Complete) {
        let failed = failed(seen);
        for channel in asked.iter() {
            let (cs, mask) = (CsStatus(seen.cs(channel)), channel.mask());
            let link = &mut self.links[channel];
            if !complete.certain {
                // It is not known whether it happened: no data is taken, but a fault is a fault.
                if link.judge_doubtful(cs) {
                    complete.bad = complete.bad.union(mask);
                }
                continue;
            }
            let verdict = link.judge(cs, failed.contains(channel));
            if verdict == Verdict::Good {
                complete.good = complete.good.union(mask);
            } else {
                complete.bad = complete.bad.union(mask);
            }
            if verdict == Verdict::Failed(Failure::NotRunning) {
                self.running = self.running.difference(mask);
            }
        }
    }

    /// How much this remote exchanges, and whether its replies have a fault byte.
    pub fn set_sizes(&mut self, remote: &StartedRemote) {
        let link = &mut self.links[remote.channel];
        link.sizes = remote.sizes;
        link.has_fault_byte = remote.has_fault_byte();
    }

    /// Nothing runs for certain any more.
    const fn forget(&mut self) {
        self.state = PortState::Unknown;
        self.running = ChannelMask::NONE;
    }
}

/// DATA after a START or DOIT: the channels that did not do what was asked for. Bits of others mean
/// nothing: those that do not exist are reported as failed (FACTS 3). A remote fault never sets a bit
/// after DOIT (FACTS 5.3).
///
/// Manual: 7I77, "NORMAL START", "DOIT".
fn failed(seen: &impl Observed) -> ChannelMask {
    ChannelMask::from_bits(seen.data() as u8)
}

fn with_cs(
    asked: ChannelMask,
    seen: &impl Observed,
    condition: impl Fn(CsStatus) -> bool,
) -> ChannelMask {
    let fits = |channel: &Channel| condition(CsStatus(seen.cs(*channel)));
    asked.iter().filter(fits).collect()
}
