//! The remotes of a port in the cycle: which operation is next, who is offline, and how they come
//! back. A layer on [`Machine`]: it knows neither bus nor pins.

mod restart;
#[cfg(test)]
mod tests;

use core::time::Duration;

use super::attempts::Cost;
use super::health::Health;
use super::statistics::PortStatistics;
use super::{FaultPolicy, OfflineReason, RemoteState};
use crate::bus::Instant;
use crate::sslbp::{
    Channel, ChannelMask, ChannelVariable, Command, Complete, Event, Failure, MAX_CHANNELS,
    Machine, Observed, Operation, PortParameters, StartMode, Verdict,
};

/// What a read means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Outcome {
    /// Channels whose data is new and sound.
    pub good: ChannelMask,
    /// Channels with a transfer whose data must not be used.
    pub failed: ChannelMask,
    /// Channels that went offline just now.
    pub offline: ChannelMask,
    /// The transfer was not complete in time.
    pub too_short: bool,
    /// When the transfer was started that `good` and `failed` are about, and how many reads could
    /// not take it before.
    pub started: Instant,
    pub reads_before: u32,
}

/// What to write next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Next {
    pub command: Command,
    /// Output data belongs to it; otherwise what was written before must be repeated unchanged,
    /// because a transfer that still runs may be reading it.
    pub with_data: bool,
    /// Channels whose software modes belong to it.
    pub modes: ChannelMask,
}

/// How far the restart of channels is. They are restarted together, because every attempt takes
/// the others' transfers away for a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Restart {
    None,
    /// Stopped; the others get a transfer before the START, which takes long.
    Stopped {
        mask: ChannelMask,
        others_served: bool,
    },
    Starting,
    /// Started; the sizes of these are looked at, which have not run before. RX is known first.
    Measuring {
        mask: ChannelMask,
        rx: Option<u8>,
    },
}

/// The remotes of a port.
#[derive(Debug)]
pub(crate) struct Recovery {
    remotes: [Option<Health>; MAX_CHANNELS as usize],
    known: ChannelMask,
    /// Those that transfer.
    running: ChannelMask,
    /// Those with failures that good transfers have not made up for.
    troubled: ChannelMask,
    /// Those that were offline since they were armed last.
    marked: ChannelMask,
    parameters: PortParameters,
    pub policy: FaultPolicy,
    pub run: bool,
    /// The port is switched off, and safe values were sent to its remotes.
    told_off: bool,
    pub statistics: PortStatistics,
    restart: Restart,
    /// Restarts wait at least until then, so that the other channels are served meanwhile.
    no_restart_before: Instant,
    cost: Cost,
    no_free_before: Instant,
    /// The time of the transfer in flight has been counted.
    is_measured: bool,
}

/// The way out is not tried more often than this.
const BETWEEN_FREES: Duration = Duration::from_secs(1);

impl Recovery {
    /// A port without remotes.
    pub fn new(parameters: PortParameters, policy: FaultPolicy, now: Instant) -> Self {
        Self {
            remotes: [const { None }; MAX_CHANNELS as usize],
            known: ChannelMask::NONE,
            running: ChannelMask::NONE,
            troubled: ChannelMask::NONE,
            marked: ChannelMask::NONE,
            parameters,
            policy,
            run: true,
            told_off: false,
            statistics: PortStatistics::default(),
            restart: Restart::None,
            no_restart_before: now,
            cost: Cost::default(),
            no_free_before: now,
            is_measured: false,
        }
    }

    /// A remote takes part.
    pub fn add(&mut self, channel: Channel, health: Health) {
        if let Some(place) = self.remotes.get_mut(usize::from(channel.index())) {
            *place = Some(health);
            self.known = self.known.union(channel.mask());
            self.update();
        }
    }

    /// Something other than good transfers has happened.
    fn update(&mut self) {
        self.running = self.mask(Health::is_running);
        self.troubled = self.mask(Health::is_troubled);
        self.marked = self.mask(|remote| remote.first_fault.is_some());
    }

    pub fn remote(&self, channel: Channel) -> Option<&Health> {
        self.remotes.get(usize::from(channel.index()))?.as_ref()
    }

    fn remote_mut(&mut self, channel: Channel) -> Option<&mut Health> {
        self.remotes.get_mut(usize::from(channel.index()))?.as_mut()
    }

    /// The channels for which `condition` holds.
    fn mask(&self, condition: impl Fn(&Health) -> bool) -> ChannelMask {
        let mut mask = ChannelMask::NONE;
        for (channel, remote) in Channel::ALL.into_iter().zip(&self.remotes) {
            if remote.as_ref().is_some_and(&condition) {
                mask = mask.union(channel.mask());
            }
        }
        mask
    }

    /// Channels to be looked at whether their remotes have been armed.
    pub const fn marked(&self) -> ChannelMask {
        self.marked.intersection(self.running)
    }

    /// The outputs of a remote follow the application.
    pub fn armed(&mut self, channel: Channel) {
        if let Some(remote) = self.remote_mut(channel) {
            remote.armed();
            self.update();
        }
    }

    /// Channels with a remote.
    pub const fn known(&self) -> ChannelMask {
        self.known
    }

    /// Channels that transfer.
    pub const fn running(&self) -> ChannelMask {
        self.running
    }

    /// Whether the next read must show the interface registers as START leaves them.
    pub fn needs_start_data(&self) -> bool {
        self.restart == Restart::Starting
    }

    /// How far a restart is: 1 STOP, 2 START, 0 none.
    pub fn restart_step(&self, machine: &Machine) -> u32 {
        match self.restart {
            Restart::Starting | Restart::Measuring { .. } => 2,
            Restart::Stopped { .. } => 1,
            Restart::None => u32::from(self.run && is_stopping(machine)),
        }
    }

    /// The largest `fault-count` of its remotes.
    pub fn fault_count(&self) -> u32 {
        if self.troubled.is_empty() {
            return 0;
        }
        let counts = self.remotes.iter().flatten().map(|r| r.fault_count);
        counts.max().unwrap_or(0)
    }

    /// Whether every remote that has run was found stopped, without a STOP command; `None` if none
    /// has run.
    pub fn appears_reset(&self) -> Option<bool> {
        let mut ran = self.remotes.iter().flatten().filter(|r| r.has_run);
        let is_stopped = |remote: &Health| {
            matches!(remote.state, RemoteState::Offline { .. })
                && matches!(remote.cause, Some(OfflineReason::NotRunning(cs)) if cs.is_stopped())
        };
        let first = ran.next()?;
        Some(is_stopped(first) && ran.all(is_stopped))
    }

    /// Counts the time of a transfer that is polled for and is complete.
    pub fn transfer_complete(&mut self, machine: &Machine, now: Instant) {
        if let (true, Some(issued)) = (is_transferring(machine), machine.issued())
            && !core::mem::replace(&mut self.is_measured, true)
        {
            self.statistics.doit.record(now.since(issued));
        }
    }

    /// Takes what a read showed. `certain`: all writes before it have arrived, once and in order.
    pub fn observe(
        &mut self,
        machine: &mut Machine,
        now: Instant,
        seen: &impl Observed,
        certain: bool,
    ) -> Outcome {
        let complete = match machine.observe(now, seen, certain) {
            Event::Complete(complete) => complete,
            Event::Busy => {
                let too_short = is_transferring(machine);
                self.statistics.too_short += u64::from(too_short);
                return Outcome {
                    too_short,
                    ..Outcome::default()
                };
            }
            Event::Idle | Event::Settling(_) => return Outcome::default(),
        };
        if let Operation::Transfer(mask) = complete.operation
            && complete.good == mask
            && self.troubled.is_empty()
        {
            self.statistics.transfers += 1;
            return Outcome {
                good: self.that_run(complete.good),
                started: complete.issued,
                reads_before: complete.reads_before,
                ..Outcome::default()
            };
        }
        let outcome = self.completed(machine, now, &complete, seen);
        self.update();
        outcome
    }

    /// Those of them that were not told to restart while their transfer was in flight.
    const fn that_run(&self, good: ChannelMask) -> ChannelMask {
        good.intersection(self.running)
    }

    fn completed(
        &mut self,
        machine: &Machine,
        now: Instant,
        complete: &Complete,
        seen: &impl Observed,
    ) -> Outcome {
        match complete.operation {
            Operation::Transfer(_) if complete.certain => {
                self.statistics.transfers += 1;
                self.transferred(machine, now, complete)
            }
            Operation::Transfer(_) => {
                self.statistics.unknown += 1;
                self.transferred(machine, now, complete)
            }
            Operation::Stop(_) => {
                self.stopped(machine, now, complete, seen);
                Outcome::default()
            }
            Operation::Start(..) => {
                self.started(machine, now, complete, seen);
                Outcome::default()
            }
            // Otherwise it is read again.
            Operation::ReadLocal(_) if complete.certain => {
                self.measured(machine, now, seen.data() as u8);
                Outcome::default()
            }
            Operation::Free => self.all_offline(machine, now),
            _ => Outcome::default(),
        }
    }

    fn transferred(&mut self, machine: &Machine, now: Instant, complete: &Complete) -> Outcome {
        let policy = self.policy;
        let mut outcome = Outcome {
            good: self.that_run(complete.good),
            started: complete.issued,
            reads_before: complete.reads_before,
            ..Outcome::default()
        };
        for channel in complete.good.intersection(self.troubled).iter() {
            if let Some(remote) = self.remote_mut(channel) {
                remote.count_good(policy.fault_dec);
            }
        }
        for channel in complete.bad.iter() {
            let link = machine.link(channel);
            let Some(remote) = self.remote_mut(channel) else {
                continue;
            };
            let reason = match link.verdict() {
                Verdict::Good => None,
                Verdict::Faulty(faults) => {
                    remote.faults = faults;
                    OfflineReason::of_faults(faults)
                }
                Verdict::Failed(Failure::NotRunning) => Some(OfflineReason::NotRunning(link.cs())),
                Verdict::Failed(Failure::Doubtful) => {
                    outcome.failed = outcome.failed.union(channel.mask());
                    None
                }
                Verdict::Failed(failure) => {
                    outcome.failed = outcome.failed.union(channel.mask());
                    remote.rest_until = now.after(policy.rest);
                    remote.count_fault(policy.fault_inc);
                    (remote.fault_count >= policy.fault_lim)
                        .then_some(OfflineReason::TooManyFailures(failure))
                }
            };
            if let Some(reason) = reason {
                outcome.offline = outcome.offline.union(channel.mask());
                remote.go_offline(now, reason, link.good_since_start(), &policy);
            }
        }
        outcome.failed = outcome.failed.difference(outcome.offline);
        outcome
    }

    /// The command for this write; [`Machine::written`] must follow.
    ///
    /// `hold`: channels are not restarted. The board is not set up, and that needs writes that would
    /// set it up in part; or all that run are to be told safe values now.
    pub fn next(&mut self, machine: &mut Machine, now: Instant, hold: bool) -> Next {
        let operation = if machine.is_idle() {
            self.choose(now, hold)
        } else if machine.is_stuck(now) && now >= self.no_free_before {
            self.no_free_before = now.after(BETWEEN_FREES);
            self.statistics.stuck += 1;
            Some(Operation::Free)
        } else {
            None
        };
        let mut next = Next {
            command: Command::IGNORED,
            with_data: false,
            modes: ChannelMask::NONE,
        };
        let Some(operation) = operation else {
            machine.begin_nothing();
            return next;
        };
        match operation {
            Operation::Transfer(_) => {
                next.with_data = true;
                self.is_measured = false;
            }
            Operation::Start(_, mask) => next.modes = mask,
            _ => {}
        }
        next.command = machine.begin(operation);
        next
    }

    fn choose(&mut self, now: Instant, hold: bool) -> Option<Operation> {
        let running = self.running;
        // What rests has failed.
        let ready = if self.troubled.is_empty() {
            running
        } else {
            self.mask(|remote| remote.is_running() && remote.rest_until <= now)
        };
        let transfer = |mask: ChannelMask| (!mask.is_empty()).then_some(Operation::Transfer(mask));
        if !self.run {
            self.end_restart(now);
            // Outputs are safe already, and a last transfer takes that to the remotes.
            if !running.is_empty() && !core::mem::replace(&mut self.told_off, true) {
                return transfer(running);
            }
            return self.stop_for_good(running);
        }
        self.told_off = false;
        if hold {
            return transfer(running);
        }
        match self.restart {
            Restart::Stopped {
                mask,
                others_served,
            } => {
                if !others_served && !ready.is_empty() {
                    self.restart = Restart::Stopped {
                        mask,
                        others_served: true,
                    };
                    return transfer(ready);
                }
                self.restart = Restart::Starting;
                self.statistics.starts += 1;
                return Some(Operation::Start(StartMode::Normal, mask));
            }
            Restart::Measuring { mask, rx } => {
                let next = mask.iter().next().and_then(|channel| {
                    let variable = match rx {
                        None => ChannelVariable::RxSize,
                        Some(_) => ChannelVariable::TxSize,
                    };
                    self.parameters.variable(channel, variable, 0)
                });
                if let Some(address) = next {
                    return Some(Operation::ReadLocal(address));
                }
                self.end_restart(now);
            }
            Restart::Starting => self.end_restart(now),
            Restart::None => {}
        }
        let due = self.due(now);
        if !due.is_empty() {
            return Some(self.begin_restart(now, due));
        }
        transfer(ready)
    }
}

/// Whether a transfer is in flight.
pub(crate) fn is_transferring(machine: &Machine) -> bool {
    matches!(machine.in_flight(), Some(Operation::Transfer(_)))
}

/// Whether a STOP is in flight.
pub(crate) fn is_stopping(machine: &Machine) -> bool {
    matches!(machine.in_flight(), Some(Operation::Stop(_)))
}
