//! Latency of cycles, the part of the period that they use, and the rates that this allows.

use core::fmt::{self, Display};
use core::time::Duration;

use super::{Cycle, Histogram};
use crate::bus::{Clock, Instant, RegisterBus};
use crate::driver::{Driver, Pace};
use crate::tally::Tally;

/// Measures the cycles of a [`Runner`](super::Runner).
///
/// ```
/// use std::ops::ControlFlow;
/// use mesa_hal::{Driver, Settings, runner::{Latency, RateJudgement, Runner}};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let driver = Driver::start(machines::six_axes_7i92(Default::default()), Settings::default())?;
/// let mut latency = Latency::of(&driver);
/// let ended = Runner::new(driver).run(|cycle| {
///     latency.record(cycle);
///     match cycle.number {
///         0..1000 => ControlFlow::Continue(()),
///         _ => ControlFlow::Break(()),
///     }
/// });
/// ended.stopped?;
/// assert_eq!(latency.used().count(), 1000);
/// let verdict = latency.verdict(1000);
/// assert!(verdict.is_kept() && verdict.judgement == RateJudgement::Yes);
/// assert!(format!("{verdict:#}").starts_with("1000 Hz: yes; no cycle needs more than"));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Latency {
    pace: Pace,
    period: Duration,
    transfer: Duration,
    late: Histogram,
    round_trip: Histogram,
    used: Histogram,
    failed: u64,
    /// The cycle that has started and whose end is not known yet, at the host's pace.
    begun: Option<CycleStart>,
    /// Arrival of the last inputs, at the board's pace.
    arrived: Option<Instant>,
}

#[derive(Clone, Copy, Debug)]
struct CycleStart {
    late: Duration,
    round_trip: Option<Duration>,
}

/// Judgement of a rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum RateJudgement {
    /// All cycles would have ended in time.
    Yes,
    /// At most one of 10,000 cycles would not have ended in time.
    Almost,
    /// The rate cannot be kept.
    No,
}

/// Judgement of a rate, with the reason. `Display` is one line with the reason alone, and the
/// alternate form `{:#}` begins with the rate and the judgement:
/// `1000 Hz: yes; no cycle needs more than 312 us of 1000`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct RateVerdict {
    /// Cycles per second.
    pub rate: u32,
    /// The judgement.
    pub judgement: RateJudgement,
    /// Number of cycles measured.
    pub cycles: u64,
    /// Cycles that would not have ended in time.
    pub late: u64,
    /// Reads that failed.
    pub failed: u64,
    /// Longest time that a cycle needed, including the transfers to the remotes.
    pub needs: Duration,
    /// Part of that time for the transfers to the remotes.
    pub transfer: Duration,
    /// Time that half of the cycles did not exceed.
    pub usually: Duration,
}

/// A rate is almost kept if at most one cycle of this number is late.
const CYCLES_PER_LATE: u64 = 10_000;

impl Latency {
    /// An empty measurement. The only function that allocates.
    pub fn of<B: RegisterBus + Clock>(driver: &Driver<B>) -> Self {
        let ports = driver.ports().iter();
        let transfers = ports.map(|port| port.expected_time.usual);
        Self {
            pace: driver.pace(),
            period: driver.period(),
            transfer: transfers.max().unwrap_or_default(),
            late: Histogram::new(),
            round_trip: Histogram::new(),
            used: Histogram::new(),
            failed: 0,
            begun: None,
            arrived: None,
        }
    }

    /// Records a cycle; call it in each, before anything else.
    ///
    /// The first call records nothing, and each of the others the previous cycle.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn record<B: RegisterBus + Clock>(&mut self, cycle: &Cycle<'_, B>) {
        match self.pace {
            Pace::Host => self.at_the_hosts_pace(cycle),
            Pace::Board => self.at_the_boards_pace(cycle),
        }
    }

    fn at_the_hosts_pace<B: RegisterBus + Clock>(&mut self, cycle: &Cycle<'_, B>) {
        let round_trip = cycle.pins().now().since(cycle.begun);
        let begun = CycleStart {
            late: cycle.late,
            round_trip: cycle.read.is_ok().then_some(round_trip),
        };
        let Some(before) = self.begun.replace(begun) else {
            return;
        };
        self.late.record(before.late);
        self.used.record(before.late.saturating_add(cycle.took));
        match before.round_trip {
            Some(time) => self.round_trip.record(time),
            None => self.failed.tally(1),
        }
    }

    fn at_the_boards_pace<B: RegisterBus + Clock>(&mut self, cycle: &Cycle<'_, B>) {
        let Ok(report) = &cycle.read else {
            self.failed.tally(self.arrived.is_some().into());
            return;
        };
        let now = cycle.pins().now();
        let Some(before) = self.arrived.replace(now) else {
            return;
        };
        self.late
            .record(now.since(before).saturating_sub(self.period));
        if let Some(slack) = report.slack {
            let missed = u32::try_from(report.missed_periods).unwrap_or(u32::MAX);
            let had = self.period.saturating_mul(missed.saturating_add(1));
            self.used.record(had.saturating_sub(slack));
        }
    }

    /// The pace of the measured cycles.
    pub const fn pace(&self) -> Pace {
        self.pace
    }

    /// Lateness of the cycles. At the host's pace: delay of the start after the planned time. At
    /// the board's: time since the previous inputs, less the period.
    pub const fn late(&self) -> &Histogram {
        &self.late
    }

    /// Time from the request for inputs to their arrival, at the host's pace.
    pub const fn round_trip(&self) -> &Histogram {
        &self.round_trip
    }

    /// Part of the period that the cycles used. At the host's pace: from the planned start to the
    /// end, when the write was sent. At the board's: the period, less the time that the board
    /// waited for its end.
    pub const fn used(&self) -> &Histogram {
        &self.used
    }

    /// Reads that failed.
    pub const fn failed(&self) -> u64 {
        self.failed
    }

    /// Longest time of the transfers between a port and its remotes, which begin with the write and
    /// must be complete at the next read.
    pub const fn transfer(&self) -> Duration {
        self.transfer
    }

    /// Judges whether `rate` cycles per second can be kept, from measurements at any rate.
    pub fn verdict(&self, rate: u32) -> RateVerdict {
        let period = period_of(rate);
        let cycles = self.used.count();
        let late = match period.checked_sub(self.transfer) {
            Some(room) => self.used.longer_than(room),
            None => cycles,
        };
        let judgement = match late.saturating_add(self.failed) {
            _ if cycles == 0 => RateJudgement::No,
            0 => RateJudgement::Yes,
            bad if bad.saturating_mul(CYCLES_PER_LATE) <= cycles => RateJudgement::Almost,
            _ => RateJudgement::No,
        };
        let usually = self.used.quantile(0.5).unwrap_or_default();
        RateVerdict {
            rate,
            judgement,
            cycles,
            late,
            failed: self.failed,
            needs: self.used.max().saturating_add(self.transfer),
            transfer: self.transfer,
            usually: usually.saturating_add(self.transfer),
        }
    }
}

impl Display for RateJudgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Yes => "yes",
            Self::Almost => "almost",
            Self::No => "NO",
        })
    }
}

/// The period of `rate` cycles per second.
fn period_of(rate: u32) -> Duration {
    let second = Duration::from_secs(1);
    second.checked_div(rate).unwrap_or(second)
}

impl RateVerdict {
    /// True if all measured cycles would have ended in time: [`RateJudgement::Yes`].
    pub fn is_kept(&self) -> bool {
        self.judgement == RateJudgement::Yes
    }
}

impl Display for RateVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if f.alternate() {
            write!(f, "{} Hz: {}; ", self.rate, self.judgement)?;
        }
        let micros = |time: Duration| time.as_nanos().div_ceil(1000);
        let period = period_of(self.rate);
        let (period_us, needs) = (micros(period), micros(self.needs));
        if self.cycles == 0 {
            return write!(f, "no cycle was measured: {} reads failed", self.failed);
        }
        if self.transfer >= period {
            let transfer = micros(self.transfer);
            return write!(f, "the transfers to the remotes alone take {transfer} us");
        }
        if self.late == 0 {
            write!(f, "no cycle needs more than {needs} us of {period_us}")?;
        } else if self.usually > period {
            let usually = micros(self.usually);
            write!(
                f,
                "half of all cycles need more than {usually} us of {period_us}: "
            )?;
            f.write_str("this host, or the network, is too slow")?;
        } else {
            let (late, cycles) = (self.late, self.cycles);
            write!(
                f,
                "{late} of {cycles} cycles need more than {period_us} us, "
            )?;
            write!(f, "the longest {needs}: the thread is not run in time; ")?;
            f.write_str("give it a real-time priority, a CPU of its own and locked memory")?;
        }
        if self.failed > 0 {
            write!(f, "; {} reads failed: no reply came in time", self.failed)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;
    use std::vec::Vec;

    use super::*;
    use crate::driver::Settings;
    use mesa_hal_sim::{Motor, machines};

    fn micros(micros: u64) -> Duration {
        Duration::from_micros(micros)
    }

    /// A measurement of cycles that used these times, in us.
    fn measured(times: impl IntoIterator<Item = u64>) -> Latency {
        let board = machines::i7i97(1);
        let driver = Driver::start(board, Settings::default()).expect("it starts");
        let mut latency = Latency::of(&driver);
        latency.transfer = micros(100);
        times
            .into_iter()
            .for_each(|time| latency.used.record(micros(time)));
        latency
    }

    fn judgements(latency: &Latency) -> Vec<RateJudgement> {
        let rates = [1000, 2000, 4000];
        rates.map(|rate| latency.verdict(rate).judgement).into()
    }

    #[test]
    fn rate_is_kept_if_the_longest_cycle_and_the_transfers_fit() {
        use RateJudgement::{No, Yes};
        for (longest, kept) in [
            (150, [Yes, Yes, Yes]),
            (151, [Yes, Yes, No]),
            (400, [Yes, Yes, No]),
            (401, [Yes, No, No]),
            (901, [No, No, No]),
        ] {
            assert_eq!(judgements(&measured([50, longest])), kept, "{longest} us");
        }
    }

    #[test]
    fn one_late_cycle_in_ten_thousand_is_almost() {
        use RateJudgement::{Almost, No};
        let times = |count: usize| core::iter::repeat_n(50, count - 1).chain([5000]);
        assert_eq!(judgements(&measured(times(10_000))), [Almost; 3]);
        assert_eq!(judgements(&measured(times(9_999))), [No; 3]);
        let said = measured(times(10_000)).verdict(1000).to_string();
        let wanted = "1 of 10000 cycles need more than 1000 us, the longest 5100: the thread is not \
                      run in time; give it a real-time priority, a CPU of its own and locked memory";
        assert_eq!(said, wanted);
    }

    #[test]
    fn reason_names_what_is_too_slow() {
        let mut slow = measured([300; 10]);
        let says = |latency: &Latency, rate, what: &str| {
            let said = latency.verdict(rate).to_string();
            assert!(said.contains(what), "{said}");
        };
        says(&slow, 1000, "no cycle needs more than 400 us of 1000");
        says(&slow, 4000, "half of all cycles need more than");
        slow.failed = 2;
        says(&slow, 1000, "2 reads failed");
        assert_eq!(slow.verdict(1000).judgement, RateJudgement::No);
        slow.transfer = micros(260);
        says(
            &slow,
            4000,
            "the transfers to the remotes alone take 260 us",
        );
        says(&measured([]), 1000, "no cycle was measured");
        assert_eq!(measured([]).verdict(1000).judgement, RateJudgement::No);
    }

    #[test]
    fn remotes_transfers_are_those_of_the_slowest_port() {
        let board = machines::six_axes_7i92(Motor::default());
        let driver = Driver::start(board, Settings::default()).expect("it starts");
        let expected = driver.ports()[0].expected_time.usual;
        assert_eq!(Latency::of(&driver).transfer(), expected);
        assert!(expected > micros(50), "{expected:?}");
    }
}
