//! One channel in the cycle: what each transfer means for its data.

use core::fmt;
use core::time::Duration;

use crate::bus::Instant;
use crate::sslbp::{ComState, CsStatus, LinkStatus, LocalFaults, RemoteFaults};

/// Why the data of a transfer can not be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Failure {
    /// No reply in time, or too short a one.
    NoReply,
    /// A reply that came after its time was over. Recognised one transfer later.
    Late,
    /// A reply with a wrong CRC.
    Crc,
    /// More characters than the reply has.
    ExtraCharacters,
    /// The line was held low.
    Break,
    /// Characters came faster than the gateware read them.
    Overrun,
    /// A damaged reply; the sticky bits of CS are set already, so that the kind does not show.
    Damaged,
    /// The channel does not run: somebody else stopped it, or the FPGA was reset.
    NotRunning,
    /// A good transfer after one that the bus may have lost: the reply could belong to that one.
    Doubtful,
}

impl Failure {
    /// All of them, in the order of [`FailureCounts`].
    pub const ALL: [Self; 9] = [
        Self::NoReply,
        Self::Late,
        Self::Crc,
        Self::ExtraCharacters,
        Self::Break,
        Self::Overrun,
        Self::Damaged,
        Self::NotRunning,
        Self::Doubtful,
    ];
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::NoReply => "no reply",
            Self::Late => "late reply",
            Self::Crc => "wrong CRC",
            Self::ExtraCharacters => "extra characters",
            Self::Break => "line low",
            Self::Overrun => "overrun",
            Self::Damaged => "damaged reply",
            Self::NotRunning => "not running",
            Self::Doubtful => "discarded after a failure",
        })
    }
}

/// How often each [`Failure`] happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FailureCounts([u64; Failure::ALL.len()]);

impl FailureCounts {
    /// How often this one happened.
    pub fn of(&self, failure: Failure) -> u64 {
        self.0.get(failure as usize).copied().unwrap_or(0)
    }

    /// All failures together, without the transfers discarded after them.
    pub fn total(&self) -> u64 {
        self.0.iter().sum::<u64>() - self.of(Failure::Doubtful)
    }

    /// Each failure with its count.
    pub fn iter(&self) -> impl Iterator<Item = (Failure, u64)> + '_ {
        Failure::ALL.into_iter().zip(self.0)
    }

    pub(super) fn add(&mut self, failure: Failure) {
        if let Some(count) = self.0.get_mut(failure as usize) {
            *count += 1;
        }
    }

    /// A reply that was taken for lost turns out to be late.
    fn lost_was_late(&mut self) {
        let [no_reply, late, ..] = &mut self.0;
        *no_reply = no_reply.saturating_sub(1);
        *late += 1;
    }
}

/// Why a remote is set aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SetAside {
    /// Too many transfers failed in too short a time.
    TooManyFailures(Failure),
    /// Its channel does not run any more.
    NotRunning(CsStatus),
    /// Its watchdog has bitten or it lost power: it needs a START.
    Watchdog,
    /// It does not know its software mode any more.
    IllegalMode,
    /// Its field power is missing, too low or too high.
    FieldPower(RemoteFaults),
    /// START did not succeed; CS says how far it came.
    DidNotStart(CsStatus),
    /// Another device is on its channel.
    AnotherDevice {
        /// Interface register 1 after START: its name.
        name: u32,
        /// Interface register 0 after START: its unit number.
        unit_number: u32,
    },
    /// The port never finished a command.
    PortStuck,
    /// The application switched its port off.
    Stopped,
    /// The application asked for a restart.
    Requested,
}

impl fmt::Display for SetAside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooManyFailures(failure) => {
                write!(f, "too many failed transfers, the last: {failure}")
            }
            Self::NotRunning(cs) => write!(f, "its channel does not run: {cs}"),
            Self::Watchdog => f.write_str(
                "its watchdog has bitten or its power was off; it is restarted in its mode",
            ),
            Self::IllegalMode => f.write_str("it does not know its software mode any more"),
            Self::FieldPower(faults) => write!(f, "{faults}: check its field power"),
            Self::DidNotStart(cs) => write!(f, "it did not start: {cs}"),
            Self::AnotherDevice { name, unit_number } => write!(
                f,
                "another device answers ({}, unit number {unit_number:#010X}); it is not taken \
                 over: plug the right one in, or build the driver anew",
                crate::discovery::RemoteName::from_register(*name)
            ),
            Self::PortStuck => f.write_str("the port never finished a command"),
            Self::Stopped => f.write_str("its port is switched off"),
            Self::Requested => f.write_str("the application asked for a restart"),
        }
    }
}

/// What START told about the remote: what it must tell again after a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub unit_number: u32,
    pub name: u32,
    pub pointers: u32,
}

/// What a remote on a channel is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RemoteState {
    /// It transfers process data.
    Running,
    /// It is set aside; the driver tries to bring it back at the given time.
    SetAside {
        /// Why.
        reason: SetAside,
        /// When it is tried next; `None`: when the application asks for it.
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
    /// Its data is new and sound; the faults the remote reported with it.
    Good(RemoteFaults),
    /// Its data must not be used.
    Failed(Failure),
}

/// A channel with a remote.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    pub identity: Identity,
    /// The first byte of its replies is data and no fault byte.
    pub data_only: bool,
    pub state: RemoteState,
    pub failures: FailureCounts,
    pub transfers: u64,
    pub restarts: u64,
    pub cs: CsStatus,
    /// LinuxCNC's `fault-count`: rises with failures, falls with good transfers.
    pub fault_count: u32,
    /// What the last good transfer reported.
    pub faults: RemoteFaults,
    pub backoff: Duration,
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
    pub fn new(identity: Identity, data_only: bool, first_backoff: Duration) -> Self {
        Self {
            identity,
            data_only,
            state: RemoteState::Running,
            failures: FailureCounts::default(),
            transfers: 0,
            restarts: 0,
            cs: CsStatus::default(),
            fault_count: 0,
            faults: RemoteFaults::empty(),
            backoff: first_backoff,
            known_faults: LocalFaults::empty(),
            last: None,
            rest_until: Instant::default(),
            discard: 0,
            good_since_restart: 0,
            has_just_failed: false,
        }
    }

    /// Good transfers since it was started.
    pub const fn good_since_restart(&self) -> u64 {
        self.good_since_restart
    }

    /// How long to wait before the next attempt; the one after waits twice as long.
    pub fn next_backoff(&mut self, longest: Duration) -> Duration {
        let wait = self.backoff;
        self.backoff = wait.saturating_mul(2).min(longest);
        wait
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
            return Verdict::Failed(Failure::Doubtful);
        } else {
            self.last = None;
            self.good_since_restart += 1;
            if !self.data_only {
                self.faults = cs.remote_faults();
            }
            return Verdict::Good(self.faults);
        };
        if failure == Failure::Late {
            self.failures.lost_was_late();
        } else {
            self.failures.add(failure);
        }
        self.last = Some(failure);
        Verdict::Failed(failure)
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
    pub fn lose_track(&mut self) {
        self.discard = DISCARD_AFTER_DOUBT;
        self.last = None;
    }

    /// A restart begins.
    pub fn restarting(&mut self) {
        if let RemoteState::SetAside { reason, .. } = self.state {
            self.state = RemoteState::Restarting { reason };
        }
    }

    /// The channel has been restarted and runs.
    pub fn restarted(&mut self, cs: CsStatus) {
        self.state = RemoteState::Running;
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
        Channel::new(identity, false, Duration::from_millis(100))
    }

    /// The rows of gateware transcript t10: DATA bit and CS after each DOIT, with an idle interval
    /// between them, and what must become of the data.
    #[test]
    fn recorded_wire_faults_are_told_apart() {
        let good = Verdict::Good(RemoteFaults::empty());
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
    fn a_fault_byte_comes_with_good_data() {
        let verdict = channel().judge(CsStatus::from_register(0x2042_2140), false);
        assert_eq!(verdict, Verdict::Good(RemoteFaults::LOW_VOLTAGE));
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
