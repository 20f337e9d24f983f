//! One remote in the cycle: whether it takes part, why not, and when it is tried again.

use core::time::Duration;

use super::attempts::Attempts;
use super::{FaultPolicy, OfflineReason, RemoteWatchdog};
use crate::bus::Instant;
use crate::sslbp::{ComState, CsStatus, RemoteFaults};

/// Good transfers after which a remote counts as healthy again.
const HEALTHY: u64 = 1000;

/// What START must tell of a remote: interface registers 0 to 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Expected {
    /// Unit number, name, GTOC and PTOC.
    pub told: [u32; 3],
    /// The bits of its unit number that count: its class is known of one that was never there.
    pub unit_mask: u32,
    /// The bits of its tables that count: none if they are not known, and its sizes decide.
    pub tables_mask: u32,
}

impl Expected {
    /// This one, and no other of its kind.
    pub const fn exactly(told: [u32; 3]) -> Self {
        Self {
            told,
            unit_mask: u32::MAX,
            tables_mask: u32::MAX,
        }
    }

    /// One that was never there. `unit_number` holds its class in the top byte, or is 0; `tables`
    /// hold GTOC and PTOC, or are 0.
    pub const fn of_kind(unit_number: u32, name: u32, tables: u32) -> Self {
        Self {
            told: [unit_number, name, tables],
            unit_mask: if unit_number == 0 { 0 } else { 0xFF00_0000 },
            tables_mask: if tables == 0 { 0 } else { u32::MAX },
        }
    }

    /// Why the remote that tells this is not the one.
    pub fn refuses(&self, told: [u32; 3]) -> Option<OfflineReason> {
        let ([unit, name, tables], [unit_number, told_name, found]) = (self.told, told);
        if (unit ^ unit_number) & self.unit_mask != 0 || name != told_name {
            let name = told_name;
            return Some(OfflineReason::AnotherDevice { name, unit_number });
        }
        let is_other = (tables ^ found) & self.tables_mask != 0;
        is_other.then_some(OfflineReason::OtherTables {
            found,
            expected: tables,
        })
    }
}

/// What a remote on a channel is doing.
///
/// A remote that is offline gets no frame: neither process data nor a START, until the time of
/// its [watchdog](super::RemoteWatchdog) and a fifth more is over since it was last talked to. By
/// then its outputs are off, all of them, whatever it had been told and whatever fault it has. After
/// a START that succeeds it gets safe values until it is re-armed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RemoteState {
    /// It transfers process data.
    Running,
    /// It is offline; the driver tries to bring it back at the given time.
    Offline {
        /// Why: the first reason since it was re-armed last, until another device is found in its
        /// place.
        reason: OfflineReason,
        /// When it is tried next, at the earliest; `None`: when the application asks for it.
        next_attempt: Option<Instant>,
    },
    /// It is being restarted.
    Restarting {
        /// Why it was offline.
        reason: OfflineReason,
    },
}

/// A remote of a port.
#[derive(Clone, Debug)]
pub(crate) struct Health {
    pub expected: Expected,
    pub watchdog: RemoteWatchdog,
    pub state: RemoteState,
    /// Why it went offline last.
    pub cause: Option<OfflineReason>,
    /// Why it went offline first since it was re-armed.
    pub first_fault: Option<OfflineReason>,
    pub restarts: u64,
    /// LinuxCNC's `fault-count`: rises with failures, falls with good transfers.
    pub fault_count: u32,
    /// What it reported last.
    pub faults: RemoteFaults,
    pub attempts: Attempts,
    /// It has run before, so that its sizes are known to be right, and it can have been stopped.
    pub has_run: bool,
    /// It is left out of transfers until then. After a failed one the line needs an idle interval,
    /// in which a late reply or extra characters show themselves: a transfer at once could have
    /// the reply of the one before (FACTS 5.4).
    pub rest_until: Instant,
    /// The transfer before failed, too.
    has_just_failed: bool,
}

impl Health {
    /// A remote that runs.
    pub fn new(expected: Expected, watchdog: RemoteWatchdog, first_backoff: Duration) -> Self {
        Self {
            expected,
            watchdog,
            state: RemoteState::Running,
            cause: None,
            first_fault: None,
            restarts: 0,
            fault_count: 0,
            faults: RemoteFaults::empty(),
            attempts: Attempts::new(first_backoff),
            has_run: true,
            rest_until: Instant::default(),
            has_just_failed: false,
        }
    }

    /// A remote that was never there. Nobody talked to it, so that it is silent already.
    pub fn absent(expected: Expected, policy: &FaultPolicy, now: Instant) -> Self {
        let mut health = Self::new(expected, RemoteWatchdog::Assumed, policy.first_backoff);
        health.has_run = false;
        health.attempts.has_failed = true;
        let wait = health.attempts.next_pause(OfflineReason::Absent, policy);
        let next_attempt = policy.automatic.then(|| now.after(wait));
        health.show(OfflineReason::Absent, next_attempt);
        health
    }

    /// It goes offline, or stays so for one more reason; the next attempt is planned. `good`:
    /// transfers since it was started.
    pub fn go_offline(
        &mut self,
        now: Instant,
        reason: OfflineReason,
        good: u64,
        policy: &FaultPolicy,
    ) {
        // A remote whose watchdog has bitten has switched its outputs off. A START that fails may
        // have fed it again.
        let silence = match reason {
            OfflineReason::Watchdog => Duration::ZERO,
            _ => self.watchdog.silence(),
        };
        self.attempts.silent_until = now.after(silence);
        if self.is_running() && good >= HEALTHY {
            self.attempts.pause = policy.first_backoff;
        }
        let pause = self.attempts.next_pause(reason, policy);
        let may_drive =
            self.watchdog == RemoteWatchdog::Off && self.is_running() && self.first_fault.is_none();
        // It may have outputs on, which nothing but a START switches off.
        self.attempts.is_asked_for |= may_drive && policy.automatic;
        let is_asked_for = self.attempts.is_asked_for;
        let wait = if is_asked_for { Duration::ZERO } else { pause };
        let next_attempt = (policy.automatic || is_asked_for)
            .then(|| now.after(wait).max(self.attempts.silent_until));
        self.show(reason, next_attempt);
    }

    /// The application asks for a restart at once: of one that runs without a fault now, of
    /// another one when its outputs must be off.
    pub fn ask_for_restart(&mut self, now: Instant, policy: &FaultPolicy) {
        self.attempts.pause = policy.first_backoff;
        self.attempts.is_asked_for = true;
        if self.is_running() {
            self.attempts.silent_until = now;
        }
        if !matches!(self.state, RemoteState::Restarting { .. }) {
            let next_attempt = now.max(self.attempts.silent_until);
            self.show(OfflineReason::Requested, Some(next_attempt));
        }
    }

    /// The application has switched its port off; it is tried when it is on again.
    pub fn stop_for_good(&mut self) {
        self.attempts.is_asked_for = true;
        self.show(OfflineReason::Stopped, Some(self.attempts.silent_until));
    }

    fn show(&mut self, reason: OfflineReason, next_attempt: Option<Instant>) {
        self.cause = Some(reason);
        let first = *self.first_fault.get_or_insert(reason);
        let reason = if reason.is_about_identity() {
            reason
        } else {
            first
        };
        self.state = RemoteState::Offline {
            reason,
            next_attempt,
        };
    }

    /// Its outputs follow the application (again): what was before is history.
    pub fn armed(&mut self) {
        if self.is_running() {
            self.first_fault = None;
        }
    }

    pub fn is_running(&self) -> bool {
        self.state == RemoteState::Running
    }

    /// A failed transfer: what LinuxCNC's `fault-count` does, by `increment` for each cycle without
    /// data. After another failure the idle interval between them is one as well.
    pub fn count_fault(&mut self, increment: u32) {
        let cycles = if core::mem::replace(&mut self.has_just_failed, true) {
            2
        } else {
            1
        };
        let more = increment.saturating_mul(cycles);
        self.fault_count = self.fault_count.saturating_add(more);
    }

    /// A good transfer.
    pub fn count_good(&mut self, decrement: u32) {
        self.has_just_failed = false;
        self.fault_count = self.fault_count.saturating_sub(decrement);
    }

    /// Whether a transfer has failed that good ones have not made up for.
    pub const fn is_troubled(&self) -> bool {
        self.fault_count > 0 || self.has_just_failed
    }

    /// A restart begins.
    pub fn restarting(&mut self) {
        self.attempts.is_asked_for = false;
        if let RemoteState::Offline { reason, .. } = self.state {
            self.state = RemoteState::Restarting { reason };
        }
    }

    /// START did not succeed. What its last step read of the remote's faults is in CS (FACTS 4.1).
    pub fn did_not_start(&mut self, cs: CsStatus) {
        self.attempts.has_failed = true;
        if matches!(cs.state(), ComState::CheckFaults | ComState::FaultsTried) {
            self.faults = cs.remote_faults();
        }
    }

    /// It runs again. From now on it is this one, and no other of its kind.
    pub fn restarted(&mut self, told: [u32; 3]) {
        self.expected = Expected::exactly(told);
        self.state = RemoteState::Running;
        self.attempts.has_failed = false;
        self.attempts.is_asked_for = false;
        self.has_run = true;
        self.restarts += 1;
        self.fault_count = 0;
        self.faults = RemoteFaults::empty();
        self.has_just_failed = false;
    }
}
