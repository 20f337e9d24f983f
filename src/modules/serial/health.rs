//! State of one remote in the cycle: participation, reason for being offline, and next attempt.

use crate::hostmot2::RemoteId;
use core::time::Duration;

use super::watchdog::OutputsState;
use super::{FaultPolicy, OfflineReason, RemoteWatchdog};
use crate::bus::Instant;
use crate::modules::events::{EventKind, EventRow, EventSink, Repeating};
use crate::packed::packed_enum;
use crate::sslbp::{Channel, Failure, RemoteFaults, RemoteIdentity, RemoteName, StartedRemote};
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

/// What counts for the arming of a remote that has not transferred yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Arming {
    /// The board got its set-up back, and the remote has not transferred since: it comes up because
    /// of that, unless it has a fault of its own.
    pub comes_with_board: bool,
    /// An attempt has found another device, a fault that was not reported before, or the first fault
    /// of a remote that was stopped or restarted on request.
    pub has_new_fault: bool,
}

/// A remote of a port.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Clone, Debug)]
pub(crate) struct Health {
    /// The identity that START reported. For a remote that has never run, the known part of its
    /// kind: 0 for an unknown unit number or unknown tables, and the class of the unit number in
    /// the top byte.
    pub started: StartedRemote,
    pub watchdog: RemoteWatchdog,
    pub outputs: OutputsState,
    pub state: RemoteState,
    /// The last reason for going offline.
    pub cause: Option<OfflineReason>,
    /// The first reason for going offline since the remote was re-armed.
    pub first_fault: Option<OfflineReason>,
    pub restarts: u64,
    /// LinuxCNC's `fault-count`: rises with failures, falls with good transfers.
    pub fault_count: u32,
    /// The faults that it reported last.
    pub faults: RemoteFaults,
    /// All faults that it has reported since it ran.
    known_faults: RemoteFaults,
    /// The remote has run before, so that its sizes are known to be right, and it can have been
    /// stopped.
    pub has_run: bool,
    /// Reasons to arm it when it comes up, and against that.
    pub arming: Arming,
    /// The remote is left out of transfers until this time. After a failed transfer the line needs
    /// an idle interval, in which a late reply or extra characters become visible: an immediate
    /// transfer could receive the reply to the one before (FACTS 5.4).
    pub rest_until: Instant,
    /// The previous transfer failed too.
    has_just_failed: bool,
    /// Current row of failed transfers; its first one has been reported as an event.
    failures: EventRow,
    /// Time to wait before the next restart attempt; doubles with each attempt.
    pause: Duration,
    /// Nothing is sent to the remote before this time, by which its watchdog must have bitten.
    pub silent_until: Instant,
    /// The application asked for the next attempt, which is therefore made whatever it costs.
    pub is_asked_for: bool,
    /// The last attempt failed, so that the next one is likely to take long.
    pub has_failed: bool,
    /// Sink of the remote's events, and the number of its port.
    pub event_sink: Option<(EventSink, u8)>,
}

impl Health {
    /// Returns the state of a running remote.
    pub fn new(started: StartedRemote, watchdog: RemoteWatchdog, policy: &FaultPolicy) -> Self {
        Self {
            started,
            watchdog,
            outputs: OutputsState::Off,
            state: RemoteState::Running,
            cause: None,
            first_fault: None,
            restarts: 0,
            fault_count: 0,
            faults: RemoteFaults::empty(),
            known_faults: RemoteFaults::empty(),
            has_run: true,
            arming: Arming::default(),
            rest_until: Instant::default(),
            has_just_failed: false,
            failures: EventRow::default(),
            pause: policy.first_backoff,
            silent_until: Instant::default(),
            is_asked_for: false,
            has_failed: false,
            event_sink: None,
        }
    }

    /// Marks a remote that does not run at the start: offline, and never started.
    pub fn not_started(
        mut self,
        now: Instant,
        reason: OfflineReason,
        policy: &FaultPolicy,
    ) -> Self {
        (self.has_run, self.has_failed) = (false, true);
        if let OfflineReason::FieldPower(faults) | OfflineReason::Reported(faults) = reason {
            self.faults = faults;
        }
        self.go_offline(now, reason, 0, policy);
        self
    }

    /// Takes the remote offline, or adds a reason to one that is offline, and plans the next
    /// attempt. `good`: transfers since it was started.
    pub fn go_offline(
        &mut self,
        now: Instant,
        reason: OfflineReason,
        good: u64,
        policy: &FaultPolicy,
    ) {
        // A remote with a bitten watchdog has switched its outputs off, and an absent one got no
        // frame. A failed START may have fed the watchdog again.
        let silence = match reason {
            OfflineReason::Watchdog | OfflineReason::Absent => Duration::ZERO,
            _ => self.watchdog.silence(),
        };
        self.silent_until = now.after(silence);
        self.outputs
            .silent(reason, self.watchdog, self.silent_until);
        if self.is_running() && good >= HEALTHY_TRANSFERS {
            self.pause = policy.first_backoff;
        }
        let may_drive =
            self.watchdog == RemoteWatchdog::Off && self.is_running() && self.first_fault.is_none();
        // Its outputs may be on, and only a START switches them off.
        self.is_asked_for |= may_drive && policy.automatic;
        // The first attempt after a fault that a START clears waits only for the silence.
        let is_first = self.pause == policy.first_backoff;
        let wait = if self.is_asked_for || is_first && reason.is_cleared_by_start() {
            Duration::ZERO
        } else {
            self.pause
        };
        self.pause = self.pause.saturating_mul(2).min(policy.longest_backoff);
        let next_attempt =
            (policy.automatic || self.is_asked_for).then(|| now.after(wait).max(self.silent_until));
        self.show(now, reason, next_attempt);
    }

    /// Requests a restart: at once for a remote that runs without a fault, for any other one as
    /// soon as its outputs must be off.
    pub fn ask_for_restart(&mut self, now: Instant, policy: &FaultPolicy) {
        self.pause = policy.first_backoff;
        self.is_asked_for = true;
        if self.is_running() {
            self.silent_until = now;
        }
        if !matches!(self.state, RemoteState::Restarting { .. }) {
            let next_attempt = now.max(self.silent_until);
            self.show(now, OfflineReason::Requested, Some(next_attempt));
        }
    }

    /// Stops the remote because the application has switched its port off; it is tried again when
    /// the port is on.
    pub fn stop_for_good(&mut self, now: Instant) {
        self.is_asked_for = true;
        let bitten = now.after(self.watchdog.silence());
        self.outputs
            .silent(OfflineReason::Stopped, self.watchdog, bitten);
        self.show(now, OfflineReason::Stopped, Some(self.silent_until));
    }

    fn show(&mut self, now: Instant, reason: OfflineReason, next_attempt: Option<Instant>) {
        let (was_running, before) = (self.is_running(), self.cause.replace(reason));
        let is_still_absent = before == Some(OfflineReason::Absent)
            && matches!(reason, OfflineReason::DidNotStart(_));
        let remote = self.remote_id();
        if was_running {
            self.known_faults = self.faults;
            self.end_row(now);
            let kind = EventKind::RemoteOffline { remote, reason };
            self.tell(now, kind);
        } else if before != Some(reason) && !reason.is_asked_for() && !is_still_absent {
            let kind = EventKind::RemoteStaysOffline { remote, reason };
            self.tell(now, kind);
        }
        let is_first_fault = !reason.is_asked_for()
            && self.first_fault.is_some_and(|first| first.is_asked_for())
            && before.is_some_and(|before| before.is_asked_for());
        self.first_fault.get_or_insert(reason);
        let is_another = before != Some(reason) && reason.is_about_identity();
        self.arming.has_new_fault |= !was_running && (is_another || is_first_fault);
        let reason = match self.state {
            RemoteState::Running => reason,
            RemoteState::Offline { reason: before, .. }
            | RemoteState::Restarting { reason: before } => reason.after(before),
        };
        self.state = RemoteState::Offline {
            reason,
            next_attempt,
        };
    }

    /// Marks the begin of a restart.
    pub fn restarting(&mut self) {
        self.is_asked_for = false;
        if let RemoteState::Offline { reason, .. } = self.state {
            self.state = RemoteState::Restarting { reason };
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
        let is_kind = !self.has_run && is_of_kind;
        if name != self.started.name || unit != unit_number && !is_kind {
            return Some(OfflineReason::AnotherDevice {
                found: RemoteIdentity { name, unit_number },
                expected: self.started.identity(),
            });
        }
        let are_known = self.has_run || expected != 0;
        (are_known && found != expected).then_some(OfflineReason::OtherTables { found, expected })
    }

    /// Marks the remote as running and stores the identity that START reported; any other unit is
    /// refused from now on.
    pub fn restarted(&mut self, now: Instant, start_registers: [u32; 3]) {
        let is = self.started;
        self.started = StartedRemote::new(
            is.channel,
            is.software_mode,
            start_registers,
            is.sizes,
            is.cs,
        );
        self.state = RemoteState::Running;
        self.outputs = OutputsState::Off;
        self.has_failed = false;
        self.is_asked_for = false;
        let has_run = core::mem::replace(&mut self.has_run, true);
        let was_absent = !has_run && self.first_fault == Some(OfflineReason::Absent);
        self.restarts.tally(1);
        self.fault_count = 0;
        self.faults = RemoteFaults::empty();
        self.has_just_failed = false;
        let remote = self.remote_id();
        let kind = if was_absent {
            EventKind::RemoteUp { remote }
        } else {
            EventKind::RemoteBack { remote }
        };
        self.tell(now, kind);
    }

    /// Takes the faults that a remote reports at a START that failed. A watchdog that bites
    /// meanwhile is none of them.
    pub fn reports(&mut self, faults: RemoteFaults) {
        let known = self.known_faults.union(RemoteFaults::WATCHDOG);
        self.arming.has_new_fault |= !known.contains(faults);
        self.known_faults = known.union(faults);
        self.faults = faults;
    }

    /// Reports that the remote will not be armed when it runs, because of the fault before.
    pub fn not_awaited(&self, now: Instant) {
        let remote = self.remote_id();
        self.tell(now, EventKind::RemoteRearmCancelled { remote });
    }

    /// Reports that a parameter was not written.
    pub fn parameter_not_written(&self, now: Instant, parameter: u8) {
        let remote = self.remote_id();
        let parameter = parameter.into();
        self.tell(now, EventKind::ParameterNotWritten { remote, parameter });
    }

    /// Clears the first fault, because the outputs follow the application (again).
    pub fn armed(&mut self, now: Instant) {
        if self.first_fault.take().is_some() {
            let remote = self.remote_id();
            self.tell(now, EventKind::RemoteRearmed { remote });
        }
    }

    /// Counts a failed transfer: adds `increment` to LinuxCNC's `fault-count` for each cycle
    /// without data. After another failure, the idle interval between the two counts as a cycle as
    /// well. The failure is reported as an event if it is the remote's own.
    pub fn count_fault(&mut self, now: Instant, own: Option<Failure>, increment: u32) {
        let remote = self.remote_id();
        if let (Some((sink, _)), Some(failure)) = (&self.event_sink, own) {
            let kind = EventKind::TransferFailed { remote, failure };
            self.failures.add(sink, now, 1, kind);
        }
        let is_next = core::mem::replace(&mut self.has_just_failed, true);
        let cycles = if is_next { 2 } else { 1 };
        let more = increment.saturating_mul(cycles);
        self.fault_count = self.fault_count.saturating_add(more);
    }

    /// Counts a good transfer.
    pub fn count_good(&mut self, now: Instant, decrement: u32) {
        self.has_just_failed = false;
        self.fault_count = self.fault_count.saturating_sub(decrement);
        let what = self.failed_transfers();
        if let Some((sink, _)) = &self.event_sink {
            self.failures.look(sink, now, what);
        }
    }

    /// Ends the row of failed transfers, and reports the number of those without an event of their
    /// own.
    pub fn end_row(&mut self, now: Instant) {
        let what = self.failed_transfers();
        if let Some((sink, _)) = &self.event_sink {
            self.failures.end(sink, now, what);
        }
    }

    fn failed_transfers(&self) -> Repeating {
        let remote = self.remote_id();
        Repeating::FailedTransfers { remote }
    }

    /// True if failed transfers are not yet made up for by good ones, or if their row is still
    /// open.
    pub const fn is_troubled(&self) -> bool {
        self.fault_count > 0 || self.has_just_failed || self.failures.is_open()
    }

    /// True if the remote runs, or is offline only because the board has lost its set-up: without
    /// transfers, and with a watchdog that has bitten for that reason.
    pub fn is_of_board(&self) -> bool {
        use OfflineReason::{BoardDown, NotRunning, Requested, Watchdog};
        let is_of_board = |cause| {
            matches!(
                cause,
                Some(BoardDown | NotRunning(_) | Requested | Watchdog)
            )
        };
        self.is_running() || is_of_board(self.cause)
    }

    pub fn is_running(&self) -> bool {
        self.state == RemoteState::Running
    }

    pub const fn channel(&self) -> Channel {
        self.started.channel
    }

    /// The address of the remote.
    fn remote_id(&self) -> RemoteId {
        let port = self.event_sink.as_ref().map_or(0, |(_, port)| *port);
        RemoteId::new(port, self.channel().index())
    }

    fn tell(&self, now: Instant, kind: EventKind) {
        if let Some((sink, _)) = &self.event_sink {
            sink.tell(now, kind);
        }
    }
}
