//! One channel in the cycle: what each transfer means for its data.

use core::time::Duration;

use super::attempts::Attempts;
use super::{Failure, FailureCounts, FaultPolicy, RemoteWatchdog, SetAside};
use crate::bus::Instant;
use crate::sslbp::{ComState, CsStatus, LinkStatus, LocalFaults, RemoteFaults};

/// Good transfers after which a remote counts as healthy again.
const HEALTHY: u64 = 1000;

/// What START told about the remote: what it must tell again after a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub unit_number: u32,
    pub name: u32,
    pub pointers: u32,
}

/// What a remote on a channel is doing.
///
/// A remote that is set aside gets no frame: neither process data nor a START, until the time of
/// its [watchdog](super::RemoteWatchdog) and a fifth more is over since it was last talked to. By
/// then its outputs are off, all of them, whatever it had been told and whatever fault it has. After
/// a START that succeeds it gets safe values until it is re-armed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RemoteState {
    /// It transfers process data.
    Running,
    /// It is set aside; the driver tries to bring it back at the given time.
    SetAside {
        /// Why: the first reason since it was re-armed last, until another device is found in its
        /// place.
        reason: SetAside,
        /// When it is tried next, at the earliest; `None`: when the application asks for it.
        next_attempt: Option<Instant>,
    },
    /// It is being restarted.
    Restarting {
        /// Why it was set aside.
        reason: SetAside,
    },
}

/// What one transfer means for a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Its data is new and sound.
    Good,
    /// Its data must not be used.
    Failed(Failure),
    /// The remote reports a fault: nothing of it is used any more.
    Faulty(SetAside),
}

/// A channel with a remote.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    pub identity: Identity,
    /// The first byte of its replies is data and no fault byte.
    pub data_only: bool,
    pub watchdog: RemoteWatchdog,
    pub state: RemoteState,
    /// Why it was set aside last.
    pub cause: Option<SetAside>,
    /// Why it was set aside first since it was re-armed.
    pub first_fault: Option<SetAside>,
    pub failures: FailureCounts,
    pub transfers: u64,
    pub restarts: u64,
    pub cs: CsStatus,
    /// LinuxCNC's `fault-count`: rises with failures, falls with good transfers.
    pub fault_count: u32,
    /// What it reported last.
    pub faults: RemoteFaults,
    pub attempts: Attempts,
    /// Sticky bits as they were before the last transfer.
    known_faults: LocalFaults,
    last: Option<Failure>,
    /// It is left out of transfers until then. After a failed one the line needs an idle interval,
    /// in which a late reply or extra characters show themselves: a transfer at once could have
    /// the reply of the one before (FACTS 5.4).
    pub rest_until: Instant,
    /// Good transfers that are still to be discarded.
    discard: u8,
    good_since_restart: u64,
    /// The transfer before failed, too.
    has_just_failed: bool,
}

/// After a transfer that may or may not have happened, the next good one is discarded: its reply
/// could be that of the one before.
const DISCARD_AFTER_DOUBT: u8 = 1;

impl Channel {
    pub fn new(
        identity: Identity,
        data_only: bool,
        watchdog: RemoteWatchdog,
        first_backoff: Duration,
    ) -> Self {
        Self {
            identity,
            data_only,
            watchdog,
            state: RemoteState::Running,
            cause: None,
            first_fault: None,
            failures: FailureCounts::default(),
            transfers: 0,
            restarts: 0,
            cs: CsStatus::default(),
            fault_count: 0,
            faults: RemoteFaults::empty(),
            attempts: Attempts::new(first_backoff),
            known_faults: LocalFaults::empty(),
            last: None,
            rest_until: Instant::default(),
            discard: 0,
            good_since_restart: 0,
            has_just_failed: false,
        }
    }

    /// It is set aside, or stays so for one more reason; the next attempt is planned.
    pub fn set_aside(&mut self, now: Instant, reason: SetAside, policy: &FaultPolicy) {
        // A remote whose watchdog has bitten has switched its outputs off. A START that fails may
        // have fed it again.
        let silence = match reason {
            SetAside::Watchdog => Duration::ZERO,
            _ => self.watchdog.silence(),
        };
        self.attempts.silent_until = now.after(silence);
        if self.is_running() && self.good_since_restart >= HEALTHY {
            self.attempts.pause = policy.first_backoff;
        }
        let mut wait = self.attempts.next_pause(reason, policy);
        if self.watchdog == RemoteWatchdog::Off && self.is_running() && self.first_fault.is_none() {
            // It may have outputs on, which nothing but a START switches off.
            self.attempts.is_asked_for = true;
            wait = Duration::ZERO;
        }
        let next_attempt = policy
            .automatic
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
            self.show(SetAside::Requested, Some(next_attempt));
        }
    }

    /// The application has switched its port off; it is tried when it is on again.
    pub fn stop_for_good(&mut self) {
        self.attempts.is_asked_for = true;
        self.show(SetAside::Stopped, Some(self.attempts.silent_until));
    }

    fn show(&mut self, reason: SetAside, next_attempt: Option<Instant>) {
        self.cause = Some(reason);
        let first = *self.first_fault.get_or_insert(reason);
        let reason = match reason {
            SetAside::AnotherDevice { .. } => reason,
            _ => first,
        };
        self.state = RemoteState::SetAside {
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

    /// Good transfers since it was started.
    pub const fn good_since_restart(&self) -> u64 {
        self.good_since_restart
    }

    pub fn is_running(&self) -> bool {
        self.state == RemoteState::Running
    }

    /// Judges a transfer that is complete: CS, and the channel's bit in DATA.
    pub fn judge(&mut self, cs: CsStatus, has_failed: bool) -> Verdict {
        self.transfers += 1;
        self.cs = cs;
        let new_faults = cs.local_faults().difference(self.known_faults);
        self.known_faults = cs.local_faults();
        let failure = if is_in_chatter(cs) {
            // A chatter reply was lost just before the first DOIT, which the channel then left out.
            Failure::NoReply
        } else if !transfers_data(cs) {
            Failure::NotRunning
        } else if has_failed {
            self.kind_of_failure(cs, new_faults)
        } else if self.discard > 0 {
            self.discard -= 1;
            self.last = None;
            self.failures.add(Failure::Doubtful);
            return self
                .reported()
                .unwrap_or(Verdict::Failed(Failure::Doubtful));
        } else {
            self.last = None;
            self.good_since_restart += 1;
            return self.reported().unwrap_or(Verdict::Good);
        };
        if failure == Failure::Late {
            self.failures.lost_was_late();
        } else {
            self.failures.add(failure);
        }
        self.last = Some(failure);
        Verdict::Failed(failure)
    }

    /// A transfer of which it is not known whether it happened: CS still tells the fault byte of
    /// the last reply, once there was one since START (FACTS 2.5).
    pub fn judge_doubtful(&mut self, cs: CsStatus) -> Option<Verdict> {
        self.lose_track();
        self.cs = cs;
        if self.good_since_restart > 0 && transfers_data(cs) {
            self.reported()
        } else {
            None
        }
    }

    /// The faults that CS shows, where the reply has a fault byte.
    fn reported(&mut self) -> Option<Verdict> {
        if self.data_only {
            return None;
        }
        self.faults = self.cs.remote_faults();
        SetAside::of_faults(self.faults).map(Verdict::Faulty)
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

    /// A transfer was asked for, and it is not known whether it happened.
    fn lose_track(&mut self) {
        self.discard = DISCARD_AFTER_DOUBT;
        self.last = None;
    }

    /// A restart begins.
    pub fn restarting(&mut self) {
        self.attempts.is_asked_for = false;
        if let RemoteState::SetAside { reason, .. } = self.state {
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

    /// The channel has been restarted and runs.
    pub fn restarted(&mut self, cs: CsStatus) {
        self.state = RemoteState::Running;
        self.attempts.has_failed = false;
        self.restarts += 1;
        self.fault_count = 0;
        self.faults = RemoteFaults::empty();
        self.cs = cs;
        self.known_faults = cs.local_faults();
        self.last = None;
        self.discard = 0;
        self.good_since_restart = 0;
        self.has_just_failed = false;
    }

    fn kind_of_failure(&self, cs: CsStatus, new_faults: LocalFaults) -> Failure {
        let sticky = cs.local_faults();
        let damaged = is_damaged(cs);
        let of = |faults: LocalFaults| {
            if faults.contains(LocalFaults::SERIAL_BREAK) {
                Some(Failure::Break)
            } else if faults.contains(LocalFaults::EXTRA_CHARACTER) {
                Some(Failure::ExtraCharacters)
            } else if faults.contains(LocalFaults::OVERRUN) {
                Some(Failure::Overrun)
            } else if faults.contains(LocalFaults::CRC) {
                Some(Failure::Crc)
            } else {
                None
            }
        };
        let kind = match of(new_faults) {
            Some(kind) => kind,
            None if !damaged => Failure::NoReply,
            // The bit was set before: it tells the kind only if it is alone.
            None => only_kind(sticky).and_then(of).unwrap_or(Failure::Damaged),
        };
        let late = self.last == Some(Failure::NoReply)
            && matches!(kind, Failure::ExtraCharacters | Failure::Damaged);
        if late { Failure::Late } else { kind }
    }
}

/// Whether the channel is in one of the states that exchange process data with DOIT.
fn transfers_data(cs: CsStatus) -> bool {
    let pending = LinkStatus::NOT_READY.union(LinkStatus::NO_REMOTE_ID);
    matches!(
        cs.state(),
        ComState::ProcessData | ComState::ProcessData7i64
    ) && !cs.link().intersects(pending)
}

/// Whether the channel has been started, and has not seen a DOIT yet.
fn is_in_chatter(cs: CsStatus) -> bool {
    cs.is_ready() && cs.state() == ComState::Chatter
}

/// Whether the last reply was damaged, and not missing: the odd code of the two states
/// (FACTS 5.4).
fn is_damaged(cs: CsStatus) -> bool {
    cs.state_code() & 1 == 1
}

/// The only bit of damaged replies among the sticky ones, if there is only one.
fn only_kind(sticky: LocalFaults) -> Option<LocalFaults> {
    let kinds = LocalFaults::CRC
        .union(LocalFaults::EXTRA_CHARACTER)
        .union(LocalFaults::SERIAL_BREAK)
        .union(LocalFaults::OVERRUN);
    let kinds = sticky.intersection(kinds);
    kinds.bits().is_power_of_two().then_some(kinds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel() -> Channel {
        let identity = Identity {
            unit_number: 0x77AA,
            name: 0x3737_4937,
            pointers: 0x04A4_049A,
        };
        Channel::new(
            identity,
            false,
            RemoteWatchdog::Assumed,
            Duration::from_millis(100),
        )
    }

    /// The rows of gateware transcript t10: DATA bit and CS after each DOIT, with an idle interval
    /// between them, and what must become of the data.
    #[test]
    fn recorded_wire_faults_are_told_apart() {
        let good = Verdict::Good;
        let failed = Verdict::Failed;
        let mut channel = channel();
        let steps = [
            (0x0042_0000, false, good),
            (0x0042_2008, true, failed(Failure::NoReply)),
            (0x0042_2008, false, good),
            (0x0043_2009, true, failed(Failure::Crc)),
            (0x0042_2009, false, good),
            // An extra byte shows with the next DOIT.
            (0x0042_2009, false, good),
            (0x0043_2019, true, failed(Failure::ExtraCharacters)),
            (0x0042_2019, false, good),
            // A reply that is too late looks lost at first.
            (0x0042_2019, true, failed(Failure::NoReply)),
            (0x0043_2019, true, failed(Failure::Late)),
            (0x0042_2019, false, good),
            (0x0043_2039, true, failed(Failure::Break)),
        ];
        for (step, (cs, has_failed, expected)) in steps.into_iter().enumerate() {
            let verdict = channel.judge(CsStatus::from_register(cs), has_failed);
            assert_eq!(verdict, expected, "step {step}");
        }
        let counted: Vec<_> = channel.failures.iter().filter(|(_, n)| *n > 0).collect();
        assert_eq!(
            counted,
            [
                (Failure::NoReply, 1),
                (Failure::Late, 1),
                (Failure::Crc, 1),
                (Failure::ExtraCharacters, 1),
                (Failure::Break, 1),
            ]
        );
        assert_eq!(channel.failures.total(), 5);
    }

    /// Gateware transcript t11: DATA stays 00.
    #[test]
    fn a_fault_byte_comes_with_good_data_and_every_bit_of_it_counts() {
        for bit in 0..8 {
            let mut channel = channel();
            let verdict = channel.judge(
                CsStatus::from_register(0x0042_2140 | 1 << (24 + bit)),
                false,
            );
            assert!(matches!(verdict, Verdict::Faulty(_)), "bit {bit}");
            assert_eq!(channel.faults, RemoteFaults::from_bits_retain(1 << bit));
        }
    }

    /// FACTS 2.4: the fault byte of the past is there until the first transfer after START.
    #[test]
    fn a_fault_is_seen_behind_a_transfer_in_doubt_but_not_one_from_before_start() {
        let faulty = CsStatus::from_register(0x0842_2140);
        let mut channel = channel();
        assert_eq!(channel.judge_doubtful(faulty), None);
        channel.judge(CsStatus::from_register(0x0042_0000), false);
        channel.judge(CsStatus::from_register(0x0042_0000), false);
        let reason = SetAside::Reported(RemoteFaults::OVER_CURRENT);
        assert_eq!(
            channel.judge_doubtful(faulty),
            Some(Verdict::Faulty(reason))
        );
        assert_eq!(channel.judge(faulty, false), Verdict::Faulty(reason));
    }

    /// FACTS 5.5: DATA says 0 for a channel that was stopped.
    #[test]
    fn a_channel_that_does_not_run_has_no_data_whatever_data_says() {
        for cs in [0x0000_C100, 0x0040_0000, 0x0001_E188, 0x0024_A1C0] {
            let verdict = channel().judge(CsStatus::from_register(cs), false);
            assert_eq!(verdict, Verdict::Failed(Failure::NotRunning), "{cs:08X}");
        }
    }
}
