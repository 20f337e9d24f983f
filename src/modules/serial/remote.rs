//! A remote of a port: its identity, its life, and its place in the cycle.

use core::time::Duration;

use super::failures::Failures;
use super::life::{ChangeContext, Life, LifeChange, silent_until};
use super::slot::RemoteSlot;
use super::watchdog::OutputsState;
use super::{RemoteStatus, RemoteWatchdog};
use crate::bus::Instant;
use crate::events::OfflineReason;
use crate::fraction::Fraction;
use crate::settings::FaultPolicy;
use crate::sslbp::{
    Channel, ChannelLink, RemoteFaults, RemoteIdentity, RemoteLabel, RemoteName, StartedRemote,
};

/// A remote of a port.
#[derive(Debug)]
pub(super) struct Remote {
    /// The identity that START reported. For a remote that has never run, the known part of its
    /// kind: 0 for an unknown unit number or unknown tables, and the class of the unit number in
    /// the top byte.
    pub started: StartedRemote,
    pub watchdog: RemoteWatchdog,
    pub life: Life,
    pub failures: Failures,
    pub slot: RemoteSlot,
}

impl Remote {
    /// A remote that runs.
    pub fn new(
        started: StartedRemote,
        watchdog: RemoteWatchdog,
        slot: RemoteSlot,
        policy: &FaultPolicy,
    ) -> Self {
        Self {
            started,
            watchdog,
            life: Life::running(policy),
            failures: Failures::default(),
            slot,
        }
    }

    pub const fn label(&self) -> RemoteLabel {
        self.slot.pins.label
    }

    pub const fn channel(&self) -> Channel {
        self.started.channel
    }

    /// Marks a remote that does not run at the start: offline, and never started.
    pub fn not_started(&mut self, at: ChangeContext<'_>, reason: OfflineReason) -> LifeChange {
        let change = self.go_offline(at, reason, 0);
        if let OfflineReason::FieldPower(faults) | OfflineReason::Reported(faults) = reason {
            self.life.reported(faults, true);
        }
        self.life.mark_not_started();
        change
    }

    /// Takes the remote offline because of a fault that it reported with a transfer.
    pub fn take_faults(
        &mut self,
        at: ChangeContext<'_>,
        faults: RemoteFaults,
        good: u64,
    ) -> LifeChange {
        let was_running = self.life.is_running();
        let reason = OfflineReason::of_faults(faults);
        let change = self.go_offline(at, reason, good);
        self.life.reported(faults, was_running);
        change
    }

    /// Takes the remote offline, or adds a reason to one that is offline, and plans the next
    /// attempt. `good`: transfers since it was started.
    pub fn go_offline(
        &mut self,
        at: ChangeContext<'_>,
        reason: OfflineReason,
        good: u64,
    ) -> LifeChange {
        let bitten = silent_until(at.now, reason, self.watchdog);
        self.go_silent(at, reason, bitten);
        self.life.go_offline(at, reason, good, self.watchdog)
    }

    /// Requests a restart: at once for a remote that runs without a fault, for any other one as
    /// soon as its outputs must be off.
    pub fn ask_for_restart(&mut self, at: ChangeContext<'_>) -> LifeChange {
        if self.life.is_running() {
            self.failures.end_row(at, self.label());
        }
        self.life.ask_for_restart(at)
    }

    /// Stops the remote because the application has switched its port off.
    pub fn stop(&mut self, at: ChangeContext<'_>) -> LifeChange {
        let bitten = at.now.after(self.watchdog.silence());
        self.go_silent(at, OfflineReason::Stopped, bitten);
        self.life.stop(at.now)
    }

    /// Handles that nothing more is sent to the remote.
    fn go_silent(&mut self, at: ChangeContext<'_>, reason: OfflineReason, bitten: Instant) {
        let outputs = &mut self.slot.outputs_state;
        outputs.silent(reason, self.watchdog, bitten);
        if self.life.is_running() {
            self.failures.end_row(at, self.label());
        }
    }

    /// Returns the reason to refuse the remote that answered START, from interface registers 0 to
    /// 2: its unit number, name and tables. For a remote that has never run, the known part of its
    /// kind is compared, with the unit number if it is known, and its sizes are compared later.
    pub fn refuses(&self, [unit_number, name, found]: [u32; 3]) -> Option<OfflineReason> {
        let StartedRemote {
            gtoc,
            ptoc,
            unit_number: unit,
            ..
        } = self.started;
        let expected = u32::from(gtoc) << 16 | u32::from(ptoc);
        let name = RemoteName::from_register(name);
        let is_of_kind = unit == 0 || unit == unit_number & 0xFF00_0000;
        let has_run = self.life.has_run();
        let is_kind = !has_run && is_of_kind;
        if name != self.started.name || unit != unit_number && !is_kind {
            return Some(OfflineReason::AnotherDevice {
                found: RemoteIdentity { name, unit_number },
                expected: self.started.identity(),
            });
        }
        let are_known = has_run || expected != 0;
        (are_known && found != expected).then_some(OfflineReason::OtherTables { found, expected })
    }

    /// Marks the remote as running and stores the identity that START reported; any other unit is
    /// refused from now on.
    pub fn restarted(&mut self, start_registers: [u32; 3]) -> LifeChange {
        let is = self.started;
        self.started = StartedRemote::new(
            is.channel,
            is.software_mode,
            start_registers,
            is.sizes,
            is.cs,
        );
        self.slot.outputs_state = OutputsState::Off;
        self.failures.restarted();
        self.life.restarted()
    }

    /// Judges the watchdog of a remote that got no frame for `silence`, and was queried then: one
    /// that was heard and did not report its bite counts as off. False if nothing is known of it.
    pub fn judge_watchdog(&mut self, silence: Duration, is_heard: bool) -> bool {
        // Another fault may be the reason for going offline; the bite is reported beside it.
        let is_reported = self.life.faults().contains(RemoteFaults::WATCHDOG);
        let is_cause = self.life.cause() == Some(OfflineReason::Watchdog);
        if is_cause || is_reported {
            let own = self.watchdog.silence();
            if silence > own.fraction(5, 4) || self.watchdog == RemoteWatchdog::Assumed {
                self.watchdog = RemoteWatchdog::Known(silence);
            }
        } else if is_heard {
            self.watchdog = RemoteWatchdog::Off;
        } else {
            return false;
        }
        true
    }

    /// The current state, for the application.
    pub fn status<'a>(&'a self, link: &'a ChannelLink) -> RemoteStatus<'a> {
        RemoteStatus {
            label: self.label(),
            started: &self.started,
            descriptor: &self.slot.descriptor,
            pins: &self.slot.pins,
            state: self.life.state(),
            first_fault: self.life.first_fault(),
            watchdog: self.watchdog,
            faults: self.life.faults(),
            transfers: link.transfers,
            failures: &link.failures,
            restarts: self.life.restarts(),
        }
    }
}
