//! The remotes of a port in the cycle: which operation is next, who is set aside, and how they come
//! back. A layer on [`Machine`]: it knows neither bus nor pins.

use core::time::Duration;

use super::attempts::Cost;
use super::health::Health;
use super::statistics::PortStatistics;
use super::{FaultPolicy, RemoteState, RemoteWatchdog, SetAside};
use crate::bus::Instant;
use crate::sslbp::{
    Channel, ChannelMask, ChannelVariable, Command, Complete, CsStatus, Event, Failure,
    MAX_CHANNELS, Machine, Observed, Operation, PortParameters, ProcessDataSizes, StartMode,
    Verdict,
};

/// What a read means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Outcome {
    /// Channels whose data is new and sound.
    pub good: ChannelMask,
    /// Channels with a transfer whose data must not be used.
    pub failed: ChannelMask,
    /// Channels that were set aside just now.
    pub set_aside: ChannelMask,
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
    parameters: PortParameters,
    pub policy: FaultPolicy,
    pub run: bool,
    /// The port is switched off, and its remotes have been told safe values.
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
/// Other remotes' watchdogs allow 50 ms without process data (FACTS 1.5); a restart takes up to
/// 18 ms, and this much lies between two.
const BETWEEN_RESTARTS: Duration = Duration::from_millis(60);

impl Recovery {
    /// A port without remotes.
    pub fn new(parameters: PortParameters, policy: FaultPolicy, now: Instant) -> Self {
        Self {
            remotes: [const { None }; MAX_CHANNELS as usize],
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
        }
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

    /// The outputs of a remote follow the application.
    pub fn armed(&mut self, channel: Channel) {
        if let Some(remote) = self.remote_mut(channel) {
            remote.armed();
        }
    }

    /// Channels with a remote.
    pub fn known(&self) -> ChannelMask {
        self.mask(|_| true)
    }

    /// Channels that transfer.
    pub fn running(&self) -> ChannelMask {
        self.mask(Health::is_running)
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
        let counts = self.remotes.iter().flatten().map(|r| r.fault_count);
        counts.max().unwrap_or(0)
    }

    /// Whether every remote was found stopped, without a STOP command.
    pub fn appears_reset(&self) -> bool {
        self.remotes.iter().flatten().all(|remote| {
            matches!(remote.state, RemoteState::SetAside { .. })
                && matches!(remote.cause, Some(SetAside::NotRunning(cs)) if cs.is_stopped())
        })
    }

    /// Notes when a transfer was complete, where somebody polled for it.
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
        match complete.operation {
            Operation::Transfer(_) if complete.certain => {
                self.statistics.transfers += 1;
                self.transferred(machine, now, &complete)
            }
            Operation::Transfer(_) => {
                self.statistics.unknown += 1;
                self.transferred(machine, now, &complete)
            }
            Operation::Stop(_) => {
                self.stopped(machine, now, &complete, seen);
                Outcome::default()
            }
            Operation::Start(..) => {
                self.started(machine, now, &complete, seen);
                Outcome::default()
            }
            // Otherwise it is read again.
            Operation::ReadLocal(_) if complete.certain => {
                self.measured(machine, now, seen.data() as u8);
                Outcome::default()
            }
            Operation::Free => self.set_all_aside(machine, now),
            _ => Outcome::default(),
        }
    }

    fn transferred(&mut self, machine: &Machine, now: Instant, complete: &Complete) -> Outcome {
        let policy = self.policy;
        let mut outcome = Outcome {
            good: complete.good,
            started: complete.issued,
            reads_before: complete.reads_before,
            ..Outcome::default()
        };
        for channel in complete.good.iter() {
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
                    SetAside::of_faults(faults)
                }
                Verdict::Failed(Failure::NotRunning) => Some(SetAside::NotRunning(link.cs())),
                Verdict::Failed(Failure::Doubtful) => {
                    outcome.failed = outcome.failed.union(channel.mask());
                    None
                }
                Verdict::Failed(failure) => {
                    outcome.failed = outcome.failed.union(channel.mask());
                    remote.rest_until = now.after(policy.rest);
                    remote.count_fault(policy.fault_inc);
                    (remote.fault_count >= policy.fault_lim)
                        .then_some(SetAside::TooManyFailures(failure))
                }
            };
            if let Some(reason) = reason {
                outcome.set_aside = outcome.set_aside.union(channel.mask());
                remote.set_aside(now, reason, link.good_since_start(), &policy);
            }
        }
        outcome.failed = outcome.failed.difference(outcome.set_aside);
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
        let running = self.running();
        let ready = self.mask(|remote| remote.is_running() && remote.rest_until <= now);
        let transfer = |mask: ChannelMask| (!mask.is_empty()).then_some(Operation::Transfer(mask));
        if !self.run {
            self.end_restart(now);
            // Outputs are safe already: the remotes are told before nobody talks to them any more.
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

/// How remotes come back: STOP, START, and what START found.
impl Recovery {
    /// Tries a remote again at once, whatever its pause; not before its outputs must be off.
    pub fn restart_now(&mut self, channel: Channel, now: Instant) {
        let policy = self.policy;
        if let Some(remote) = self.remote_mut(channel) {
            remote.ask_for_restart(now, &policy);
        }
    }

    /// The port was used for something else: all remotes are stopped.
    pub fn taken_over(&mut self) {
        self.restart = Restart::None;
        self.cost = Cost::default();
    }

    pub fn set_watchdog(&mut self, channel: Channel, watchdog: RemoteWatchdog) {
        if let Some(remote) = self.remote_mut(channel) {
            remote.watchdog = watchdog;
        }
    }

    fn set_aside(&mut self, machine: &Machine, now: Instant, channel: Channel, reason: SetAside) {
        let policy = self.policy;
        let good = machine.link(channel).good_since_start();
        if let Some(remote) = self.remote_mut(channel) {
            remote.set_aside(now, reason, good, &policy);
        }
    }

    /// COMMAND had to be freed: what was sent to whom is not known.
    fn set_all_aside(&mut self, machine: &Machine, now: Instant) -> Outcome {
        self.end_restart(now);
        let known = self.known();
        for channel in known.iter() {
            self.set_aside(machine, now, channel, SetAside::PortStuck);
        }
        Outcome {
            set_aside: known,
            ..Outcome::default()
        }
    }

    /// Channels whose time to be tried again has come.
    fn due(&self, now: Instant) -> ChannelMask {
        if now < self.no_restart_before {
            return ChannelMask::NONE;
        }
        let due = self.mask(|remote| match remote.state {
            RemoteState::SetAside { next_attempt, .. } => {
                next_attempt.is_some_and(|time| time <= now)
            }
            // Left over from a command that was lost.
            RemoteState::Restarting { .. } => true,
            RemoteState::Running => false,
        });
        if due.is_empty() || !self.is_free(due) && !self.cost.allows(now, &self.policy) {
            return ChannelMask::NONE;
        }
        due.union(self.along_with(due, now))
    }

    /// One START that waits for a remote which does not answer takes as long as one that waits for
    /// several: those that did not answer before are all tried with the first of them.
    fn along_with(&self, due: ChannelMask, now: Instant) -> ChannelMask {
        let failed = self.mask(|remote| remote.attempts.has_failed);
        if due.intersection(failed).is_empty() {
            return ChannelMask::NONE;
        }
        self.mask(|remote| {
            let is_planned = matches!(
                remote.state,
                RemoteState::SetAside {
                    next_attempt: Some(_),
                    ..
                }
            );
            is_planned && remote.attempts.has_failed && remote.attempts.silent_until <= now
        })
    }

    /// Nobody else is there, or the application has asked for it: the cost does not count.
    fn is_free(&self, due: ChannelMask) -> bool {
        let asked = self.mask(|remote| remote.attempts.is_asked_for);
        self.running().is_empty() || !due.intersection(asked).is_empty()
    }

    fn begin_restart(&mut self, now: Instant, due: ChannelMask) -> Operation {
        if !self.is_free(due) {
            self.cost.begin(now);
        }
        for channel in due.iter() {
            if let Some(remote) = self.remote_mut(channel) {
                remote.restarting();
            }
        }
        Operation::Stop(due)
    }

    fn end_restart(&mut self, now: Instant) {
        self.restart = Restart::None;
        self.cost.end(now, &self.policy);
    }

    /// STOP is complete.
    fn stopped(
        &mut self,
        machine: &Machine,
        now: Instant,
        complete: &Complete,
        seen: &impl Observed,
    ) {
        for channel in complete.bad.iter() {
            let cs = CsStatus::from_register(seen.cs(channel));
            self.set_aside(machine, now, channel, SetAside::DidNotStart(cs));
        }
        let wanted = self.mask(|remote| matches!(remote.state, RemoteState::Restarting { .. }));
        let mask = complete.good.intersection(wanted);
        if mask.is_empty() {
            self.end_restart(now);
        } else {
            self.restart = Restart::Stopped {
                mask,
                others_served: false,
            };
        }
    }

    /// START is complete.
    fn started(
        &mut self,
        machine: &Machine,
        now: Instant,
        complete: &Complete,
        seen: &impl Observed,
    ) {
        if self.restart == Restart::Starting {
            self.no_restart_before = now.after(BETWEEN_RESTARTS);
        }
        for channel in complete.bad.iter() {
            let cs = CsStatus::from_register(seen.cs(channel));
            if let Some(remote) = self.remote_mut(channel) {
                remote.did_not_start(cs);
                self.set_aside(machine, now, channel, SetAside::DidNotStart(cs));
            }
        }
        let mut unknown = ChannelMask::NONE;
        for channel in complete.good.iter() {
            let told = machine.link(channel).told();
            let Some(remote) = self.remote_mut(channel) else {
                continue;
            };
            if !remote.expected.fits(told) {
                let [unit_number, name, _] = told;
                self.set_aside(
                    machine,
                    now,
                    channel,
                    SetAside::AnotherDevice { name, unit_number },
                );
            } else if remote.has_run {
                remote.restarted(told);
            } else {
                unknown = unknown.union(channel.mask());
            }
        }
        if unknown.is_empty() {
            self.end_restart(now);
        } else {
            self.restart = Restart::Measuring {
                mask: unknown,
                rx: None,
            };
        }
    }

    /// A size of a remote that has not run before was read.
    fn measured(&mut self, machine: &Machine, now: Instant, size: u8) {
        let Restart::Measuring { mask, rx } = self.restart else {
            return;
        };
        let Some(channel) = mask.iter().next() else {
            return self.end_restart(now);
        };
        let Some(rx) = rx else {
            self.restart = Restart::Measuring {
                mask,
                rx: Some(size),
            };
            return;
        };
        let found = ProcessDataSizes { rx, tx: size };
        let expected = machine.link(channel).sizes();
        if found != expected {
            self.set_aside(
                machine,
                now,
                channel,
                SetAside::OtherSizes { found, expected },
            );
        } else if let Some(remote) = self.remote_mut(channel) {
            remote.restarted(machine.link(channel).told());
        }
        let mask = mask.difference(channel.mask());
        if mask.is_empty() {
            self.end_restart(now);
        } else {
            self.restart = Restart::Measuring { mask, rx: None };
        }
    }

    /// The application has switched the port off.
    fn stop_for_good(&mut self, running: ChannelMask) -> Option<Operation> {
        for remote in self.remotes.iter_mut().flatten() {
            remote.stop_for_good();
        }
        (!running.is_empty()).then_some(Operation::Stop(running))
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

#[cfg(test)]
mod tests;
