//! The thread of a cycle: its pace, its end, and what it needs of the operating system.
//!
//! A [`Runner`] calls the application once in each period, between a read and a write:
//!
//! ```
//! use std::ops::ControlFlow;
//! use mesa_hal::{Driver, Settings, runner::Runner};
//! use mesa_hal_sim::machines;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let board = machines::six_axes_7i92(Default::default());
//! let driver = Driver::start(board, Settings::default())?;
//! let ended = Runner::new(driver).run(|cycle| match cycle.number {
//!     0..1000 => ControlFlow::Continue(()),
//!     _ => ControlFlow::Break(()),
//! });
//! ended.stopped?; // outputs off, ports stopped
//! assert_eq!(ended.statistics.failed_reads, 0);
//! # Ok(())
//! # }
//! ```
//!
//! A GUI, a logger or a scope in another thread takes [snapshots](SnapshotReader) of all pins and
//! [sends commands](CommandSender); neither delays the cycle:
//!
//! ```
//! # use std::ops::ControlFlow;
//! # use mesa_hal::{Driver, Settings, runner::Runner};
//! # use mesa_hal_sim::machines;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let board = machines::six_axes_7i92(Default::default());
//! # let driver = Driver::start(board, Settings::default())?;
//! let lamp = driver.pins().output::<bool>("hm2_7i92.0.7i77.0.0.output-00")?;
//! let mut runner = Runner::new(driver);
//! let (snapshots, commands) = (runner.snapshot(), runner.commands(64));
//! let gui = std::thread::spawn(move || {
//!     commands.set(lamp, true).expect("the queue is empty");
//!     while !snapshots.has_ended() {
//!         if let Ok(seen) = snapshots.read() {
//!             // Of a cycle that hangs or has ended nothing is valid.
//!             println!("cycle {}: lamp {:?}", seen.cycle(), seen.read(lamp).ok());
//!         }
//!         std::thread::sleep(std::time::Duration::from_millis(20));
//!     }
//! });
//! # let mut rest = 1_000_000;
//! let ended = runner.run(|cycle| {
//! #   rest -= 1;
//!     let is_lit = cycle.pins().commanded(lamp);
//!     if is_lit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
//! });
//! # ended.stopped?;
//! # gui.join().unwrap();
//! # Ok(())
//! # }
//! ```
//!
//! # Real time
//! The runner itself does not allocate, log, or panic, and waits only for the next period. What it is
//! worth depends on the thread: with the feature `realtime` one that is scheduled before all others,
//! with its memory locked, on a CPU of its own (`Realtime`; the page `runner::linux` says what else).

// The cycle runs it.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod commands;
mod histogram;
mod latency;
#[cfg(all(feature = "realtime", target_os = "linux"))]
#[doc = include_str!("../../docs/realtime.md")]
pub mod linux {}
mod packed;
#[cfg(all(feature = "realtime", target_os = "linux"))]
mod realtime;
mod scope;
mod snapshot;
#[cfg(feature = "realtime")]
mod stop;
#[cfg(test)]
mod tests;

pub use commands::{
    COMMANDS_IN_A_CYCLE, CommandError, CommandQueue, CommandSender, CommandStatistics,
};
pub use histogram::{Distribution, Histogram};
pub use latency::{Judgement, Latency, Verdict};
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub use realtime::{Realtime, RealtimeError};
pub use scope::{
    Edge, MAX_SCOPE_CYCLES, MAX_SCOPE_PINS, Scope, ScopeError, ScopeRow, ScopeState, Trigger,
};
pub use snapshot::{RemoteSnapshot, Snapshot, SnapshotError, SnapshotReader, SnapshotWriter};
#[cfg(feature = "realtime")]
pub use stop::{Signal, Stop};

use core::ops::ControlFlow;
use core::time::Duration;

use crate::bus::{Clock, Instant, RegisterBus};
use crate::driver::{CycleError, CycleReport, Driver, Pace, StopError, Stopped};
use crate::hal::Pins;
use crate::tally::Tally;

/// Runs the cycle of a driver until the application, or a signal, ends it.
///
/// On a simulated board without a network between (`mesa_hal_sim::machines`) time passes only
/// with accesses to its registers, and the runner's waiting: whatever the application takes, no cycle
/// is late there, no period is skipped and no watchdog bites. To try overruns, take one behind a socket
/// (`mesa sim`, or `mesa_hal_sim::UdpFace`), which runs in the time of this computer.
///
/// Dropping it stops the driver as dropping the driver does: what could not be stopped is only logged,
/// where [`Ended`] says it.
#[derive(Debug)]
pub struct Runner<B: RegisterBus + Clock> {
    driver: Driver<B>,
    statistics: RunStatistics,
    snapshot: Option<SnapshotWriter>,
    commands: Option<CommandQueue>,
    is_sleeping: bool,
    /// How long transfers are waited for.
    transfers: Option<Duration>,
    #[cfg(feature = "realtime")]
    stop: Option<Stop>,
}

/// One cycle, after its read: what an application does its own work on.
#[derive(Debug)]
pub struct Cycle<'a, B: RegisterBus + Clock> {
    /// Cycles before this one.
    pub number: u64,
    /// What the read brought, or why it brought nothing: inputs are not valid then.
    pub read: Result<CycleReport, CycleError<B::Error>>,
    /// Why the write of the cycle before failed, if it did.
    pub write: Result<(), CycleError<B::Error>>,
    /// When it began, before its read.
    pub begun: Instant,
    /// How much later than planned it began. Zero where the [board paces](Pace::Board).
    pub late: Duration,
    /// What the cycle before took, from the begin of its read to the end of its write; zero in the
    /// first. Where the [board paces](Pace::Board), with the wait for its clock: what was left of the
    /// period is in [`CycleReport::slack`].
    pub took: Duration,
    /// What was counted in the cycles before.
    pub statistics: RunStatistics,
    /// The driver, to re-arm it or to look at it. The runner reads, writes, and ends it.
    pub driver: &'a mut Driver<B>,
}

impl<B: RegisterBus + Clock> Cycle<'_, B> {
    /// All pins and parameters.
    pub fn pins(&self) -> &Pins {
        self.driver.pins()
    }

    /// All pins and parameters, to set them.
    pub fn pins_mut(&mut self) -> &mut Pins {
        self.driver.pins_mut()
    }
}

/// What a runner counts. Times are those of the bus's clock: on an embedded simulator the application
/// takes none ([`Runner`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct RunStatistics {
    /// Cycles that were run.
    pub cycles: u64,
    /// Reads that brought nothing.
    pub failed_reads: u64,
    /// Writes that failed.
    pub failed_writes: u64,
    /// Periods without a cycle, because the one before took too long or the thread was not run. Only
    /// where the [host paces](Pace::Host); else see
    /// [`DriverStatistics::missed_periods`](crate::driver::DriverStatistics::missed_periods).
    pub skipped_periods: u64,
    /// How much later than planned a cycle began at most; zero where the [board paces](Pace::Board).
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub latest: Duration,
    /// What a cycle took at most, from the begin of its read to the end of its write; with the wait for
    /// its clock where the [board paces](Pace::Board).
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub longest: Duration,
    /// How much later than planned the last cycle began.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub last_late: Duration,
    /// What the last cycle took.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub last_took: Duration,
}

/// A run that is over, and the driver stopped.
#[derive(Debug)]
#[non_exhaustive]
#[must_use = "outputs may not be off: see `stopped`"]
pub struct Ended<B: RegisterBus + Clock> {
    /// The driver, to be looked at: what it counted, its pins as they were last, its events, its
    /// trace. It gives the bus back.
    pub driver: Stopped<B>,
    /// All outputs are safe and all ports stopped; or what was not, and the remotes that may have an
    /// output on still: see [`Driver::stop`].
    pub stopped: Result<(), StopError<B::Error>>,
    /// What the runner counted.
    pub statistics: RunStatistics,
    /// The signal that ended it; `None`: the application did.
    #[cfg(feature = "realtime")]
    pub signal: Option<Signal>,
}

impl<B: RegisterBus + Clock> Runner<B> {
    /// Of a driver that was started. Its settings say the period, and who paces.
    pub fn new(driver: Driver<B>) -> Self {
        Self {
            driver,
            statistics: RunStatistics::default(),
            snapshot: None,
            commands: None,
            is_sleeping: false,
            transfers: None,
            #[cfg(feature = "realtime")]
            stop: None,
        }
    }

    /// Shows all pins, states and statistics to other threads after the write of each cycle, and when
    /// the driver was stopped. Who does not ask for it pays nothing.
    ///
    /// # Real time
    /// Set-up: allocates. For the cycle see [`SnapshotWriter`].
    pub fn snapshot(&mut self) -> SnapshotReader {
        let writer = self.snapshot.take();
        let writer = writer.unwrap_or_else(|| SnapshotWriter::new(&self.driver));
        self.snapshot.insert(writer).reader()
    }

    /// Takes commands of other threads in each cycle, after the read and before the application's own
    /// work. The queue holds `capacity` of them, 1 to 65,536; asked for again, it stays as it is.
    ///
    /// # Real time
    /// Set-up: allocates. For the cycle see [`CommandQueue`].
    pub fn commands(&mut self, capacity: usize) -> CommandSender {
        let queue = self.commands.take();
        let queue = queue.unwrap_or_else(|| CommandQueue::new(&self.driver, capacity));
        self.commands.insert(queue).sender()
    }

    /// Waits without using the CPU: cycles begin later by what the kernel needs to wake a thread.
    ///
    /// Otherwise it is the bus that [waits](Clock::wait), and the host's clock looks again and again in
    /// the last 20 us. A thread with realtime priority, which is woken in time, pays up to that much
    /// CPU in each cycle for it; one without is woken later than that, and pays nothing.
    #[must_use]
    pub fn sleeping(mut self) -> Self {
        self.is_sleeping = true;
        self
    }

    /// Waits after each write until the transfers that it started are complete, at most for `limit`,
    /// which measures them: see [`Driver::wait_transfers`]. Not where the [board paces](Pace::Board).
    /// What fails there is left to the next read, and no part of what a cycle takes.
    #[must_use]
    pub fn waiting_for_transfers(mut self, limit: Duration) -> Self {
        self.transfers = Some(limit);
        self
    }

    /// Ends when a signal has come.
    #[cfg(feature = "realtime")]
    #[must_use]
    pub fn stop_on(mut self, stop: Stop) -> Self {
        self.stop = Some(stop);
        self
    }

    /// Runs cycles in the calling thread: read, `work`, write, and the wait for the next period, until
    /// `work` breaks or a signal comes; then stops the driver.
    ///
    /// The first cycle begins at once. At the host's pace each of the others begins a whole number of
    /// periods after it, however long those before took: a late one does not delay the next, and a
    /// period that is over is skipped and counted.
    ///
    /// A read or a write that fails ends nothing: the driver makes everything safe when too many do,
    /// and `work` decides.
    pub fn run(mut self, mut work: impl FnMut(&mut Cycle<'_, B>) -> ControlFlow<()>) -> Ended<B> {
        let period = self.driver.period();
        let mut planned = self.driver.bus_mut().now();
        let mut write = Ok(());
        let mut took = Duration::ZERO;
        #[cfg(feature = "realtime")]
        let mut signal = None;
        loop {
            #[cfg(feature = "realtime")]
            if let Some(came) = self.stop.as_ref().and_then(Stop::signal) {
                signal = Some(came);
                break;
            }
            let begun = self.wait_until(planned);
            let late = match self.driver.pace() {
                Pace::Host => begun.since(planned),
                Pace::Board => Duration::ZERO,
            };
            let read = self.driver.read();
            self.statistics.failed_reads.tally(read.is_err().into());
            if let Some(commands) = &mut self.commands {
                commands.take(&mut self.driver);
            }
            let flow = work(&mut Cycle {
                number: self.statistics.cycles,
                read,
                write: core::mem::replace(&mut write, Ok(())),
                begun,
                late,
                took,
                statistics: self.statistics,
                driver: &mut self.driver,
            });
            if flow.is_break() {
                break;
            }
            write = self.driver.write();
            self.statistics.failed_writes.tally(write.is_err().into());
            let mut ended = self.driver.bus_mut().now();
            took = ended.since(begun);
            self.count(late, took);
            if let Some(limit) = self.transfers {
                let _ = self.driver.wait_transfers(limit);
                ended = self.driver.bus_mut().now();
            }
            if let Some(commands) = &mut self.commands {
                // What readers see from here on is known to who sends commands.
                commands.look(&self.driver);
            }
            if let Some(snapshot) = &mut self.snapshot {
                // It is of this driver, which is what it could refuse.
                let _ = snapshot.publish_run(&self.driver, &self.statistics);
            }
            planned = self.next(planned, ended, period);
        }
        // Nothing is taken any more.
        drop(self.commands.take());
        let (driver, stopped) = self.driver.stop();
        if let Some(mut snapshot) = self.snapshot.take() {
            // The last one shows what the stop has left; then readers learn that it was the last.
            let _ = snapshot.publish_run(&driver, &self.statistics);
        }
        Ended {
            driver,
            stopped,
            statistics: self.statistics,
            #[cfg(feature = "realtime")]
            signal,
        }
    }

    /// Returns when it is, or was, that time: the board's own clock is not waited for here.
    fn wait_until(&mut self, planned: Instant) -> Instant {
        let bus = self.driver.bus_mut();
        let now = bus.now();
        let rest = planned.since(now);
        if rest.is_zero() {
            return now;
        }
        if self.is_sleeping {
            bus.sleep(rest);
        } else {
            bus.wait(rest);
        }
        bus.now()
    }

    fn count(&mut self, late: Duration, took: Duration) {
        let statistics = &mut self.statistics;
        statistics.cycles.tally(1);
        statistics.latest = statistics.latest.max(late);
        statistics.longest = statistics.longest.max(took);
        (statistics.last_late, statistics.last_took) = (late, took);
    }

    /// When the next cycle begins.
    fn next(&mut self, planned: Instant, now: Instant, period: Duration) -> Instant {
        if self.driver.pace() == Pace::Board {
            return now;
        }
        let behind = now.since(planned).as_nanos();
        let behind = behind.checked_div(period.as_nanos()).unwrap_or(0);
        let skipped = u64::try_from(behind).unwrap_or(u64::MAX);
        self.statistics.skipped_periods.tally(skipped);
        let periods = u32::try_from(skipped.saturating_add(1)).unwrap_or(u32::MAX);
        planned.after(period.saturating_mul(periods))
    }
}
