//! One channel: what its transfers mean for its data.

use super::{Failure, FailureCounts};
use crate::sslbp::{ComState, CsStatus, LinkStatus, LocalFaults, ProcessDataSizes, RemoteFaults};

/// What the last transfer of a channel means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Its data is new and sound.
    Good,
    /// Its data must not be used.
    Failed(Failure),
    /// The remote reports a fault: nothing of it is used.
    Faulty(RemoteFaults),
}

/// What is known of a channel since its last START, and what was counted.
#[derive(Clone, Debug)]
pub struct Link {
    pub(super) sizes: ProcessDataSizes,
    /// The first byte of its replies is data and no fault byte.
    pub(super) data_only: bool,
    told: [u32; 3],
    verdict: Verdict,
    cs: CsStatus,
    /// Sticky bits as they were before the last transfer.
    known_faults: LocalFaults,
    last_failure: Option<Failure>,
    /// Good transfers that are still to be discarded.
    discard: u8,
    good: u64,
    transfers: u64,
    failures: FailureCounts,
}

/// After a transfer that may or may not have happened, the next good one is discarded: its reply
/// could be that of the one before.
const DISCARD_AFTER_DOUBT: u8 = 1;

impl Link {
    pub(super) const fn new() -> Self {
        Self {
            sizes: ProcessDataSizes { rx: 0, tx: 0 },
            data_only: false,
            told: [0; 3],
            verdict: Verdict::Failed(Failure::NotRunning),
            cs: CsStatus::from_register(0),
            known_faults: LocalFaults::empty(),
            last_failure: None,
            discard: 0,
            good: 0,
            transfers: 0,
            failures: FailureCounts::new(),
        }
    }

    /// What the last transfer means.
    pub const fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// CS after the last transfer or START.
    pub const fn cs(&self) -> CsStatus {
        self.cs
    }

    /// Interface registers 0 to 2 as the last START left them: unit number, name, tables.
    pub const fn told(&self) -> [u32; 3] {
        self.told
    }

    /// How much its remote exchanges.
    pub const fn sizes(&self) -> ProcessDataSizes {
        self.sizes
    }

    /// Good transfers since it was started.
    pub const fn good_since_start(&self) -> u64 {
        self.good
    }

    /// Transfers so far, failed ones included.
    pub const fn transfers(&self) -> u64 {
        self.transfers
    }

    /// Failures so far.
    pub const fn failures(&self) -> &FailureCounts {
        &self.failures
    }

    /// A START is complete.
    pub(super) fn started(&mut self, cs: CsStatus, told: [u32; 3]) {
        self.cs = cs;
        self.told = told;
        self.known_faults = cs.local_faults();
        self.verdict = Verdict::Failed(Failure::NotRunning);
        self.last_failure = None;
        self.discard = 0;
        self.good = 0;
    }

    /// Judges a transfer that is complete: CS, and the channel's bit in DATA.
    pub(super) fn judge(&mut self, cs: CsStatus, has_failed: bool) -> Verdict {
        self.transfers += 1;
        if cs == self.cs && self.verdict == Verdict::Good && !has_failed && self.discard == 0 {
            // As the one before.
            self.good += 1;
            return Verdict::Good;
        }
        self.cs = cs;
        let new_faults = cs.local_faults().difference(self.known_faults);
        self.known_faults = cs.local_faults();
        self.verdict = if cs.has_started(super::StartMode::Normal) && !transfers_data(cs) {
            // A chatter reply was lost just before the first DOIT, which the channel then left out.
            self.failed(Failure::NoReply)
        } else if !transfers_data(cs) {
            self.failed(Failure::NotRunning)
        } else if has_failed {
            let failure = self.kind_of_failure(cs, new_faults);
            self.failed(failure)
        } else if self.discard > 0 {
            self.discard -= 1;
            self.last_failure = None;
            self.failures.add(Failure::Doubtful);
            self.reported()
                .unwrap_or(Verdict::Failed(Failure::Doubtful))
        } else {
            self.last_failure = None;
            self.good += 1;
            self.reported().unwrap_or(Verdict::Good)
        };
        self.verdict
    }

    fn failed(&mut self, failure: Failure) -> Verdict {
        if failure == Failure::Late {
            self.failures.lost_was_late();
        } else {
            self.failures.add(failure);
        }
        self.last_failure = Some(failure);
        Verdict::Failed(failure)
    }

    /// A transfer of which it is not known whether it happened: CS still tells the fault byte of
    /// the last reply, once there was one since START (FACTS 2.4). Whether it tells one.
    pub(super) fn judge_doubtful(&mut self, cs: CsStatus) -> bool {
        self.discard = DISCARD_AFTER_DOUBT;
        self.last_failure = None;
        self.cs = cs;
        if self.good == 0 || !transfers_data(cs) {
            return false;
        }
        let faulty = self.reported();
        self.verdict = faulty.unwrap_or(Verdict::Failed(Failure::Doubtful));
        faulty.is_some()
    }

    /// The faults that CS shows, where the reply has a fault byte.
    fn reported(&self) -> Option<Verdict> {
        let faults = self.cs.remote_faults();
        (!self.data_only && !faults.is_empty()).then_some(Verdict::Faulty(faults))
    }

    fn kind_of_failure(&self, cs: CsStatus, new_faults: LocalFaults) -> Failure {
        let kind = match kind_of(new_faults) {
            Some(kind) => kind,
            None if !is_damaged(cs) => Failure::NoReply,
            // The bit was set before: it tells the kind only if it is alone.
            None => only_kind(cs.local_faults()).unwrap_or(Failure::Damaged),
        };
        let late = self.last_failure == Some(Failure::NoReply)
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

/// Whether the last reply was damaged, and not missing: the odd code of the two states
/// (FACTS 5.4).
fn is_damaged(cs: CsStatus) -> bool {
    cs.state_code() & 1 == 1
}

fn kind_of(faults: LocalFaults) -> Option<Failure> {
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
}

/// The only kind of damaged replies among the sticky bits, if there is only one.
fn only_kind(sticky: LocalFaults) -> Option<Failure> {
    let kinds = LocalFaults::CRC
        .union(LocalFaults::EXTRA_CHARACTER)
        .union(LocalFaults::SERIAL_BREAK)
        .union(LocalFaults::OVERRUN);
    let kinds = sticky.intersection(kinds);
    let is_one = kinds.bits().is_power_of_two();
    if is_one { kind_of(kinds) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cs(word: u32) -> CsStatus {
        CsStatus::from_register(word)
    }

    /// The rows of gateware transcript t10: DATA bit and CS after each DOIT, with an idle interval
    /// between them, and what must become of the data.
    #[test]
    fn recorded_wire_faults_are_told_apart() {
        let good = Verdict::Good;
        let failed = Verdict::Failed;
        let mut link = Link::new();
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
        for (step, (word, has_failed, expected)) in steps.into_iter().enumerate() {
            assert_eq!(link.judge(cs(word), has_failed), expected, "step {step}");
        }
        let counted: Vec<_> = link.failures.iter().filter(|(_, n)| *n > 0).collect();
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
        assert_eq!(link.failures.total(), 5);
    }

    /// Gateware transcript t11: DATA stays 00.
    #[test]
    fn a_fault_byte_comes_with_good_data_and_every_bit_of_it_counts() {
        for bit in 0..8 {
            let verdict = Link::new().judge(cs(0x0042_2140 | 1 << (24 + bit)), false);
            let faults = RemoteFaults::from_bits_retain(1 << bit);
            assert_eq!(verdict, Verdict::Faulty(faults), "bit {bit}");
        }
    }

    /// FACTS 3.7: the fault byte of the past is there until the first transfer after START.
    #[test]
    fn a_fault_is_seen_behind_a_transfer_in_doubt_but_not_one_from_before_start() {
        let faulty = cs(0x0842_2140);
        let over_current = Verdict::Faulty(RemoteFaults::OVER_CURRENT);
        let mut link = Link::new();
        assert!(!link.judge_doubtful(faulty));
        link.judge(cs(0x0042_0000), false);
        link.judge(cs(0x0042_0000), false);
        assert!(link.judge_doubtful(faulty));
        assert_eq!(link.verdict(), over_current);
        assert_eq!(link.judge(faulty, false), over_current);
    }

    /// FACTS 5.5: DATA says 0 for a channel that was stopped.
    #[test]
    fn a_channel_that_does_not_run_has_no_data_whatever_data_says() {
        for word in [0x0000_C100, 0x0040_0000, 0x0001_E188, 0x0024_A1C0] {
            let verdict = Link::new().judge(cs(word), false);
            assert_eq!(verdict, Verdict::Failed(Failure::NotRunning), "{word:08X}");
        }
    }
}
