//! Life of a remote: whether it runs, why it does not, and when it is tried again. Pure: what a
//! change reports is returned.

use core::time::Duration;

use super::RemoteWatchdog;
use crate::bus::Instant;
use crate::events::{EventKind, EventSink, OfflineReason};
use crate::packed::packed_enum;
use crate::settings::FaultPolicy;
use crate::sslbp::{RemoteFaults, RemoteLabel};
use crate::tally::Tally;

/// Good transfers after which a remote counts as healthy again.
const HEALTHY_TRANSFERS: u64 = 1000;

packed_enum! {
/// State of the remote on a channel.
///
/// A remote that is offline gets no frame: neither process data nor a START, until the time of its
/// [watchdog](super::RemoteWatchdog) and a fifth more is over since its last frame. By then all its
/// outputs are off, whatever the last frame set and whatever fault it has. After a successful START
/// it gets safe values until it is re-armed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "state", rename_all = "kebab-case"))]
pub enum RemoteState {
    /// The remote transfers process data.
    Running,
    /// The remote is offline; the driver tries to restart it at the given time.
    Offline {
        /// The present reason: that for which the remote stopped running last, until an attempt to
        /// restart it finds another one. A fault from before it ran last stays in
        /// [`RemoteStatus::first_fault`](super::RemoteStatus::first_fault).
        reason: OfflineReason,
        /// Earliest time of the next attempt; `None`: when the application asks for it.
        next_attempt: Option<Instant>,
    },
    /// The remote is being restarted.
    Restarting {
        /// The present reason, as when it is offline.
        reason: OfflineReason,
    },
}
}

/// What a change of a remote needs besides the remote.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChangeContext<'a> {
    pub now: Instant,
    pub policy: &'a FaultPolicy,
    /// The sink of the remote's events.
    pub events: &'a EventSink,
}

/// What a change of a remote's life reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LifeEvent {
    /// It went offline.
    Offline(OfflineReason),
    /// It stays offline, for another reason.
    StaysOffline(OfflineReason),
    /// It runs for the first time, after it was absent at the start.
    Up,
    /// It runs again.
    Back,
    /// Its outputs follow the application again.
    Rearmed,
}

/// Outcome of a change of a remote's life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[must_use]
pub(super) struct LifeChange {
    pub event: Option<LifeEvent>,
    /// An attempt has found another device, a fault that was not reported before, or the first
    /// fault of a remote that was stopped or restarted on request.
    pub has_new_fault: bool,
}

/// Life of a remote.
#[derive(Clone, Copy, Debug)]
pub(super) struct Life {
    stage: LifeStage,
    /// Time to wait before the next attempt to restart it; doubles with each attempt.
    pause: Duration,
    /// The remote has run before, so that its sizes are known to be right, and it can have been
    /// stopped.
    has_run: bool,
    restarts: u64,
}

/// Each stage holds only what is valid in it.
#[derive(Clone, Copy, Debug)]
enum LifeStage {
    Running {
        /// The first reason for going offline since the remote was re-armed.
        first_fault: Option<OfflineReason>,
    },
    Offline {
        absence: Absence,
        next_attempt: Option<Instant>,
    },
    Restarting(Absence),
}

/// What is known of a remote that does not run.
#[derive(Clone, Copy, Debug)]
struct Absence {
    /// The present reason.
    reason: OfflineReason,
    /// The reason found last.
    cause: OfflineReason,
    /// The first reason since the remote was re-armed.
    first_fault: OfflineReason,
    /// The faults that it reported last.
    faults: RemoteFaults,
    /// All faults that it has reported since it ran.
    known_faults: RemoteFaults,
    /// Nothing is sent to the remote before this time, by which its watchdog must have bitten.
    silent_until: Instant,
    /// The application asked for the next attempt, which is therefore made whatever it costs.
    is_asked_for: bool,
    /// The last attempt failed, so that the next one is likely to take long.
    has_failed: bool,
}

impl Life {
    /// A remote that runs.
    pub fn running(policy: &FaultPolicy) -> Self {
        Self {
            stage: LifeStage::Running { first_fault: None },
            pause: policy.first_backoff,
            has_run: true,
            restarts: 0,
        }
    }

    pub fn state(&self) -> RemoteState {
        match self.stage {
            LifeStage::Running { .. } => RemoteState::Running,
            LifeStage::Offline {
                absence: Absence { reason, .. },
                next_attempt,
            } => RemoteState::Offline {
                reason,
                next_attempt,
            },
            LifeStage::Restarting(Absence { reason, .. }) => RemoteState::Restarting { reason },
        }
    }

    pub const fn is_running(&self) -> bool {
        matches!(self.stage, LifeStage::Running { .. })
    }

    pub const fn is_restarting(&self) -> bool {
        matches!(self.stage, LifeStage::Restarting(_))
    }

    pub const fn has_run(&self) -> bool {
        self.has_run
    }

    pub const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// The first reason for going offline since the remote was re-armed.
    pub fn first_fault(&self) -> Option<OfflineReason> {
        match self.stage {
            LifeStage::Running { first_fault } => first_fault,
            LifeStage::Offline { absence, .. } | LifeStage::Restarting(absence) => {
                Some(absence.first_fault)
            }
        }
    }

    /// The reason found last why the remote does not run.
    pub fn cause(&self) -> Option<OfflineReason> {
        self.absence().map(|absence| absence.cause)
    }

    /// The faults that it reported last; none while it runs.
    pub fn faults(&self) -> RemoteFaults {
        let absence = self.absence();
        absence.map_or(RemoteFaults::empty(), |absence| absence.faults)
    }

    /// True if the application asked for the next attempt.
    pub fn is_asked_for(&self) -> bool {
        self.absence().is_some_and(|absence| absence.is_asked_for)
    }

    /// True if the last attempt failed.
    pub fn has_failed(&self) -> bool {
        self.absence().is_some_and(|absence| absence.has_failed)
    }

    /// True if an attempt is due; one that is left over from a command that was lost is.
    pub fn is_due(&self, now: Instant) -> bool {
        match self.stage {
            LifeStage::Running { .. } => false,
            LifeStage::Offline { next_attempt, .. } => next_attempt.is_some_and(|time| time <= now),
            LifeStage::Restarting(_) => true,
        }
    }

    /// True if an attempt is planned, and may be made now together with others.
    pub fn may_be_tried(&self, now: Instant) -> bool {
        match self.stage {
            LifeStage::Offline {
                absence,
                next_attempt,
            } => next_attempt.is_some() && absence.silent_until <= now,
            LifeStage::Running { .. } | LifeStage::Restarting(_) => false,
        }
    }

    /// True if the remote runs, or is offline only because the board has lost its set-up: without
    /// transfers, and with a watchdog that has bitten for that reason.
    pub fn is_of_board(&self) -> bool {
        use OfflineReason::{BoardDown, NotRunning, Requested, Watchdog};
        self.cause()
            .is_none_or(|cause| matches!(cause, BoardDown | NotRunning(_) | Requested | Watchdog))
    }

    /// True if the channel was found stopped, without a STOP command.
    pub fn was_found_stopped(&self) -> bool {
        matches!(
            self.stage,
            LifeStage::Offline { absence: Absence { cause: OfflineReason::NotRunning(cs), .. }, .. }
                if cs.is_stopped()
        )
    }

    fn absence(&self) -> Option<&Absence> {
        match &self.stage {
            LifeStage::Running { .. } => None,
            LifeStage::Offline { absence, .. } | LifeStage::Restarting(absence) => Some(absence),
        }
    }

    fn absence_mut(&mut self) -> Option<&mut Absence> {
        match &mut self.stage {
            LifeStage::Running { .. } => None,
            LifeStage::Offline { absence, .. } | LifeStage::Restarting(absence) => Some(absence),
        }
    }
}

/// Changes.
impl Life {
    /// Takes the remote offline, or adds a reason to one that is offline, and plans the next
    /// attempt. `good`: transfers since it was started.
    pub fn go_offline(
        &mut self,
        ChangeContext { now, policy, .. }: ChangeContext<'_>,
        reason: OfflineReason,
        good: u64,
        watchdog: RemoteWatchdog,
    ) -> LifeChange {
        let silent_until = silent_until(now, reason, watchdog);
        let was_running = self.is_running();
        if was_running && good >= HEALTHY_TRANSFERS {
            self.pause = policy.first_backoff;
        }
        // Its outputs may be on, and only a START switches them off.
        let may_drive =
            watchdog == RemoteWatchdog::Off && was_running && self.first_fault().is_none();
        let is_asked_for = self.is_asked_for() || may_drive && policy.automatic;
        // The first attempt after a fault that a START clears waits only for the silence.
        let is_first = self.pause == policy.first_backoff;
        let wait = if is_asked_for || is_first && reason.is_cleared_by_start() {
            Duration::ZERO
        } else {
            self.pause
        };
        self.pause = self.pause.saturating_mul(2).min(policy.longest_backoff);
        let next_attempt =
            (policy.automatic || is_asked_for).then(|| now.after(wait).max(silent_until));
        let change = self.set_offline(now, reason, next_attempt);
        if let Some(absence) = self.absence_mut() {
            (absence.silent_until, absence.is_asked_for) = (silent_until, is_asked_for);
        }
        change
    }

    /// Requests a restart: at once for a remote that runs without a fault, for any other one as
    /// soon as its outputs must be off.
    pub fn ask_for_restart(
        &mut self,
        ChangeContext { now, policy, .. }: ChangeContext<'_>,
    ) -> LifeChange {
        self.pause = policy.first_backoff;
        let mut change = LifeChange::default();
        if !self.is_restarting() {
            let silent_until = self.absence().map_or(now, |absence| absence.silent_until);
            change = self.set_offline(now, OfflineReason::Requested, Some(now.max(silent_until)));
        }
        self.request_attempt();
        change
    }

    /// Stops the remote because the application has switched its port off; it is tried again when
    /// the port is on.
    pub fn stop(&mut self, now: Instant) -> LifeChange {
        let silent_until = self.absence().map_or(now, |absence| absence.silent_until);
        let change = self.set_offline(now, OfflineReason::Stopped, Some(silent_until));
        self.request_attempt();
        change
    }

    /// Marks the next attempt as asked for.
    fn request_attempt(&mut self) {
        if let Some(absence) = self.absence_mut() {
            absence.is_asked_for = true;
        }
    }

    fn set_offline(
        &mut self,
        now: Instant,
        reason: OfflineReason,
        next_attempt: Option<Instant>,
    ) -> LifeChange {
        let mut change = LifeChange::default();
        let absence = match self.stage {
            LifeStage::Running { first_fault } => {
                change.event = Some(LifeEvent::Offline(reason));
                Absence {
                    reason,
                    cause: reason,
                    first_fault: first_fault.unwrap_or(reason),
                    faults: RemoteFaults::empty(),
                    known_faults: RemoteFaults::empty(),
                    silent_until: now,
                    is_asked_for: false,
                    has_failed: false,
                }
            }
            LifeStage::Offline { absence, .. } | LifeStage::Restarting(absence) => {
                let before = absence.cause;
                let is_another = before != reason;
                let is_still_absent = before == OfflineReason::Absent
                    && matches!(reason, OfflineReason::DidNotStart(_));
                if is_another && !reason.is_asked_for() && !is_still_absent {
                    change.event = Some(LifeEvent::StaysOffline(reason));
                }
                let is_first_fault = !reason.is_asked_for()
                    && absence.first_fault.is_asked_for()
                    && before.is_asked_for();
                change.has_new_fault = is_another && reason.is_about_identity() || is_first_fault;
                Absence {
                    reason: reason.after(absence.reason),
                    cause: reason,
                    ..absence
                }
            }
        };
        self.stage = LifeStage::Offline {
            absence,
            next_attempt,
        };
        change
    }

    /// Takes the faults that a remote reports with a transfer, for which it has just gone offline.
    pub fn reported(&mut self, faults: RemoteFaults, is_first: bool) {
        if let Some(absence) = self.absence_mut() {
            absence.faults = faults;
            if is_first {
                absence.known_faults = faults;
            }
        }
    }

    /// Takes the faults that a remote reports at a START that failed. A watchdog that bites
    /// meanwhile is none of them. True if one of them is new.
    pub fn reported_at_start(&mut self, faults: RemoteFaults) -> bool {
        let Some(absence) = self.absence_mut() else {
            return false;
        };
        let known = absence.known_faults.union(RemoteFaults::WATCHDOG);
        absence.known_faults = known.union(faults);
        absence.faults = faults;
        !known.contains(faults)
    }

    /// Marks a remote that was never started.
    pub fn mark_not_started(&mut self) {
        self.has_run = false;
        self.attempt_failed();
    }

    /// Records that an attempt to start the remote failed.
    pub fn attempt_failed(&mut self) {
        if let Some(absence) = self.absence_mut() {
            absence.has_failed = true;
        }
    }

    /// Begins a restart.
    pub fn begin_restart(&mut self) {
        if let LifeStage::Offline { mut absence, .. } = self.stage {
            absence.is_asked_for = false;
            self.stage = LifeStage::Restarting(absence);
        }
    }

    /// Handles a successful START: the remote runs.
    pub fn restarted(&mut self) -> LifeChange {
        let first_fault = self.first_fault();
        let has_run = core::mem::replace(&mut self.has_run, true);
        let was_absent = !has_run && first_fault == Some(OfflineReason::Absent);
        self.stage = LifeStage::Running { first_fault };
        self.restarts.tally(1);
        LifeEvent::into_change(if was_absent {
            LifeEvent::Up
        } else {
            LifeEvent::Back
        })
    }

    /// Clears the first fault of a remote that runs, because the outputs follow the application
    /// (again).
    pub fn armed(&mut self) -> LifeChange {
        let LifeStage::Running { first_fault } = &mut self.stage else {
            return LifeChange::default();
        };
        let before = first_fault.take();
        before.map_or_else(LifeChange::default, |_| LifeEvent::Rearmed.into_change())
    }
}

impl LifeEvent {
    /// The event of this remote.
    pub const fn of(self, remote: RemoteLabel) -> EventKind {
        match self {
            Self::Offline(reason) => EventKind::RemoteOffline { remote, reason },
            Self::StaysOffline(reason) => EventKind::RemoteStaysOffline { remote, reason },
            Self::Up => EventKind::RemoteUp { remote },
            Self::Back => EventKind::RemoteBack { remote },
            Self::Rearmed => EventKind::RemoteRearmed { remote },
        }
    }

    fn into_change(self) -> LifeChange {
        LifeChange {
            event: Some(self),
            has_new_fault: false,
        }
    }
}

/// The time up to which nothing is sent to a remote that goes offline.
///
/// A remote with a bitten watchdog has switched its outputs off, and an absent one got no frame. A
/// failed START may have fed the watchdog again.
pub(super) fn silent_until(
    now: Instant,
    reason: OfflineReason,
    watchdog: RemoteWatchdog,
) -> Instant {
    match reason {
        OfflineReason::Watchdog | OfflineReason::Absent => now,
        _ => now.after(watchdog.silence()),
    }
}
