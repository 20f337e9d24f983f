//! State of one channel, and the evaluation of its transfers.

use super::{Failure, FailureCounts};
use crate::sslbp::{CsStatus, LocalFaults, ProcessDataSizes, RemoteFaults, StartMode};

/// Result of a channel's last transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TransferResult {
    /// Its data is new and sound.
    Good,
    /// Its data cannot be used.
    Failed(Failure),
    /// The remote reports a fault: its data is not used.
    Faulty(RemoteFaults),
}

/// State of a channel since its last START, and its counters.
#[derive(Clone, Debug)]
pub struct ChannelLink {
    /// Sizes of its remote's process data.
    pub sizes: ProcessDataSizes,
    /// Interface registers 0 to 2 after the last START: unit number, name, tables.
    pub start_registers: [u32; 3],
    /// Result of the last transfer.
    pub verdict: TransferResult,
    /// CS after the last transfer or START.
    pub cs: CsStatus,
    /// Number of good transfers since its START.
    pub good: u64,
    /// Number of all transfers, failed ones included.
    pub transfers: u64,
    /// Counts of all failures.
    pub failures: FailureCounts,
    /// True if the first byte of its replies is the fault byte.
    pub(super) has_fault_byte: bool,
    /// Sticky bits before the last transfer.
    known_faults: LocalFaults,
    /// Bits set by the present run of failures.
    run_faults: LocalFaults,
    last_failure: Option<Failure>,
    /// Number of good transfers still to be discarded.
    discard: u8,
}

/// Number of good transfers to discard after one that may not have happened: the reply could belong
/// to the transfer before.
const DISCARD_AFTER_DOUBT: u8 = 1;

impl ChannelLink {
    pub(super) fn new() -> Self {
        Self {
            sizes: ProcessDataSizes::default(),
            has_fault_byte: true,
            start_registers: [0; 3],
            verdict: TransferResult::Failed(Failure::NotRunning),
            cs: CsStatus(0),
            known_faults: LocalFaults::empty(),
            run_faults: LocalFaults::empty(),
            last_failure: None,
            discard: 0,
            good: 0,
            transfers: 0,
            failures: FailureCounts::default(),
        }
    }

    /// Takes the state after a completed START.
    pub(super) fn started(&mut self, cs: CsStatus, start_registers: [u32; 3]) {
        self.cs = cs;
        self.start_registers = start_registers;
        self.known_faults = cs.local_faults();
        self.run_faults = LocalFaults::empty();
        self.verdict = TransferResult::Failed(Failure::NotRunning);
        self.last_failure = None;
        self.discard = 0;
        self.good = 0;
    }

    /// Evaluates a completed transfer from CS and the channel's bit in DATA.
    pub(super) fn judge(&mut self, cs: CsStatus, has_failed: bool) -> TransferResult {
        self.transfers = self.transfers.wrapping_add(1);
        if cs == self.cs && self.verdict == TransferResult::Good && !has_failed && self.discard == 0
        {
            // Fast path: nothing has changed since the transfer before.
            self.good = self.good.wrapping_add(1);
            return TransferResult::Good;
        }
        self.cs = cs;
        let new_faults = cs.local_faults().difference(self.known_faults);
        self.known_faults = cs.local_faults();
        if has_failed {
            self.run_faults |= new_faults;
        } else {
            self.run_faults = LocalFaults::empty();
        }
        self.verdict = if !cs.transfers_data() {
            // A chatter reply was lost just before the first DOIT, so the channel skipped that
            // DOIT.
            let is_left_out = cs.has_started(StartMode::Normal);
            self.failed(if is_left_out {
                Failure::NoReply
            } else {
                Failure::NotRunning
            })
        } else if has_failed {
            let failure = self.kind_of_failure(cs, new_faults);
            self.failed(failure)
        } else if self.discard > 0 {
            self.discard = self.discard.wrapping_sub(1);
            self.last_failure = None;
            self.failures.add(Failure::Doubtful);
            self.reported()
                .unwrap_or(TransferResult::Failed(Failure::Doubtful))
        } else {
            self.last_failure = None;
            self.good = self.good.wrapping_add(1);
            self.reported().unwrap_or(TransferResult::Good)
        };
        self.verdict
    }

    fn failed(&mut self, failure: Failure) -> TransferResult {
        if failure == Failure::Late {
            self.failures.lost_was_late();
        } else {
            self.failures.add(failure);
        }
        self.last_failure = Some(failure);
        TransferResult::Failed(failure)
    }

    /// Evaluates a transfer that may not have happened. CS still contains the fault byte of the
    /// last reply, once there was a reply since START (FACTS 2.4). Returns true if that byte
    /// reports a fault.
    pub(super) fn judge_doubtful(&mut self, cs: CsStatus) -> bool {
        self.discard = DISCARD_AFTER_DOUBT;
        self.last_failure = None;
        self.cs = cs;
        if self.good == 0 || !cs.transfers_data() {
            return false;
        }
        let faulty = self.reported();
        self.verdict = faulty.unwrap_or(TransferResult::Failed(Failure::Doubtful));
        faulty.is_some()
    }

    /// The faults in CS, if the reply has a fault byte.
    fn reported(&self) -> Option<TransferResult> {
        let faults = self.cs.remote_faults();
        (self.has_fault_byte && !faults.is_empty()).then_some(TransferResult::Faulty(faults))
    }

    fn kind_of_failure(&self, cs: CsStatus, new_faults: LocalFaults) -> Failure {
        let is_missing = !is_damaged(cs) && !new_faults.contains(LocalFaults::OVERRUN);
        let fresh = kinds_of(new_faults.difference(LocalFaults::OVERRUN)).next();
        // The failure that began the run continues: a line that is low sets no bit twice.
        let of_run = kinds_of(self.run_faults).next().filter(|_| !is_missing);
        let mut sticky = kinds_of(cs.local_faults());
        let kind = match (fresh.or(of_run), sticky.next(), sticky.next()) {
            (Some(kind), ..) => kind,
            (None, ..) if is_missing => Failure::NoReply,
            // The bit was set before: it identifies the kind only if no other bit except an overrun
            // is set.
            (None, Some(only), None | Some(Failure::Overrun)) => only,
            (None, ..) => Failure::Damaged,
        };
        let late = self.last_failure == Some(Failure::NoReply)
            && matches!(kind, Failure::ExtraCharacters | Failure::Damaged);
        if late { Failure::Late } else { kind }
    }
}

/// True if the last reply was damaged instead of missing: the odd code of the two states (FACTS
/// 5.4).
fn is_damaged(cs: CsStatus) -> bool {
    cs.state_code() & 1 == 1
}

/// The kinds of damaged replies, in order of precedence. An overrun comes last: any character
/// within a few nanoseconds of a request sets it, whatever the cause, and it does not damage data
/// (FACTS 11.8).
const KINDS: [(LocalFaults, Failure); 4] = [
    (LocalFaults::SERIAL_BREAK, Failure::Break),
    (LocalFaults::EXTRA_CHARACTER, Failure::ExtraCharacters),
    (LocalFaults::CRC, Failure::Crc),
    (LocalFaults::OVERRUN, Failure::Overrun),
];

fn kinds_of(faults: LocalFaults) -> impl Iterator<Item = Failure> {
    let is_set = move |&(fault, _): &(LocalFaults, Failure)| faults.contains(fault);
    KINDS.into_iter().filter(is_set).map(|(_, kind)| kind)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cs(word: u32) -> CsStatus {
        CsStatus(word)
    }

    /// The rows of gateware transcript t10: DATA bit and CS after each DOIT, with an idle interval
    /// between them, and the expected verdict.
    #[test]
    fn recorded_wire_faults_are_distinguished() {
        let good = TransferResult::Good;
        let failed = TransferResult::Failed;
        let mut link = ChannelLink::new();
        let steps = [
            (0x0042_0000, false, good),
            (0x0042_2008, true, failed(Failure::NoReply)),
            (0x0042_2008, false, good),
            (0x0043_2009, true, failed(Failure::Crc)),
            (0x0042_2009, false, good),
            // An extra byte becomes visible with the next DOIT.
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

    /// Judges transfers that all fail; returns the last verdict.
    fn last_failure(words: &[u32]) -> TransferResult {
        let mut link = ChannelLink::new();
        link.judge(cs(0x0042_0000), false);
        let verdicts = words.iter().map(|&word| link.judge(cs(word), true));
        verdicts.last().expect("a transfer")
    }

    /// Gateware transcript u06, read before and after the timeout, and the overrun of FACTS 11.8.
    #[test]
    fn low_line_is_reported_as_a_break_with_or_without_overrun() {
        let low = TransferResult::Failed(Failure::Break);
        let lost = TransferResult::Failed(Failure::NoReply);
        for overrun in [0, 0x04] {
            let first = 0x0043_2030 | overrun;
            assert_eq!(last_failure(&[first]), low, "{first:08X}");
            let later = 0x0043_2038 | overrun;
            assert_eq!(last_failure(&[0x0043_2030, later]), low, "{later:08X}");
            assert_eq!(last_failure(&[first, 0x0043_2038 | overrun]), low);
            // Read before the break is visible.
            let only_extra = 0x0043_2010 | overrun;
            let extra = TransferResult::Failed(Failure::ExtraCharacters);
            assert_eq!(last_failure(&[only_extra]), extra, "{only_extra:08X}");
            assert_eq!(last_failure(&[only_extra, later, later]), low);
        }
        // Read after the timeout: a low line does not answer.
        assert_eq!(last_failure(&[0x0042_2038]), low);
        assert_eq!(last_failure(&[0x0042_2038, 0x0042_2038]), lost);
        assert_eq!(last_failure(&[0x0042_2038, 0x0042_203C]), low);
    }

    /// FACTS 11.8.
    #[test]
    fn overrun_hides_no_kind_and_is_one_only_by_itself() {
        let failed = TransferResult::Failed;
        assert_eq!(last_failure(&[0x0043_2004]), failed(Failure::Overrun));
        assert_eq!(
            last_failure(&[0x0043_2004, 0x0043_2005]),
            failed(Failure::Crc)
        );
        let mut link = ChannelLink::new();
        let steps = [
            (0x0043_2005, true, failed(Failure::Crc)),
            (0x0042_2005, false, TransferResult::Good),
            (0x0043_2005, true, failed(Failure::Crc)),
            (0x0042_2005, false, TransferResult::Good),
            (0x0042_200D, true, failed(Failure::NoReply)),
        ];
        for (step, (word, has_failed, expected)) in steps.into_iter().enumerate() {
            assert_eq!(link.judge(cs(word), has_failed), expected, "step {step}");
        }
    }

    /// Gateware transcript t11: DATA stays 00.
    #[test]
    fn fault_byte_comes_with_good_data_and_every_bit_of_it_counts() {
        for bit in 0..8 {
            let verdict = ChannelLink::new().judge(cs(0x0042_2140 | 1 << (24 + bit)), false);
            let faults = RemoteFaults::from_bits_retain(1 << bit);
            assert_eq!(verdict, TransferResult::Faulty(faults), "bit {bit}");
        }
    }

    /// FACTS 3.7: an earlier fault byte stays there until the first transfer after START.
    #[test]
    fn fault_in_a_doubtful_transfer_counts_unless_from_before_start() {
        let faulty = cs(0x0842_2140);
        let over_current = TransferResult::Faulty(RemoteFaults::OVER_CURRENT);
        let mut link = ChannelLink::new();
        assert!(!link.judge_doubtful(faulty));
        link.judge(cs(0x0042_0000), false);
        link.judge(cs(0x0042_0000), false);
        assert!(link.judge_doubtful(faulty));
        assert_eq!(link.verdict, over_current);
        assert_eq!(link.judge(faulty, false), over_current);
    }

    /// FACTS 5.5: DATA reads 0 for a channel that was stopped.
    #[test]
    fn stopped_channel_has_no_data_although_data_reads_0() {
        for word in [0x0000_C100, 0x0040_0000, 0x0001_E188, 0x0024_A1C0] {
            let verdict = ChannelLink::new().judge(cs(word), false);
            assert_eq!(
                verdict,
                TransferResult::Failed(Failure::NotRunning),
                "{word:08X}"
            );
        }
    }
}
