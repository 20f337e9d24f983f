//! Restart of remotes: STOP, START, and evaluation of the identity that START reports.

use core::time::Duration;

use super::{LifeChange, Remotes, Restart, Schedule};
use crate::bus::Instant;
use crate::events::OfflineReason;
use crate::sslbp::{
    ChannelMask, ComState, CompletedOperation, CsStatus, PortImage, PortMachine, PortOperation,
    ProcessDataSizes,
};

/// Least time between two restarts. Other remotes' watchdogs allow 50 ms without process data
/// (FACTS 1.5), and a restart takes up to 18 ms.
const BETWEEN_RESTARTS: Duration = Duration::from_millis(60);

impl Schedule {
    /// Discards a restart in progress: the port was used outside the cycle, and all remotes are
    /// stopped.
    pub fn taken_over(&mut self, now: Instant) {
        self.end_restart(now);
        self.cost.forget();
    }

    /// Takes all remotes offline: COMMAND had to be freed, and which remotes got which data is
    /// unknown.
    pub(super) fn all_offline(
        &mut self,
        machine: &PortMachine,
        remotes: &mut Remotes,
        now: Instant,
    ) -> ChannelMask {
        self.end_restart(now);
        let (all, reason) = (remotes.configured(), OfflineReason::PortStuck);
        remotes.change(all, now, |remote, at| {
            let good = machine.link(remote.channel()).good;
            remote.go_offline(at, reason, good)
        })
    }

    /// Channels whose next attempt is due.
    pub(super) fn due(&self, remotes: &Remotes, now: Instant) -> ChannelMask {
        if remotes.running() == remotes.configured() || now < self.no_restart_before {
            return ChannelMask::NONE;
        }
        let due = remotes.mask(|remote| remote.life.is_due(now));
        if due.is_empty() || !is_free(remotes, due) && !self.cost.allows(now) {
            return ChannelMask::NONE;
        }
        // A single START takes as long for several remotes that do not answer as for one: all those
        // that did not answer before are tried with the first of them.
        let failed = remotes.mask(|remote| remote.life.has_failed());
        if due.intersection(failed).is_empty() {
            return due;
        }
        let silent = remotes.mask(|remote| remote.life.may_be_tried(now));
        due.union(failed.intersection(silent))
    }

    pub(super) fn begin_restart(
        &mut self,
        remotes: &mut Remotes,
        now: Instant,
        due: ChannelMask,
    ) -> PortOperation {
        if !is_free(remotes, due) {
            self.cost.begin(now);
        }
        remotes.change(due, now, |remote, _| {
            remote.life.begin_restart();
            LifeChange::default()
        });
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
        self.cost.end(now);
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
        remotes: &mut Remotes,
        now: Instant,
        complete: &CompletedOperation,
        seen: &impl PortImage,
    ) -> ChannelMask {
        let new_faults = remotes.change(complete.bad, now, |remote, at| {
            let channel = remote.channel();
            let reason = OfflineReason::DidNotStart(CsStatus(seen.cs(channel)));
            let good = machine.link(channel).good;
            remote.go_offline(at, reason, good)
        });
        let wanted = remotes.mask(|remote| remote.life.is_restarting());
        let mask = complete.good.intersection(wanted);
        self.go_on(now, mask, Restart::Stopped(mask));
        new_faults
    }

    /// Evaluates a complete START.
    pub(super) fn started(
        &mut self,
        machine: &PortMachine,
        remotes: &mut Remotes,
        now: Instant,
        complete: &CompletedOperation,
    ) -> ChannelMask {
        if self.restart == Restart::Starting {
            self.no_restart_before = now.after(BETWEEN_RESTARTS);
        }
        let mut mask = ChannelMask::NONE;
        let answered = complete.good.union(complete.bad);
        let new_faults = remotes.change(answered, now, |remote, at| {
            let channel = remote.channel();
            let link = machine.link(channel);
            let mut has_new_fault = false;
            let problem = if complete.bad.contains(channel) {
                remote.life.attempt_failed();
                // CS contains the remote's faults, as read by the last step of START (FACTS 4.1).
                if link.cs.state() == ComState::CheckFaults {
                    has_new_fault = remote.life.reported_at_start(link.cs.remote_faults());
                }
                Some(OfflineReason::of_failed_start(link.cs))
            } else {
                remote.refuses(link.start_registers)
            };
            if let Some(reason) = problem {
                let mut change = remote.go_offline(at, reason, link.good);
                change.has_new_fault |= has_new_fault;
                return change;
            }
            if remote.life.has_run() {
                return remote.restarted(link.start_registers);
            }
            mask = mask.union(channel.mask());
            LifeChange::default()
        });
        self.go_on(now, mask, Restart::Measuring { mask, rx: None });
        new_faults
    }

    /// Takes a size of a remote that has not run before.
    pub(super) fn measured(
        &mut self,
        machine: &PortMachine,
        remotes: &mut Remotes,
        now: Instant,
        size: u8,
    ) -> ChannelMask {
        let none = ChannelMask::NONE;
        let Restart::Measuring { mask, rx } = self.restart else {
            return none;
        };
        let Some(rx) = rx else {
            let rx = Some(size);
            self.restart = Restart::Measuring { mask, rx };
            return none;
        };
        let Some(channel) = mask.iter().next() else {
            self.end_restart(now);
            return none;
        };
        let link = machine.link(channel);
        let new_faults = remotes.change(channel.mask(), now, |remote, at| {
            let found = ProcessDataSizes { rx, tx: size };
            let expected = remote.started.sizes;
            if found == expected {
                return remote.restarted(link.start_registers);
            }
            let reason = OfflineReason::OtherSizes { found, expected };
            remote.go_offline(at, reason, link.good)
        });
        let mask = mask.difference(channel.mask());
        self.go_on(now, mask, Restart::Measuring { mask, rx: None });
        new_faults
    }
}

/// True if no other remote runs, or the application has requested the attempt: its cost does not
/// count.
fn is_free(remotes: &Remotes, due: ChannelMask) -> bool {
    let asked = remotes.mask(|remote| remote.life.is_asked_for());
    remotes.running().is_empty() || !due.intersection(asked).is_empty()
}
