//! The remotes of a port in the cycle: the next operation, the remotes that are offline, and their
//! recovery. A layer on [`PortMachine`], independent of bus and pins.

mod configure;
mod restart;
#[cfg(test)]
mod tests;

use alloc::vec::Vec;
use core::time::Duration;

use super::cost::Cost;
use super::health::Health;
use super::parameter_writer::{ParameterWriter, WrittenParameter};
use super::statistics::PortStatistics;
use super::{FaultPolicy, OfflineReason, RemoteState};
use crate::bus::Instant;
use crate::remote::ParameterWrite;
use crate::sslbp::{
    ChannelMask, ChannelVariable, CompletedOperation, Failure, PortAccess, PortEvent, PortImage,
    PortMachine, PortOperation, PortParameters, StartMode, TransferResult,
};
use crate::tally::Tally;

/// The result of a read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ReadOutcome {
    /// Channels with new, valid data.
    pub good: ChannelMask,
    /// Channels with a transfer whose data must not be used.
    pub failed: ChannelMask,
    /// Channels that went offline with this read.
    pub offline: ChannelMask,
    /// Channels that a START has started.
    pub started_anew: ChannelMask,
    /// The transfer was not complete in time.
    pub too_short: bool,
    /// Start of the transfer to which `good` and `failed` belong, and the number of earlier reads
    /// that found it incomplete.
    pub started: Instant,
    pub reads_before: u32,
}

/// Progress of a restart. Channels are restarted together, because every attempt suspends the
/// transfers of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Restart {
    None,
    /// Stopped; the other channels get a transfer before the START, which takes long.
    Stopped(ChannelMask),
    /// The other channels have had that transfer.
    OthersServed(ChannelMask),
    Starting,
    /// Stopped; those of these channels that have parameters to write are being started in setup
    /// mode.
    SettingUp(ChannelMask),
    /// The parameters of the remotes that are `ready`, in setup mode, are being written. `all`
    /// channels are restarted afterwards.
    Configuring {
        all: ChannelMask,
        ready: ChannelMask,
    },
    /// Started; the sizes of these channels, which have not run before, are being read, RX first.
    Measuring {
        mask: ChannelMask,
        rx: Option<u8>,
    },
}

/// Progress of the last transfer, with safe values, of a port that is switched off.
///
/// A STOP after a transfer that was lost would leave outputs on until the remote's own watchdog bites.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum LastTransfer {
    #[default]
    Pending,
    /// Written, after this number of transfers that may not have arrived.
    InFlight(u8),
    Done,
}

impl LastTransfer {
    /// Doubtful transfers after which the remotes are stopped all the same.
    const MAX_DOUBTFUL: u8 = 10;

    /// The transfer in flight is complete.
    fn complete(&mut self, certain: bool) {
        if let Self::InFlight(doubtful) = *self {
            *self = match doubtful.saturating_add(1) {
                more if !certain && more < Self::MAX_DOUBTFUL => Self::InFlight(more),
                _ => Self::Done,
            };
        }
    }

    fn begin(&mut self) {
        if *self == Self::Pending {
            *self = Self::InFlight(0);
        }
    }
}

/// The remotes of a port.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Debug)]
pub(crate) struct Recovery {
    pub remotes: Vec<Health>,
    /// Channels with a remote.
    pub known: ChannelMask,
    /// Channels that transfer.
    running: ChannelMask,
    /// Channels with failures that good transfers have not made up for, or with an open row of
    /// failures.
    troubled: ChannelMask,
    /// Channels that run, and were offline since they were armed last.
    marked: ChannelMask,
    parameters: PortParameters,
    pub policy: FaultPolicy,
    pub run: bool,
    /// The board is set up, so that a failed transfer is the remote's own.
    pub is_board_running: bool,
    /// The board was set up again, and no remote has transferred since: remotes found stopped were
    /// stopped before.
    is_set_up_again: bool,
    /// The transfer of safe values before the remotes of a port that is switched off are stopped.
    last_transfer: LastTransfer,
    pub statistics: PortStatistics,
    restart: Restart,
    /// Restarts wait at least until this time, so that the other channels transfer meanwhile.
    no_restart_before: Instant,
    cost: Cost,
    no_free_before: Instant,
    /// The time of the transfer in flight has been counted.
    is_measured: bool,
    /// Parameters to write when the port is switched on again; it has room for all.
    requests: Vec<ParameterWrite>,
    /// The port was switched on again, and has not been restarted as a whole since: parameters may
    /// be written.
    may_configure: bool,
    writer: ParameterWriter,
    /// The write of a parameter that has ended with this read.
    pub ended: Option<WrittenParameter>,
}

/// Least time between two attempts to free COMMAND.
const BETWEEN_FREES: Duration = Duration::from_secs(1);

impl Recovery {
    /// A port with these remotes.
    pub fn new(
        remotes: Vec<Health>,
        parameters: PortParameters,
        policy: FaultPolicy,
        now: Instant,
    ) -> Self {
        let mut recovery = Self {
            known: remotes.iter().map(Health::channel).collect(),
            remotes,
            running: ChannelMask::NONE,
            troubled: ChannelMask::NONE,
            marked: ChannelMask::NONE,
            parameters,
            policy,
            run: true,
            is_board_running: true,
            is_set_up_again: false,
            last_transfer: LastTransfer::default(),
            statistics: PortStatistics::default(),
            restart: Restart::None,
            no_restart_before: now,
            cost: Cost::default(),
            no_free_before: now,
            is_measured: false,
            requests: Vec::new(),
            may_configure: false,
            writer: ParameterWriter::default(),
            ended: None,
        };
        recovery.update();
        recovery
    }

    /// Channels that transfer.
    pub const fn running(&self) -> ChannelMask {
        self.running
    }

    /// Channels that run, and were offline since they were armed last.
    pub const fn marked(&self) -> ChannelMask {
        self.marked
    }

    /// Updates the masks after any event other than a good transfer. Nothing else changes them.
    pub fn update(&mut self) {
        self.running = self.mask(Health::is_running);
        self.troubled = self.mask(Health::is_troubled);
        self.marked = self.mask(|remote| remote.is_running() && remote.first_fault.is_some());
    }

    /// Resets the counters after the board was set up again: failures and stops meanwhile were not
    /// the remotes' own.
    pub fn set_up_again(&mut self, now: Instant) {
        self.is_set_up_again = true;
        if self.is_configuring() {
            // A reset has stopped the remotes that were in setup mode.
            self.end_restart(now);
        }
        for remote in &mut self.remotes {
            remote.fault_count = 0;
        }
        self.update();
    }

    /// True while remotes are in setup mode, or are being started in it.
    fn is_configuring(&self) -> bool {
        matches!(
            self.restart,
            Restart::SettingUp(_) | Restart::Configuring { .. }
        )
    }

    /// The channels for which `condition` holds.
    fn mask(&self, condition: impl Fn(&Health) -> bool) -> ChannelMask {
        let remotes = self.remotes.iter().filter(|remote| condition(remote));
        remotes.map(Health::channel).collect()
    }

    /// The remotes on these channels.
    fn each(&mut self, mask: ChannelMask) -> impl Iterator<Item = &mut Health> {
        let remotes = self.remotes.iter_mut();
        remotes.filter(move |remote| mask.contains(remote.channel()))
    }

    /// True if the next read must include the interface registers, as START or an access leaves
    /// them.
    pub fn needs_start_data(&self) -> bool {
        self.restart == Restart::Starting || self.is_configuring()
    }

    /// Progress of a restart: 1 STOP, 2 START, 0 none.
    pub fn restart_step(&self, machine: &PortMachine) -> u32 {
        match self.restart {
            Restart::Starting
            | Restart::SettingUp(_)
            | Restart::Configuring { .. }
            | Restart::Measuring { .. } => 2,
            Restart::Stopped(_) | Restart::OthersServed(_) => 1,
            Restart::None => u32::from(self.run && is_stopping(machine)),
        }
    }

    /// The largest `fault-count` of the remotes.
    pub fn fault_count(&self) -> u32 {
        if self.troubled.is_empty() {
            return 0;
        }
        let counts = self.remotes.iter().map(|remote| remote.fault_count);
        counts.max().unwrap_or(0)
    }

    /// True if every remote that has run was found stopped, without a STOP command and since the
    /// board was set up; `None` if none has run.
    pub fn appears_reset(&self) -> Option<bool> {
        let mut ran = self.remotes.iter().filter(|remote| remote.has_run);
        let is_stopped = |remote: &Health| {
            matches!(remote.state, RemoteState::Offline { .. })
                && matches!(remote.cause, Some(OfflineReason::NotRunning(cs)) if cs.is_stopped())
        };
        let first = ran.next()?;
        Some(!self.is_set_up_again && is_stopped(first) && ran.all(is_stopped))
    }

    /// Records the duration of a transfer that is polled for and is complete.
    pub fn transfer_complete(&mut self, machine: &PortMachine, now: Instant) {
        if let Some((PortOperation::Transfer(_), issued)) = machine.in_flight()
            && !core::mem::replace(&mut self.is_measured, true)
        {
            self.statistics.doit.record(now.since(issued));
        }
    }

    /// Evaluates a read. `certain`: all previous writes have arrived, once and in order.
    pub fn observe(
        &mut self,
        machine: &mut PortMachine,
        now: Instant,
        seen: &impl PortImage,
        certain: bool,
    ) -> ReadOutcome {
        let mut outcome = ReadOutcome::default();
        let complete = match machine.observe(now, seen, certain) {
            PortEvent::Complete(complete) => complete,
            PortEvent::Busy => {
                outcome.too_short = is_transferring(machine);
                self.statistics.too_short.tally(outcome.too_short.into());
                return outcome;
            }
            PortEvent::Idle | PortEvent::Settling(_) => return outcome,
        };
        match complete.operation {
            PortOperation::Transfer(mask) => {
                self.count_transfer(complete.certain);
                (outcome.started, outcome.reads_before) =
                    (complete.sent_from, complete.reads_before);
                // Without remotes for which a restart was requested while the transfer was in
                // flight.
                outcome.good = complete.good.intersection(self.running);
                self.is_set_up_again &= outcome.good.is_empty();
                if complete.good == mask && self.troubled.is_empty() {
                    return outcome;
                }
                self.transferred(machine, now, &complete, &mut outcome);
            }
            PortOperation::Stop(_) => self.stopped(machine, now, &complete, seen),
            PortOperation::Start(StartMode::Setup, _) => self.setup_started(now, &complete),
            PortOperation::Access(channel, access) if complete.certain => {
                let [low, high, _] = seen.interfaces(channel);
                let value = access.value([low, high]);
                let value = complete.good.contains(channel).then_some(value);
                self.ended = self.writer.accessed(now, value);
                if let Some(ended) = self.ended {
                    self.parameter_ended(now, ended);
                }
            }
            PortOperation::Start(StartMode::Normal, _) => {
                outcome.started_anew = complete.good;
                self.started(machine, now, &complete);
            }
            // If uncertain, the access is repeated, and the size is read again.
            PortOperation::ReadLocal(_) if complete.certain => {
                self.measured(machine, now, seen.data() as u8);
            }
            PortOperation::Free => {
                self.all_offline(machine, now);
                outcome.offline = self.known;
            }
            _ => {}
        }
        self.update();
        outcome
    }

    /// Counts a transfer that is complete. `certain`: its data went out once and in order.
    fn count_transfer(&mut self, certain: bool) {
        self.last_transfer.complete(certain);
        if certain {
            self.statistics.transfers.tally(1);
        } else {
            self.statistics.unknown.tally(1);
        }
    }

    fn transferred(
        &mut self,
        machine: &PortMachine,
        now: Instant,
        complete: &CompletedOperation,
        outcome: &mut ReadOutcome,
    ) {
        let policy = &self.policy;
        for remote in &mut self.remotes {
            let (channel, mask) = (remote.channel(), remote.channel().mask());
            if complete.good.contains(channel) {
                remote.count_good(now, policy.fault_dec);
            }
            if !complete.bad.contains(channel) {
                continue;
            }
            let link = machine.link(channel);
            let reason = match link.verdict {
                TransferResult::Faulty(faults) => {
                    remote.faults = faults;
                    Some(OfflineReason::of_faults(faults))
                }
                TransferResult::Failed(Failure::NotRunning) => {
                    Some(OfflineReason::NotRunning(link.cs))
                }
                // No failure on the wire: the network lost a write, and the remote misses its
                // cycle.
                TransferResult::Good | TransferResult::Failed(Failure::Doubtful) => None,
                TransferResult::Failed(failure) => {
                    outcome.failed = outcome.failed.union(mask);
                    remote.rest_until = now.after(policy.rest);
                    let (own, reason) = if self.is_board_running {
                        (Some(failure), OfflineReason::TooManyFailures(failure))
                    } else {
                        (None, OfflineReason::BoardDown)
                    };
                    remote.count_fault(now, own, policy.fault_inc);
                    (remote.fault_count >= policy.fault_lim).then_some(reason)
                }
            };
            if let Some(reason) = reason {
                outcome.offline = outcome.offline.union(mask);
                remote.go_offline(now, reason, link.good, policy);
            }
        }
        outcome.failed = outcome.failed.difference(outcome.offline);
    }

    /// Begins the operation of this write; [`PortMachine::written`] must follow. Output data
    /// belongs to a transfer; without one, the data of the previous write must be repeated
    /// unchanged, because a transfer that still runs may be reading it.
    ///
    /// `hold`: channels are not restarted, because the board is not set up, and a restart needs
    /// writes that would set it up in part; or because all running remotes are to get safe values
    /// now.
    pub fn next(
        &mut self,
        machine: &mut PortMachine,
        now: Instant,
        hold: bool,
    ) -> Option<PortOperation> {
        let operation = if machine.is_idle() {
            self.choose(now, hold)
        } else if machine.is_stuck(now) && now >= self.no_free_before {
            self.no_free_before = now.after(BETWEEN_FREES);
            self.statistics.stuck.tally(1);
            Some(PortOperation::Free)
        } else {
            None
        };
        match operation {
            Some(operation) => {
                self.is_measured &= !matches!(operation, PortOperation::Transfer(_));
                let command = machine.begin(operation);
                debug_assert_eq!(command, operation.command(), "the port is not idle");
            }
            None => machine.begin_nothing(),
        }
        operation
    }

    /// The next operation of an idle port that is switched off. Outputs are safe already: a last
    /// transfer sends them to the remotes, and then the port is stopped.
    fn choose_last(&mut self, now: Instant) -> Option<PortOperation> {
        self.end_restart(now);
        let running = self.running;
        if !running.is_empty() && self.last_transfer != LastTransfer::Done {
            self.last_transfer.begin();
            return transfer(running);
        }
        self.stop_for_good(running, now)
    }

    /// The next operation of an idle port.
    fn choose(&mut self, now: Instant, hold: bool) -> Option<PortOperation> {
        if let Restart::Configuring { all, ready } = self.restart
            && !hold
        {
            return self.configure(now, all, ready);
        }
        if !self.run {
            return self.choose_last(now);
        }
        self.last_transfer = LastTransfer::Pending;
        let running = self.running;
        if hold {
            return transfer(running);
        }
        // Only remotes with failures rest.
        let ready = if self.troubled.is_empty() {
            running
        } else {
            self.mask(|remote| remote.is_running() && remote.rest_until <= now)
        };
        match self.restart {
            Restart::Stopped(mask) if !ready.is_empty() => {
                self.restart = Restart::OthersServed(mask);
                return transfer(ready);
            }
            Restart::Stopped(mask) | Restart::OthersServed(mask) => {
                if let Some(start) = self.begin_setup(mask) {
                    return Some(start);
                }
                self.restart = Restart::Starting;
                self.statistics.starts.tally(1);
                return Some(PortOperation::Start(StartMode::Normal, mask));
            }
            Restart::Measuring { mask, rx } => {
                let variable = match rx {
                    None => ChannelVariable::RxSize,
                    Some(_) => ChannelVariable::TxSize,
                };
                if let Some(channel) = mask.iter().next() {
                    let address = self.parameters.variable(channel, variable);
                    return Some(PortOperation::ReadLocal(address));
                }
                self.end_restart(now);
            }
            Restart::Starting | Restart::SettingUp(_) => self.end_restart(now),
            // `Configuring` goes on with `configure`, or is held.
            Restart::Configuring { .. } | Restart::None => {}
        }
        let due = self.due(now);
        if !due.is_empty() {
            return Some(self.begin_restart(now, due));
        }
        transfer(ready)
    }
}

/// A transfer of these channels, if there are any.
fn transfer(mask: ChannelMask) -> Option<PortOperation> {
    (!mask.is_empty()).then_some(PortOperation::Transfer(mask))
}

/// True if a transfer is in flight.
pub(crate) fn is_transferring(machine: &PortMachine) -> bool {
    matches!(machine.in_flight(), Some((PortOperation::Transfer(_), _)))
}

/// True if a STOP is in flight.
pub(crate) fn is_stopping(machine: &PortMachine) -> bool {
    matches!(machine.in_flight(), Some((PortOperation::Stop(_), _)))
}
