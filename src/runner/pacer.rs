//! Pacing of a loop: its grid of start times, and what each cycle took.

use core::time::Duration;

use super::RunStatistics;
use crate::bus::{Clock, Instant, RegisterBus};
use crate::driver::{CycleError, CycleReport, Driver, Pace};
use crate::tally::Tally;

/// Paces the loop of a driver, as a [`Runner`](super::Runner) does: for an application with a loop
/// of its own. [`read`](Self::read) waits for the next period, and [`write`](Self::write) ends the
/// cycle.
///
/// At the host's pace a cycle starts a whole number of periods after the first one, however long
/// the earlier ones took: a late cycle does not delay the next, and a period that is over is
/// skipped and counted. Where the [board paces](Pace::Board), the read of the driver waits for the
/// board's clock, and nothing is waited for here.
///
/// For several boards whose requests are under way at the same time, [`wait`](Self::wait) is
/// separate from the read: see [several boards](crate::guides::several_boards).
///
/// ```
/// use mesa_hal::{Driver, Settings, runner::Pacer};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = machines::six_axes_7i92(Default::default());
/// let mut driver = Driver::start(board, Settings::default())?;
/// let mut pacer = Pacer::new(&driver);
/// let mut position = 0.0; // a trajectory at 10 units/s
/// for _ in 0..100 {
///     let report = pacer.read(&mut driver)?;
///     position += 10.0 * pacer.dt().as_secs_f64();
///     # let _ = report;
///     // ... the application's own work on the pins
///     pacer.write(&mut driver)?;
/// }
/// assert!((position - 1.0_f64).abs() < 1e-9);
/// assert_eq!(pacer.statistics().skipped_periods, 0);
/// driver.shutdown().1?;
/// # Ok(())
/// # }
/// ```
///
/// # Real time
/// Does not allocate; waits only for the next period.
#[derive(Clone, Debug)]
pub struct Pacer {
    pace: Pace,
    period: Duration,
    is_sleeping: bool,
    /// The planned start of this cycle; `None` before the first.
    planned: Option<Instant>,
    begun: Instant,
    late: Duration,
    /// Periods of this cycle.
    periods: u64,
    /// Periods that were skipped before a cycle that has been waited for, and not been read yet.
    waited: Option<u64>,
    /// Cycles since the last good read, whose periods the board counts once more.
    failed: u64,
    statistics: RunStatistics,
}

impl Pacer {
    /// The pacer of a driver, whose settings contain the period and the pace. The first cycle
    /// starts with the first call of [`read`](Self::read).
    pub fn new<B: RegisterBus + Clock>(driver: &Driver<B>) -> Self {
        Self {
            pace: driver.pace(),
            period: driver.period(),
            is_sleeping: false,
            planned: None,
            begun: Instant::default(),
            late: Duration::ZERO,
            periods: 1,
            waited: None,
            failed: 0,
            statistics: RunStatistics::default(),
        }
    }

    /// Waits without using the CPU: cycles start later by the time that the kernel needs to wake a
    /// thread. See [`Runner::sleeping`](super::Runner::sleeping).
    #[must_use]
    pub fn sleeping(mut self) -> Self {
        self.is_sleeping = true;
        self
    }

    /// Waits for the next period, and nothing else: the [`read`](Self::read) after it does not wait
    /// any more. Between them, an application with several boards sends all requests
    /// ([`Driver::request_read`]).
    ///
    /// # Real time
    /// Waits for the next period; not where the [board paces](Pace::Board).
    pub fn wait<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) {
        self.waited = Some(self.begin(driver.bus_mut()));
    }

    /// Waits for the next period, unless that [has been done](Self::wait), and
    /// [reads](Driver::read) the board.
    ///
    /// # Errors
    /// Those of [`Driver::read`]. The cycle has begun nevertheless.
    ///
    /// # Real time
    /// Waits for the next period; then as [`Driver::read`].
    pub fn read<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
    ) -> Result<CycleReport, CycleError> {
        let skipped = match self.waited.take() {
            Some(skipped) => skipped,
            None => self.begin(driver.bus_mut()),
        };
        let read = driver.read();
        if let Ok(report) = &read {
            // The board counts all periods since the last good read.
            let missed = report.missed_periods.saturating_sub(self.failed);
            self.failed = 0;
            self.periods = skipped.max(missed).saturating_add(1);
        } else {
            self.failed.tally((self.pace == Pace::Board).into());
            self.statistics.failed_reads.tally(1);
            self.periods = skipped.saturating_add(1);
        }
        read
    }

    /// [Writes](Driver::write) the outputs, and ends the cycle.
    ///
    /// # Errors
    /// Those of [`Driver::write`]. The cycle has ended nevertheless.
    ///
    /// # Real time
    /// As [`Driver::write`].
    pub fn write<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
    ) -> Result<(), CycleError> {
        let written = driver.write();
        let took = driver.bus_mut().now().since(self.begun);
        let statistics = &mut self.statistics;
        statistics.failed_writes.tally(written.is_err().into());
        statistics.cycles.tally(1);
        statistics.latest = statistics.latest.max(self.late);
        statistics.longest = statistics.longest.max(took);
        (statistics.last_late, statistics.last_took) = (self.late, took);
        written
    }

    /// Time since the previous cycle, in whole periods: what a trajectory or an integrator advances
    /// by in this cycle. A period, and more after periods without a cycle; a period in the first
    /// cycle.
    ///
    /// At the host's pace these are the periods that were skipped. Where the [board
    /// paces](Pace::Board), they are the periods of its clock without a good read, apart from those
    /// in which the read of a cycle failed: over many cycles the sum is the time that has passed.
    pub fn dt(&self) -> Duration {
        let periods = u32::try_from(self.periods).unwrap_or(u32::MAX);
        self.period.saturating_mul(periods)
    }

    /// Start of this cycle, before its read.
    pub const fn begun(&self) -> Instant {
        self.begun
    }

    /// Delay of the start after the planned time; zero where the [board paces](Pace::Board).
    pub const fn late(&self) -> Duration {
        self.late
    }

    /// Statistics of all cycles that have ended, as those of a runner: for
    /// [`SnapshotWriter::publish_run`](super::SnapshotWriter::publish_run).
    pub const fn statistics(&self) -> RunStatistics {
        self.statistics
    }

    /// Waits for the planned start of the next cycle; returns the number of skipped periods.
    fn begin<B: Clock>(&mut self, bus: &mut B) -> u64 {
        let now = bus.now();
        let (planned, skipped) = self.next(now);
        self.planned = Some(planned);
        let rest = planned.since(now);
        self.begun = if rest.is_zero() {
            now
        } else {
            if self.is_sleeping {
                bus.sleep(rest);
            } else {
                bus.wait(rest);
            }
            bus.now()
        };
        self.late = self.begun.since(planned);
        skipped
    }

    /// The planned start of the next cycle, and the number of periods before it without one.
    fn next(&mut self, now: Instant) -> (Instant, u64) {
        let (Pace::Host, Some(planned)) = (self.pace, self.planned) else {
            return (now, 0);
        };
        debug_assert!(!self.period.is_zero(), "refused at the start");
        let behind = now.since(planned).as_nanos();
        let behind = behind.checked_div(self.period.as_nanos()).unwrap_or(0);
        let skipped = u64::try_from(behind).unwrap_or(u64::MAX);
        self.statistics.skipped_periods.tally(skipped);
        let periods = u32::try_from(skipped.saturating_add(1)).unwrap_or(u32::MAX);
        (planned.after(self.period.saturating_mul(periods)), skipped)
    }
}
