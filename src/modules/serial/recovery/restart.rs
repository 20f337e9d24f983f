//! Restart of remotes: STOP, START, and evaluation of the identity that START reports.

use core::time::Duration;

use super::{Recovery, Restart};
use crate::bus::Instant;
use crate::modules::serial::cost::Cost;
use crate::modules::serial::{OfflineReason, RemoteState};
use crate::sslbp::{
    ChannelMask, ComState, CompletedOperation, CsStatus, PortImage, PortMachine, PortOperation,
    ProcessDataSizes,
};

/// Least time between two restarts. Other remotes' watchdogs allow 50 ms without process data
/// (FACTS 1.5), and a restart takes up to 18 ms.
const BETWEEN_RESTARTS: Duration = Duration::from_millis(60);

impl Recovery {
    /// Restarts remotes regardless of their pauses, but not before their outputs must be off.
    pub fn restart_now(&mut self, mask: ChannelMask, now: Instant) {
        let policy = self.policy;
        for remote in self.each(mask) {
            remote.ask_for_restart(now, &policy);
        }
        self.update();
    }

    /// Discards a restart in progress: the port was used outside the cycle, and all remotes are
    /// stopped.
    pub fn taken_over(&mut self, now: Instant) {
        self.end_restart(now);
        self.cost = Cost::default();
    }

    /// Takes all remotes offline: COMMAND had to be freed, and which remotes got which data is
    /// unknown.
    pub(super) fn all_offline(&mut self, machine: &PortMachine, now: Instant) {
        self.end_restart(now);
        for remote in &mut self.remotes {
            let good = machine.link(remote.channel()).good;
            remote.go_offline(now, OfflineReason::PortStuck, good, &self.policy);
        }
    }

    /// Channels whose next attempt is due.
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
        // A single START takes as long for several remotes that do not answer as for one: all those
        // that did not answer before are tried with the first of them.
        let failed = self.mask(|remote| remote.has_failed);
        if due.intersection(failed).is_empty() {
            return due;
        }
        let is_planned = |state| matches!(state, RemoteState::Offline { next_attempt, .. } if next_attempt.is_some());
        let silent = self.mask(|remote| is_planned(remote.state) && remote.silent_until <= now);
        due.union(failed.intersection(silent))
    }

    /// True if no other remote runs, or the application has requested the attempt: its cost does
    /// not count.
    fn is_free(&self, due: ChannelMask) -> bool {
        let asked = self.mask(|remote| remote.is_asked_for);
        self.running.is_empty() || !due.intersection(asked).is_empty()
    }

    pub(super) fn begin_restart(&mut self, now: Instant, due: ChannelMask) -> PortOperation {
        if !self.is_free(due) {
            self.cost.begin(now);
        }
        for remote in self.each(due) {
            remote.restarting();
        }
        self.update();
        PortOperation::Stop(due)
    }

    pub(super) fn end_restart(&mut self, now: Instant) {
        // Parameters that were not written are written with the next restart; a write that is in
        // progress may have been executed, which it finds out.
        self.may_configure |= self.is_configuring();
        if let Some(write) = self.writer.give_up() {
            self.request_again(write);
        }
        self.restart = Restart::None;
        self.cost.end(now, &self.policy);
    }

    /// Continues a restart with `next` for the channels of `mask`, or ends it if there are none.
    fn go_on(&mut self, now: Instant, mask: ChannelMask, next: Restart) {
        if mask.is_empty() {
            self.end_restart(now);
        } else {
            self.restart = next;
        }
    }

    /// Evaluates a complete STOP.
    pub(super) fn stopped(
        &mut self,
        machine: &PortMachine,
        now: Instant,
        complete: &CompletedOperation,
        seen: &impl PortImage,
    ) {
        let policy = self.policy;
        for remote in self.each(complete.bad) {
            let cs = CsStatus(seen.cs(remote.channel()));
            let good = machine.link(remote.channel()).good;
            remote.go_offline(now, OfflineReason::DidNotStart(cs), good, &policy);
        }
        let wanted = self.mask(|remote| matches!(remote.state, RemoteState::Restarting { .. }));
        let mask = complete.good.intersection(wanted);
        self.go_on(now, mask, Restart::Stopped(mask));
    }

    /// Evaluates a complete START.
    pub(super) fn started(
        &mut self,
        machine: &PortMachine,
        now: Instant,
        complete: &CompletedOperation,
    ) {
        if self.restart == Restart::Starting {
            self.no_restart_before = now.after(BETWEEN_RESTARTS);
        }
        let mut mask = ChannelMask::NONE;
        for remote in &mut self.remotes {
            let channel = remote.channel();
            let link = machine.link(channel);
            let problem = if complete.bad.contains(channel) {
                remote.has_failed = true;
                // CS contains the remote's faults, as read by the last step of START (FACTS 4.1).
                if link.cs.state() == ComState::CheckFaults {
                    remote.reports(link.cs.remote_faults());
                }
                Some(OfflineReason::of_failed_start(link.cs))
            } else if complete.good.contains(channel) {
                remote.refuses(link.start_registers)
            } else {
                continue;
            };
            if let Some(reason) = problem {
                remote.go_offline(now, reason, link.good, &self.policy);
            } else if remote.has_run {
                remote.restarted(now, link.start_registers);
            } else {
                mask = mask.union(channel.mask());
            }
        }
        self.go_on(now, mask, Restart::Measuring { mask, rx: None });
    }

    /// Takes a size of a remote that has not run before.
    pub(super) fn measured(&mut self, machine: &PortMachine, now: Instant, size: u8) {
        let Restart::Measuring { mask, rx } = self.restart else {
            return;
        };
        let Some(rx) = rx else {
            let rx = Some(size);
            self.restart = Restart::Measuring { mask, rx };
            return;
        };
        let Some(channel) = mask.iter().next() else {
            return self.end_restart(now);
        };
        let policy = self.policy;
        let link = machine.link(channel);
        for remote in self.each(channel.mask()) {
            let found = ProcessDataSizes { rx, tx: size };
            let expected = remote.started.sizes;
            if found == expected {
                remote.restarted(now, link.start_registers);
            } else {
                let reason = OfflineReason::OtherSizes { found, expected };
                remote.go_offline(now, reason, link.good, &policy);
            }
        }
        let mask = mask.difference(channel.mask());
        self.go_on(now, mask, Restart::Measuring { mask, rx: None });
    }

    /// Stops all remotes, because the application has switched the port off.
    pub(super) fn stop_for_good(
        &mut self,
        running: ChannelMask,
        now: Instant,
    ) -> Option<PortOperation> {
        for remote in &mut self.remotes {
            remote.stop_for_good(now);
        }
        self.update();
        (!running.is_empty()).then_some(PortOperation::Stop(running))
    }
}
