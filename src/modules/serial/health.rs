//! One remote in the cycle: whether it takes part, why not, and when it is tried again.

use crate::hostmot2::RemoteId;
use core::time::Duration;

use super::watchdog::Outputs;
use super::{FaultPolicy, OfflineReason, RemoteWatchdog};
use crate::bus::Instant;
use crate::modules::events::{EventKind, Repeating, Row, Sink};
use crate::sslbp::{Channel, Failure, RemoteFaults, RemoteName, StartedRemote};
use crate::tally::Tally;

/// Good transfers after which a remote counts as healthy again.
const HEALTHY: u64 = 1000;

/// What a remote on a channel is doing.
///
/// A remote that is offline gets no frame: neither process data nor a START, until the time of
/// its [watchdog](super::RemoteWatchdog) and a fifth more is over since its last frame. By then
/// its outputs are off, all of them, whatever the last frame set and whatever fault it has. After a
/// START that succeeds it gets safe values until it is re-armed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "state", rename_all = "kebab-case"))]
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
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Clone, Debug)]
pub(crate) struct Health {
    /// What START found. Of one that has never run, what is known of its kind: 0 for a unit
    /// number or tables that are not known, and of the unit number the class in the top byte.
    pub started: StartedRemote,
    pub watchdog: RemoteWatchdog,
    pub outputs: Outputs,
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
    /// It has run before, so that its sizes are known to be right, and it can have been stopped.
    pub has_run: bool,
    /// The board got its set-up back, and this one has not transferred since: it comes up because of
    /// that, unless it has a fault of its own.
    pub comes_with_board: bool,
    /// It is left out of transfers until then. After a failed one the line needs an idle interval,
    /// in which a late reply or extra characters show themselves: a transfer at once could have
    /// the reply of the one before (FACTS 5.4).
    pub rest_until: Instant,
    /// The transfer before failed, too.
    has_just_failed: bool,
    /// The failed transfers of which the first was told.
    failures: Row,
    /// How long to wait before the next attempt to bring it back; it doubles with each.
    pause: Duration,
    /// Nothing is sent to it before: its watchdog must have bitten.
    pub silent_until: Instant,
    /// The application asked for the next attempt, so that it is made whatever it costs.
    pub is_asked_for: bool,
    /// The last attempt failed, so that the next one is likely to take long.
    pub has_failed: bool,
    /// Where what happens to it is told, and its port.
    pub told: Option<(Sink, u8)>,
}

impl Health {
    /// A remote that runs.
    pub fn new(started: StartedRemote, watchdog: RemoteWatchdog, policy: &FaultPolicy) -> Self {
        Self {
            started,
            watchdog,
            outputs: Outputs::Off,
            state: RemoteState::Running,
            cause: None,
            first_fault: None,
            restarts: 0,
            fault_count: 0,
            faults: RemoteFaults::empty(),
            has_run: true,
            comes_with_board: false,
            rest_until: Instant::default(),
            has_just_failed: false,
            failures: Row::default(),
            pause: policy.first_backoff,
            silent_until: Instant::default(),
            is_asked_for: false,
            has_failed: false,
            told: None,
        }
    }

    /// It was never there.
    pub fn absent(mut self, now: Instant, policy: &FaultPolicy) -> Self {
        (self.has_run, self.has_failed) = (false, true);
        self.go_offline(now, OfflineReason::Absent, 0, policy);
        self
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
        // A remote whose watchdog has bitten has switched its outputs off, and one that is absent
        // got no frame. A START that fails may have fed it again.
        let silence = match reason {
            OfflineReason::Watchdog | OfflineReason::Absent => Duration::ZERO,
            _ => self.watchdog.silence(),
        };
        self.silent_until = now.after(silence);
        self.outputs
            .silent(reason, self.watchdog, self.silent_until);
        if self.is_running() && good >= HEALTHY {
            self.pause = policy.first_backoff;
        }
        let may_drive =
            self.watchdog == RemoteWatchdog::Off && self.is_running() && self.first_fault.is_none();
        // It may have outputs on, which nothing but a START switches off.
        self.is_asked_for |= may_drive && policy.automatic;
        // The first attempt after a fault that a START clears waits for nothing but the silence.
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

    /// The application asks for a restart at once: of one that runs without a fault now, of
    /// another one when its outputs must be off.
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

    /// The application has switched its port off; it is tried when it is on again.
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
            self.end_row(now);
            let kind = EventKind::RemoteOffline { remote, reason };
            self.tell(now, kind);
        } else if before != Some(reason) && !reason.is_asked_for() && !is_still_absent {
            let kind = EventKind::RemoteStaysOffline { remote, reason };
            self.tell(now, kind);
        }
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

    /// A restart begins.
    pub fn restarting(&mut self) {
        self.is_asked_for = false;
        if let RemoteState::Offline { reason, .. } = self.state {
            self.state = RemoteState::Restarting { reason };
        }
    }

    /// Why what answered START is not this one: by interface registers 0 to 2, its unit number, name
    /// and tables. Of one that has never run, its kind counts as far as it is known, unless its unit
    /// number is, and its sizes are still to be compared.
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
            return Some(OfflineReason::AnotherDevice { name, unit_number });
        }
        let are_known = self.has_run || expected != 0;
        (are_known && found != expected).then_some(OfflineReason::OtherTables { found, expected })
    }

    /// It runs again. From now on it is this one, and no other of its kind.
    pub fn restarted(&mut self, now: Instant, told: [u32; 3]) {
        let is = self.started;
        self.started = StartedRemote::new((is.channel, is.software_mode), told, is.sizes, is.cs);
        self.state = RemoteState::Running;
        self.outputs = Outputs::Off;
        self.has_failed = false;
        self.is_asked_for = false;
        let has_run = core::mem::replace(&mut self.has_run, true);
        self.restarts.tally(1);
        self.fault_count = 0;
        self.faults = RemoteFaults::empty();
        self.has_just_failed = false;
        let remote = self.remote_id();
        let kind = if has_run {
            EventKind::RemoteBack { remote }
        } else {
            EventKind::RemoteUp { remote }
        };
        self.tell(now, kind);
    }

    /// Its outputs follow the application (again): what was before is history.
    pub fn armed(&mut self, now: Instant) {
        if self.first_fault.take().is_some() {
            let remote = self.remote_id();
            self.tell(now, EventKind::RemoteRearmed { remote });
        }
    }

    /// A failed transfer: what LinuxCNC's `fault-count` does, by `increment` for each cycle without
    /// data. After another failure the idle interval between them is one as well. It is told if it is
    /// the remote's own.
    pub fn count_fault(&mut self, now: Instant, own: Option<Failure>, increment: u32) {
        let remote = self.remote_id();
        if let (Some((sink, _)), Some(failure)) = (&self.told, own) {
            let kind = EventKind::TransferFailed { remote, failure };
            self.failures.add(sink, now, 1, kind);
        }
        let is_next = core::mem::replace(&mut self.has_just_failed, true);
        let cycles = if is_next { 2 } else { 1 };
        let more = increment.saturating_mul(cycles);
        self.fault_count = self.fault_count.saturating_add(more);
    }

    /// A good transfer.
    pub fn count_good(&mut self, now: Instant, decrement: u32) {
        self.has_just_failed = false;
        self.fault_count = self.fault_count.saturating_sub(decrement);
        let what = self.failed_transfers();
        if let Some((sink, _)) = &self.told {
            self.failures.look(sink, now, what);
        }
    }

    /// Failed transfers that were not told are told now, as a number.
    pub fn end_row(&mut self, now: Instant) {
        let what = self.failed_transfers();
        if let Some((sink, _)) = &self.told {
            self.failures.end(sink, now, what);
        }
    }

    fn failed_transfers(&self) -> Repeating {
        let remote = self.remote_id();
        Repeating::FailedTransfers { remote }
    }

    /// Whether a transfer has failed that good ones have not made up for, or of whose row the end has
    /// not come.
    pub const fn is_troubled(&self) -> bool {
        self.fault_count > 0 || self.has_just_failed || self.failures.is_open()
    }

    /// True if it runs, or is offline for nothing but what a board does that has lost its set-up: no
    /// transfers, and a watchdog that bites because of that.
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

    /// Its port and channel.
    fn remote_id(&self) -> RemoteId {
        let port = self.told.as_ref().map_or(0, |(_, port)| *port);
        RemoteId::new(port, self.channel().index())
    }

    fn tell(&self, now: Instant, kind: EventKind) {
        if let Some((sink, _)) = &self.told {
            sink.tell(now, kind);
        }
    }
}
