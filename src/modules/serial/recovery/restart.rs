//! How remotes come back: STOP, START, and what START found.

use core::time::Duration;

use super::{Outcome, Recovery, Restart};
use crate::bus::Instant;
use crate::modules::serial::attempts::Cost;
use crate::modules::serial::{OfflineReason, RemoteState, RemoteWatchdog};
use crate::sslbp::{
    Channel, ChannelMask, Complete, CsStatus, Machine, Observed, Operation, ProcessDataSizes,
};

/// Other remotes' watchdogs allow 50 ms without process data (FACTS 1.5); a restart takes up to
/// 18 ms, and this much lies between two.
const BETWEEN_RESTARTS: Duration = Duration::from_millis(60);

impl Recovery {
    /// Tries a remote again at once, whatever its pause; not before its outputs must be off.
    pub fn restart_now(&mut self, channel: Channel, now: Instant) {
        let policy = self.policy;
        if let Some(remote) = self.remote_mut(channel) {
            remote.ask_for_restart(now, &policy);
        }
        self.update();
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

    fn go_offline(
        &mut self,
        machine: &Machine,
        now: Instant,
        channel: Channel,
        reason: OfflineReason,
    ) {
        let policy = self.policy;
        let good = machine.link(channel).good_since_start();
        if let Some(remote) = self.remote_mut(channel) {
            remote.go_offline(now, reason, good, &policy);
        }
    }

    /// COMMAND had to be freed: what was sent to whom is not known.
    pub(super) fn all_offline(&mut self, machine: &Machine, now: Instant) -> Outcome {
        self.end_restart(now);
        let known = self.known;
        for channel in known.iter() {
            self.go_offline(machine, now, channel, OfflineReason::PortStuck);
        }
        Outcome {
            offline: known,
            ..Outcome::default()
        }
    }

    /// Channels whose time to be tried again has come.
    pub(super) fn due(&self, now: Instant) -> ChannelMask {
        if self.running == self.known || now < self.no_restart_before {
            return ChannelMask::NONE;
        }
        let due = self.mask(|remote| match remote.state {
            RemoteState::Offline { next_attempt, .. } => {
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
                RemoteState::Offline {
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
        self.running.is_empty() || !due.intersection(asked).is_empty()
    }

    pub(super) fn begin_restart(&mut self, now: Instant, due: ChannelMask) -> Operation {
        if !self.is_free(due) {
            self.cost.begin(now);
        }
        for channel in due.iter() {
            if let Some(remote) = self.remote_mut(channel) {
                remote.restarting();
            }
        }
        self.update();
        Operation::Stop(due)
    }

    pub(super) fn end_restart(&mut self, now: Instant) {
        self.restart = Restart::None;
        self.cost.end(now, &self.policy);
    }

    /// STOP is complete.
    pub(super) fn stopped(
        &mut self,
        machine: &Machine,
        now: Instant,
        complete: &Complete,
        seen: &impl Observed,
    ) {
        for channel in complete.bad.iter() {
            let cs = CsStatus::from_register(seen.cs(channel));
            self.go_offline(machine, now, channel, OfflineReason::DidNotStart(cs));
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
    pub(super) fn started(
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
                self.go_offline(machine, now, channel, OfflineReason::DidNotStart(cs));
            }
        }
        let mut unknown = ChannelMask::NONE;
        for channel in complete.good.iter() {
            let told = machine.link(channel).told();
            let Some(remote) = self.remote_mut(channel) else {
                continue;
            };
            if let Some(reason) = remote.expected.refuses(told) {
                self.go_offline(machine, now, channel, reason);
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
    pub(super) fn measured(&mut self, machine: &Machine, now: Instant, size: u8) {
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
            self.go_offline(
                machine,
                now,
                channel,
                OfflineReason::OtherSizes { found, expected },
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
    pub(super) fn stop_for_good(&mut self, running: ChannelMask) -> Option<Operation> {
        for remote in self.remotes.iter_mut().flatten() {
            remote.stop_for_good();
        }
        self.update();
        (!running.is_empty()).then_some(Operation::Stop(running))
    }
}
