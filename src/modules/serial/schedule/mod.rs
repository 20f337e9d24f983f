//! The next operation of a port: transfers, restarts of remotes, and what a port that is switched
//! off gets. A layer on [`PortMachine`], independent of the bus.

mod configure;
mod restart;
#[cfg(test)]
mod tests;

use alloc::vec::Vec;
use core::time::Duration;

use super::cost::Cost;
use super::life::{ChangeContext, LifeChange};
use super::outcome::ReadOutcome;
use super::parameter_writer::{ParameterWriter, WrittenParameter};
use super::remote::Remote;
use super::remotes::Remotes;
use super::statistics::PortStatistics;
use crate::bus::Instant;
use crate::events::OfflineReason;
use crate::remote::ParameterWrite;
use crate::settings::FaultPolicy;
use crate::sslbp::{
    ChannelMask, ChannelVariable, CompletedOperation, Failure, PortAccess, PortEvent, PortImage,
    PortMachine, PortOperation, PortParameters, StartMode, TransferResult,
};
use crate::tally::Tally;

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
/// A STOP after a transfer that was lost would leave outputs on until the remote's own watchdog
/// bites.
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

/// What a port does next.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Debug)]
pub(super) struct Schedule {
    parameters: PortParameters,
    pub run: bool,
    /// The board is set up, so that a failed transfer is the remote's own.
    pub is_board_running: bool,
    /// The board was set up again, and no remote has transferred since: remotes found stopped were
    /// stopped before.
    set_up_restored: bool,
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

impl Schedule {
    pub fn new(parameters: PortParameters, policy: &FaultPolicy, now: Instant) -> Self {
        Self {
            parameters,
            run: true,
            is_board_running: true,
            set_up_restored: false,
            last_transfer: LastTransfer::default(),
            statistics: PortStatistics::default(),
            restart: Restart::None,
            no_restart_before: now,
            cost: Cost::new(policy),
            no_free_before: now,
            is_measured: false,
            requests: Vec::new(),
            may_configure: false,
            writer: ParameterWriter::default(),
            ended: None,
        }
    }

    /// Resets the counters after the board was set up again: failures and stops meanwhile were not
    /// the remotes' own.
    pub fn set_up_restored(&mut self, remotes: &mut Remotes, now: Instant) {
        self.set_up_restored = true;
        if self.is_configuring() {
            // A reset has stopped the remotes that were in setup mode.
            self.end_restart(now);
        }
        let all = remotes.configured();
        remotes.change(all, now, |remote, _| {
            remote.failures.forget_count();
            LifeChange::default()
        });
    }

    /// True while remotes are in setup mode, or are being started in it.
    fn is_configuring(&self) -> bool {
        matches!(
            self.restart,
            Restart::SettingUp(_) | Restart::Configuring { .. }
        )
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

    /// True if every remote that has run was found stopped, without a STOP command and since the
    /// board was set up; `None` if none has run.
    pub fn appears_reset(&self, remotes: &Remotes) -> Option<bool> {
        let mut ran = remotes.iter().filter(|remote| remote.life.has_run());
        let is_stopped = |remote: &Remote| remote.life.was_found_stopped();
        let first = ran.next()?;
        Some(!self.set_up_restored && is_stopped(first) && ran.all(is_stopped))
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
        remotes: &mut Remotes,
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
        outcome.new_faults = match complete.operation {
            PortOperation::Transfer(mask) => {
                self.count_transfer(complete.certain);
                (outcome.started, outcome.reads_before) =
                    (complete.sent_from, complete.reads_before);
                // Without remotes for which a restart was requested while the transfer was in
                // flight.
                outcome.good = complete.good.intersection(remotes.running());
                self.set_up_restored &= outcome.good.is_empty();
                if complete.good == mask && remotes.with_failures().is_empty() {
                    return outcome;
                }
                self.transferred(machine, remotes, now, &complete, &mut outcome)
            }
            PortOperation::Stop(_) => self.stopped(machine, remotes, now, &complete, seen),
            PortOperation::Start(StartMode::Normal, _) => {
                outcome.started_anew = complete.good;
                self.started(machine, remotes, now, &complete)
            }
            PortOperation::Start(StartMode::Setup, _) => {
                self.setup_started(now, &complete);
                ChannelMask::NONE
            }
            PortOperation::Access(channel, access) if complete.certain => {
                let [low, high, _] = seen.interfaces(channel);
                let value = access.value([low, high]);
                let value = complete.good.contains(channel).then_some(value);
                self.ended = self.writer.accessed(now, value);
                if let Some(ended) = self.ended {
                    self.parameter_ended(remotes, now, ended);
                }
                ChannelMask::NONE
            }
            // If uncertain, the access is repeated, and the size is read again.
            PortOperation::ReadLocal(_) if complete.certain => {
                self.measured(machine, remotes, now, seen.data() as u8)
            }
            PortOperation::Free => {
                outcome.offline = remotes.configured();
                self.all_offline(machine, remotes, now)
            }
            _ => ChannelMask::NONE,
        };
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
        &self,
        machine: &PortMachine,
        remotes: &mut Remotes,
        now: Instant,
        complete: &CompletedOperation,
        outcome: &mut ReadOutcome,
    ) -> ChannelMask {
        let (mut failed, mut offline) = (ChannelMask::NONE, ChannelMask::NONE);
        let all = remotes.configured();
        let new_faults = remotes.change(all, now, |remote, at| {
            let (channel, mask) = (remote.channel(), remote.channel().mask());
            if complete.good.contains(channel) {
                remote.failures.count_good(at, remote.label());
            }
            if !complete.bad.contains(channel) {
                return LifeChange::default();
            }
            let link = machine.link(channel);
            let reason = match link.verdict {
                TransferResult::Faulty(faults) => {
                    offline = offline.union(mask);
                    return remote.take_faults(at, faults, link.good);
                }
                TransferResult::Failed(Failure::NotRunning) => {
                    Some(OfflineReason::NotRunning(link.cs))
                }
                // No failure on the wire: the network lost a write, and the remote misses its
                // cycle.
                TransferResult::Good | TransferResult::Failed(Failure::Doubtful) => None,
                TransferResult::Failed(failure) => {
                    failed = failed.union(mask);
                    self.transfer_failed(remote, at, failure)
                }
            };
            let Some(reason) = reason else {
                return LifeChange::default();
            };
            offline = offline.union(mask);
            remote.go_offline(at, reason, link.good)
        });
        (outcome.failed, outcome.offline) = (failed.difference(offline), offline);
        new_faults
    }

    /// Counts a failed transfer of a remote; returns the reason to take it offline if there have
    /// been too many.
    fn transfer_failed(
        &self,
        remote: &mut Remote,
        at: ChangeContext<'_>,
        failure: Failure,
    ) -> Option<OfflineReason> {
        let (own, reason) = if self.is_board_running {
            (Some(failure), OfflineReason::TooManyFailures(failure))
        } else {
            (None, OfflineReason::BoardDown)
        };
        let count = remote.failures.count_failed(at, remote.label(), own);
        (count >= at.policy.fault_lim).then_some(reason)
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
        remotes: &mut Remotes,
        now: Instant,
        hold: bool,
    ) -> Option<PortOperation> {
        let operation = if machine.is_idle() {
            self.choose(remotes, now, hold)
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
    fn choose_last(&mut self, remotes: &mut Remotes, now: Instant) -> Option<PortOperation> {
        self.end_restart(now);
        let running = remotes.running();
        if !running.is_empty() && self.last_transfer != LastTransfer::Done {
            self.last_transfer.begin();
            return transfer(running);
        }
        let all = remotes.configured();
        remotes.change(all, now, Remote::stop);
        (!running.is_empty()).then_some(PortOperation::Stop(running))
    }

    /// The next operation of an idle port.
    fn choose(&mut self, remotes: &mut Remotes, now: Instant, hold: bool) -> Option<PortOperation> {
        if let Restart::Configuring { all, ready } = self.restart
            && !hold
        {
            return self.configure(remotes, now, all, ready);
        }
        if !self.run {
            return self.choose_last(remotes, now);
        }
        self.last_transfer = LastTransfer::Pending;
        let running = remotes.running();
        if hold {
            return transfer(running);
        }
        // Only remotes with failures rest.
        let ready = if remotes.with_failures().is_empty() {
            running
        } else {
            running.difference(remotes.mask(|remote| remote.failures.rests(now)))
        };
        match self.restart {
            Restart::Stopped(mask) if !ready.is_empty() => {
                self.restart = Restart::OthersServed(mask);
                return transfer(ready);
            }
            Restart::Stopped(mask) | Restart::OthersServed(mask) => {
                if let Some(start) = self.begin_setup(remotes, mask) {
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
        let due = self.due(remotes, now);
        if !due.is_empty() {
            return Some(self.begin_restart(remotes, now, due));
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
