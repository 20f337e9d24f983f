//! A port as a state machine: which command may be written now, and what COMMAND, DATA, CS and the
//! interface registers mean afterwards. It knows neither bus nor clock, and never waits.
//!
//! A step is: [`observe`](Machine::observe) what a read brought; [`begin`](Machine::begin) an
//! operation, if the port is idle, and write its registers and its command;
//! [`written`](Machine::written). [`Port`](super::Port) runs it to its end over a bus, for set-up;
//! the cycle does one step for each read and write.

mod failure;
mod link;
mod operation;

pub use failure::{Failure, FailureCounts};
pub use link::{Link, Verdict};
pub use operation::{Operation, StartMode, Times, software_mode_word};

use super::{
    Channel, ChannelMask, Command, CsStatus, DataStatus, MAX_CHANNELS, PortState, ProcessDataSizes,
};
use crate::bus::Instant;

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
    operation: Operation,
    issued: Instant,
    certain: bool,
    busy_reads: u32,
    reads_before: u32,
    /// When COMMAND was seen to be 0.
    cleared: Option<Instant>,
}

/// One SSLBP port, without the bus that it is on.
///
/// # Real time
/// Every function is bounded by the number of channels and does not allocate.
#[derive(Clone, Debug)]
pub struct Machine {
    channels: ChannelMask,
    state: PortState,
    running: ChannelMask,
    links: [Link; MAX_CHANNELS as usize],
    /// COMMAND was 0 when it was read last, and nothing was written since.
    idle: bool,
    in_flight: Option<InFlight>,
    /// What `written` has to remember, once it is written.
    begun: Option<Operation>,
}

/// A busy COMMAND is stuck only after this many reads, however far apart they are.
const MIN_BUSY_READS: u32 = 3;

impl Machine {
    /// A port with these channels, in an unknown state.
    pub const fn new(channels: ChannelMask) -> Self {
        Self {
            channels,
            state: PortState::Unknown,
            running: ChannelMask::NONE,
            links: [const { Link::new() }; MAX_CHANNELS as usize],
            idle: false,
            in_flight: None,
            begun: None,
        }
    }

    /// What the channels that run are in.
    pub const fn state(&self) -> PortState {
        self.state
    }

    /// The channels that run.
    pub const fn running(&self) -> ChannelMask {
        self.running
    }

    /// What is known of a channel.
    pub fn link(&self, channel: Channel) -> &Link {
        let [first, ..] = &self.links;
        // A channel is one of the eight by construction.
        self.links
            .get(usize::from(channel.index()))
            .unwrap_or(first)
    }

    fn link_mut(&mut self, channel: Channel) -> Option<&mut Link> {
        self.links.get_mut(usize::from(channel.index()))
    }

    /// Whether an operation may be begun.
    pub const fn is_idle(&self) -> bool {
        self.idle
    }

    /// What was written and is not known to be complete.
    pub fn in_flight(&self) -> Option<&Operation> {
        self.in_flight.as_ref().map(|pending| &pending.operation)
    }

    /// When that was written.
    pub fn issued(&self) -> Option<Instant> {
        self.in_flight.as_ref().map(|pending| pending.issued)
    }

    /// Whether COMMAND stays busy for longer than what is in flight can take: only
    /// [`Operation::Free`] helps then.
    pub fn is_stuck(&self, now: Instant) -> bool {
        self.in_flight.as_ref().is_some_and(|pending| {
            pending.busy_reads >= MIN_BUSY_READS
                && now.since(pending.issued) > pending.operation.times().longest
        })
    }

    /// The word for COMMAND that begins `operation`; one that the register ignores while the port
    /// is not idle. [`written`](Self::written) must follow.
    pub fn begin(&mut self, operation: Operation) -> Command {
        if !self.idle && !operation.interrupts() {
            self.begun = None;
            return Command::IGNORED;
        }
        if let Operation::Transfer(mask) = operation {
            debug_assert!(
                mask.difference(self.running).is_empty() && self.state == PortState::Normal,
                "a channel that does not run is in a DOIT"
            );
        }
        self.begun = Some(operation);
        operation.command()
    }

    /// Nothing is begun with this write.
    pub fn begin_nothing(&mut self) {
        self.begun = None;
    }

    /// What was begun was written; `arrived`: it is not known that the port did not get it.
    pub fn written(&mut self, now: Instant, arrived: bool) {
        let Some(operation) = self.begun.take() else {
            return;
        };
        self.idle = false;
        if matches!(operation, Operation::Reset) {
            self.forget();
        }
        self.in_flight = Some(InFlight {
            operation,
            issued: now,
            certain: arrived,
            busy_reads: 0,
            reads_before: 0,
            cleared: None,
        });
    }

    /// Takes what a read showed. `certain`: everything that was written before has arrived, once
    /// and in order.
    pub fn observe(&mut self, now: Instant, seen: &impl Observed, certain: bool) -> Event {
        self.begun = None;
        let is_busy = seen.command() != 0;
        let Some(pending) = &mut self.in_flight else {
            self.idle = !is_busy;
            if is_busy {
                self.in_flight = Some(InFlight {
                    operation: Operation::Foreign,
                    issued: now,
                    certain: false,
                    busy_reads: 1,
                    reads_before: 1,
                    cleared: None,
                });
                return Event::Busy;
            }
            return Event::Idle;
        };
        // Also while it is busy: with what, is not known.
        pending.certain &= certain;
        if is_busy {
            self.idle = false;
            pending.busy_reads = pending.busy_reads.saturating_add(1);
            pending.reads_before = pending.reads_before.saturating_add(1);
            return Event::Busy;
        }
        let Times { usual, settle, .. } = pending.operation.times();
        if !settle.is_zero() {
            let cleared = *pending.cleared.get_or_insert(now);
            let settled = cleared.min(pending.issued.after(usual)).after(settle);
            if now < settled {
                return Event::Settling(settled);
            }
        }
        let pending = *pending;
        self.in_flight = None;
        self.idle = true;
        Event::Complete(self.complete(pending, seen))
    }

    /// A read failed: nothing is known about COMMAND.
    pub fn not_observed(&mut self) {
        self.idle = false;
        self.begun = None;
        if let Some(pending) = &mut self.in_flight {
            pending.reads_before = pending.reads_before.saturating_add(1);
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
    pub fn doubt(&mut self) {
        if let Some(pending) = &mut self.in_flight {
            pending.certain = false;
        }
    }

    fn complete(&mut self, pending: InFlight, seen: &impl Observed) -> Complete {
        let mut complete = Complete {
            operation: pending.operation,
            issued: pending.issued,
            reads_before: pending.reads_before,
            certain: pending.certain,
            good: ChannelMask::NONE,
            bad: ChannelMask::NONE,
        };
        let asked = pending.operation.channels().intersection(self.channels);
        match pending.operation {
            Operation::Transfer(_) if pending.certain => self.judge(asked, seen, &mut complete),
            Operation::Transfer(_) => self.judge_doubtful(asked, seen, &mut complete),
            Operation::StopAll | Operation::Stop(_) => {
                complete.good = with_cs(asked, seen, CsStatus::is_stopped);
                complete.bad = asked.difference(complete.good);
                self.running = self.running.difference(asked);
                if matches!(pending.operation, Operation::StopAll) {
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
                    let cs = CsStatus::from_register(seen.cs(channel));
                    if let Some(link) = self.link_mut(channel) {
                        link.started(cs, seen.told(channel));
                    }
                }
                if !complete.good.is_empty() {
                    self.state = mode.state();
                    self.running = self.running.union(complete.good);
                }
            }
            Operation::Access(..) => {
                let data = DataStatus::from_register(seen.data());
                complete.bad = data.failed(asked);
                complete.good = asked.difference(complete.bad);
            }
            Operation::Release => self.state = PortState::Stopped,
            Operation::ReadLocal(_)
            | Operation::WriteLocal(..)
            | Operation::Free
            | Operation::Reset
            | Operation::Foreign => {}
        }
        complete
    }

    fn judge(&mut self, asked: ChannelMask, seen: &impl Observed, complete: &mut Complete) {
        let data = DataStatus::from_register(seen.data());
        for channel in asked.iter() {
            let cs = CsStatus::from_register(seen.cs(channel));
            let Some(link) = self.link_mut(channel) else {
                continue;
            };
            let verdict = link.judge(cs, data.has_failed(channel));
            let mask = channel.mask();
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

    /// It is not known whether the transfer happened: no data is taken, but a fault is a fault.
    fn judge_doubtful(
        &mut self,
        asked: ChannelMask,
        seen: &impl Observed,
        complete: &mut Complete,
    ) {
        for channel in asked.iter() {
            let cs = CsStatus::from_register(seen.cs(channel));
            if let Some(link) = self.link_mut(channel)
                && link.judge_doubtful(cs)
            {
                complete.bad = complete.bad.union(channel.mask());
            }
        }
    }

    /// How much the remote on `channel` exchanges, and whether the first byte of its replies is
    /// data and no fault byte.
    pub fn set_sizes(&mut self, channel: Channel, sizes: ProcessDataSizes, data_only: bool) {
        if let Some(link) = self.link_mut(channel) {
            link.sizes = sizes;
            link.data_only = data_only;
        }
    }

    /// Nothing runs for certain any more.
    fn forget(&mut self) {
        self.state = PortState::Unknown;
        self.running = ChannelMask::NONE;
    }
}

fn with_cs(
    asked: ChannelMask,
    seen: &impl Observed,
    condition: impl Fn(CsStatus) -> bool,
) -> ChannelMask {
    let fits = |channel: &Channel| condition(CsStatus::from_register(seen.cs(*channel)));
    asked.iter().filter(fits).collect()
}
