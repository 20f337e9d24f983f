//! Cycles that a `Runner` runs, and their end.

use std::ops::ControlFlow;
use std::time::Duration;

use mesa_hal::driver::Pace;
use mesa_hal::runner::{Cycle, RunStatistics, Runner};

use super::super::application::Application;
use super::super::network::{Host, Life};
use super::super::oracle::{Checked, Promise, ensure};
use super::{Process, Scenario};

/// The application's own counts in the cycles of a runner.
#[derive(Debug, Default)]
struct Seen {
    calls: u64,
    failed_reads: u64,
    failed_writes: u64,
    /// Planned time of the first cycle.
    first: Option<u64>,
    was_well: bool,
}

impl Scenario {
    /// Lets a runner run the cycles up to `end`, or until the process is to be killed. The runner
    /// stops the driver in order.
    pub(super) fn runs<B: Host>(&mut self, process: Process<B>, end: u64) -> Checked {
        let Process {
            driver,
            mut application,
            life,
        } = process;
        self.stage.tell(self.sim.now(), "a runner takes over");
        let mut runner = Runner::new(driver);
        if self.plan.extras.reads_ahead {
            runner = runner.waiting_for_transfers(Duration::from_nanos(self.plan.period / 4));
        }
        let snapshots = runner.snapshot();
        let (mut seen, mut checked) = (Seen::default(), Ok(()));
        let ended = runner.run(|cycle| {
            checked = self.run_cycle(cycle, (&mut application, &life), &mut seen);
            let is_over = checked.is_err() || self.sim.now() >= end || self.kill_is_due();
            if is_over {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        checked?;
        let now = self.sim.now();
        let RunStatistics {
            cycles,
            failed_reads,
            failed_writes,
            ..
        } = ended.statistics;
        let found = (cycles + 1, failed_reads, failed_writes);
        let expected = (seen.calls, seen.failed_reads, seen.failed_writes);
        ensure(found == expected, Promise::Told, now, || {
            format!("{expected:?} cycles, failed reads and writes, but the runner counts {found:?}")
        })?;
        let shown = snapshots.read();
        let is_over = snapshots.has_ended() && shown.is_ok_and(|shown| !shown.is_fresh());
        ensure(is_over, Promise::Told, now, || {
            "a run that has ended is shown as one that goes on".to_owned()
        })?;
        let left = ended.stopped.err();
        let left = left.map_or_else(Vec::new, |error| error.not_reached);
        drop(ended.driver);
        self.oracle.no_commands(now);
        self.has_stopped(&application, Some(&left), seen.was_well)?;
        self.all_goes_off(&application, Some(&left))
    }

    fn run_cycle<B: Host>(
        &mut self,
        cycle: &mut Cycle<'_, B>,
        (application, life): (&mut Application, &Life),
        seen: &mut Seen,
    ) -> Checked {
        let now = self.sim.now();
        let (begun, late) = (cycle.begun.as_nanos(), cycle.late.as_nanos() as u64);
        let first = *seen.first.get_or_insert(begun - late);
        let passed = (cycle.number + cycle.statistics.skipped_periods) * self.plan.period;
        let is_on_time = begun == first + passed + late || self.plan.pace == Pace::Board;
        ensure(is_on_time, Promise::Works, now, || {
            format!(
                "cycle {} began at {begun}, not {passed} after {first}",
                cycle.number
            )
        })?;
        let report = cycle.read.as_ref().ok().copied();
        seen.calls += 1;
        seen.failed_reads += u64::from(report.is_none());
        if cycle.number > 0 {
            seen.failed_writes += u64::from(cycle.write.is_err());
            self.what_is_told.written(cycle.write.is_ok());
        }
        let driver = &mut *cycle.driver;
        application.notice(driver);
        self.host_faults(life, true);
        self.look()?;
        self.after_read((driver, application, life), (report, begun), true)?;
        self.told_truly(driver, application)?;
        self.stands_now(driver, application)?;
        self.before_read(driver, true);
        seen.was_well = application.all_is_well(driver).is_ok();
        Ok(())
    }
}
