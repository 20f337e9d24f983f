//! The thread of a cycle: its timing, its end, and its settings in the operating system.
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
//!             // If the cycle hangs or has ended, no value is valid.
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
//! The runner itself does not allocate, log or panic, and waits only for the next period. Its
//! timing is as good as that of its thread: the feature `realtime` provides priority over all other
//! threads, locked memory and a CPU of its own (`Realtime`; the page
//! `guides::realtime` describes further settings).

// Runs in the cycle.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod commands;
mod histogram;
mod latency;
mod pacer;
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
    COMMANDS_IN_A_CYCLE, CommandError, CommandOutcome, CommandQueue, CommandSender,
    CommandStatistics,
};
pub use histogram::{Distribution, Histogram};
pub use latency::{Latency, RateJudgement, RateVerdict};
pub use pacer::Pacer;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub use realtime::{Realtime, RealtimeError};
pub use scope::{
    Edge, MAX_SCOPE_CYCLES, MAX_SCOPE_PINS, Scope, ScopeError, ScopeRange, ScopeRow, ScopeState,
    Trigger,
};
pub use snapshot::{RemoteSnapshot, Snapshot, SnapshotError, SnapshotReader, SnapshotWriter};
#[cfg(feature = "realtime")]
pub use stop::{Signal, Stop};

use core::ops::ControlFlow;
use core::time::Duration;

use crate::bus::{Clock, Instant, RegisterBus};
#[cfg(doc)]
use crate::driver::Pace;
use crate::driver::{CycleError, CycleReport, Driver, StopError, Stopped};
use crate::hal::Pins;

/// Runs the cycle of a driver until the application, or a signal, ends it.
///
/// On a simulated board without a network in between (`mesa_hal_sim::machines`), time passes only
/// with accesses to its registers and with the runner's waiting: however long the application
/// takes, no cycle is late there, no period is skipped and no watchdog bites. To test overruns, use
/// a board behind a socket (`mesa sim`, or `mesa_hal_sim::UdpFace`), which runs in the time of this
/// computer.
///
/// Dropping the runner stops the driver as dropping the driver does: outputs and ports that could
/// not be stopped are only logged, whereas [`Ended`] returns them.
#[derive(Debug)]
pub struct Runner<B: RegisterBus + Clock> {
    driver: Driver<B>,
    pacer: Pacer,
    snapshot: Option<SnapshotWriter>,
    commands: Option<CommandQueue>,
    /// Limit of the wait for transfers.
    transfers: Option<Duration>,
    #[cfg(feature = "realtime")]
    stop: Option<Stop>,
}

/// One cycle, after its read, for the application's own work.
#[derive(Debug)]
#[non_exhaustive]
pub struct Cycle<'a, B: RegisterBus + Clock> {
    /// Number of cycles before this one.
    pub number: u64,
    /// Report of the read, or the reason why it failed: inputs are not valid then.
    pub read: Result<CycleReport, CycleError>,
    /// Error of the previous cycle's write, if it failed.
    pub write: Result<(), CycleError>,
    /// Start of the cycle, before its read.
    pub begun: Instant,
    /// Delay of the start after the planned time. Zero where the [board paces](Pace::Board).
    pub late: Duration,
    /// Duration of the previous cycle, from the start of its read to the end of its write; zero in
    /// the first. Where the [board paces](Pace::Board), it includes the wait for the board's clock:
    /// the unused part of the period is in [`CycleReport::slack`].
    pub took: Duration,
    /// Time since the previous cycle, in whole periods: [`Pacer::dt`].
    pub dt: Duration,
    /// Statistics of the previous cycles.
    pub statistics: RunStatistics,
    /// The driver, to re-arm or to inspect it. Reading, writing and stopping it is left to the
    /// runner.
    pub driver: &'a mut Driver<B>,
}

impl<B: RegisterBus + Clock> Cycle<'_, B> {
    /// The report of this cycle's read; `None` if it failed.
    pub fn report(&self) -> Option<CycleReport> {
        self.read.as_ref().ok().copied()
    }

    /// All pins and parameters.
    pub fn pins(&self) -> &Pins {
        self.driver.pins()
    }

    /// All pins and parameters, to set them.
    pub fn pins_mut(&mut self) -> &mut Pins {
        self.driver.pins_mut()
    }
}

/// Statistics of a runner. Times are those of the bus's clock: on an embedded simulator the
/// application takes none ([`Runner`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct RunStatistics {
    /// Cycles that were run.
    pub cycles: u64,
    /// Reads that failed.
    pub failed_reads: u64,
    /// Writes that failed.
    pub failed_writes: u64,
    /// Periods without a cycle, because the previous one took too long or the thread was not
    /// scheduled. Only where the [host paces](Pace::Host); otherwise see
    /// [`DriverStatistics::missed_periods`](crate::driver::DriverStatistics::missed_periods).
    pub skipped_periods: u64,
    /// Longest delay of a start after the planned time; zero where the [board paces](Pace::Board).
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub latest: Duration,
    /// Longest duration of a cycle, from the start of its read to the end of its write; includes
    /// the wait for the board's clock where the [board paces](Pace::Board).
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub longest: Duration,
    /// Delay of the last cycle's start after the planned time.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub last_late: Duration,
    /// Duration of the last cycle.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub last_took: Duration,
}

/// Result of a run: it is over, and the driver is stopped.
#[derive(Debug)]
#[non_exhaustive]
#[must_use = "outputs may not be off: see `stopped`"]
pub struct Ended<B: RegisterBus + Clock> {
    /// The stopped driver, for inspection: its statistics, the last values of its pins, its
    /// events. Can be turned back into the bus.
    pub driver: Stopped<B>,
    /// `Ok` if all outputs are safe and all ports stopped; otherwise those that are not, and the
    /// remotes whose outputs may still be on: see [`Driver::stop`].
    pub stopped: Result<(), StopError>,
    /// Statistics of the runner.
    pub statistics: RunStatistics,
    /// The signal that ended the run; `None` if the application ended it.
    #[cfg(feature = "realtime")]
    pub signal: Option<Signal>,
}

impl<B: RegisterBus + Clock> Runner<B> {
    /// A runner of a started driver, whose settings contain the period and the pace.
    pub fn new(driver: Driver<B>) -> Self {
        Self {
            pacer: Pacer::new(&driver),
            driver,
            snapshot: None,
            commands: None,
            transfers: None,
            #[cfg(feature = "realtime")]
            stop: None,
        }
    }

    /// Publishes all pins, states and statistics to other threads after the write of each cycle,
    /// and after the driver was stopped. Costs nothing unless requested.
    ///
    /// # Real time
    /// Set-up: allocates. For the cycle see [`SnapshotWriter`].
    pub fn snapshot(&mut self) -> SnapshotReader {
        let writer = self.snapshot.take();
        let writer = writer.unwrap_or_else(|| SnapshotWriter::new(&self.driver));
        self.snapshot.insert(writer).reader()
    }

    /// Takes commands of other threads in each cycle, after the read and before the application's
    /// own work. The queue holds `capacity` commands, 1 to 65,536; a second call returns another
    /// sender to the same queue.
    ///
    /// # Real time
    /// Set-up: allocates. For the cycle see [`CommandQueue`].
    pub fn commands(&mut self, capacity: usize) -> CommandSender {
        let queue = self.commands.take();
        let queue = queue.unwrap_or_else(|| CommandQueue::new(&self.driver, capacity));
        self.commands.insert(queue).sender()
    }

    /// Waits without using the CPU: cycles start later by the time that the kernel needs to wake a
    /// thread.
    ///
    /// Without it, the bus [waits](Clock::wait), and the host's clock is polled in the last 20 us.
    /// A thread with realtime priority, which is woken in time, spends up to that much CPU time in
    /// each cycle for it; a thread without is woken later than that, and spends none.
    #[must_use]
    pub fn sleeping(mut self) -> Self {
        self.pacer = self.pacer.sleeping();
        self
    }

    /// Waits after each write until the transfers that it started are complete, at most for
    /// `limit`, to measure their time: see [`Driver::wait_transfers`]. Not for a cycle that the
    /// [board paces](Pace::Board). Errors of the wait are left to the next read, and the wait is
    /// not part of a cycle's duration.
    #[must_use]
    pub fn waiting_for_transfers(mut self, limit: Duration) -> Self {
        self.transfers = Some(limit);
        self
    }

    /// Ends the run when a signal has arrived.
    #[cfg(feature = "realtime")]
    #[must_use]
    pub fn stop_on(mut self, stop: Stop) -> Self {
        self.stop = Some(stop);
        self
    }

    /// Runs cycles in the calling thread: read, `work`, write, and the wait for the next period,
    /// until `work` breaks or a signal arrives; then stops the driver. The first cycle starts
    /// immediately; a [`Pacer`] times the others.
    ///
    /// A failed read or write does not end the run: the driver makes all outputs safe after too
    /// many failures, and `work` decides.
    pub fn run(mut self, mut work: impl FnMut(&mut Cycle<'_, B>) -> ControlFlow<()>) -> Ended<B> {
        let mut write = Ok(());
        #[cfg(feature = "realtime")]
        let mut signal = None;
        loop {
            #[cfg(feature = "realtime")]
            if let Some(came) = self.stop.as_ref().and_then(Stop::signal) {
                signal = Some(came);
                break;
            }
            let read = self.read();
            let statistics = self.pacer.statistics();
            let flow = work(&mut Cycle {
                number: statistics.cycles,
                read,
                write: core::mem::replace(&mut write, Ok(())),
                begun: self.pacer.begun(),
                late: self.pacer.late(),
                took: statistics.last_took,
                dt: self.pacer.dt(),
                statistics,
                driver: &mut self.driver,
            });
            if flow.is_break() {
                break;
            }
            write = self.pacer.write(&mut self.driver);
            if let Some(limit) = self.transfers {
                let _ = self.driver.wait_transfers(limit);
            }
            self.publish();
        }
        Ended {
            #[cfg(feature = "realtime")]
            signal,
            ..self.end()
        }
    }

    /// Reads the board in the next period, and executes the commands of other threads.
    fn read(&mut self) -> Result<CycleReport, CycleError> {
        let read = self.pacer.read(&mut self.driver);
        if let Some(commands) = &mut self.commands {
            commands.take(&mut self.driver);
        }
        read
    }

    /// Shows the result of a cycle to other threads.
    fn publish(&mut self) {
        if let Some(commands) = &mut self.commands {
            // Faults that readers can see from here on must be known to senders of commands.
            commands.look(&self.driver);
        }
        if let Some(snapshot) = &mut self.snapshot {
            // The writer was made for this driver, so that it cannot refuse it.
            let _ = snapshot.publish_run(&self.driver, &self.pacer.statistics());
        }
    }

    /// Stops the driver, and notifies other threads of the end.
    fn end(mut self) -> Ended<B> {
        // Senders get an error from here on.
        drop(self.commands.take());
        let statistics = self.pacer.statistics();
        let (driver, stopped) = self.driver.stop();
        if let Some(mut snapshot) = self.snapshot.take() {
            // The last snapshot shows the state after the stop; then readers are notified of the
            // end.
            let _ = snapshot.publish_run(&driver, &statistics);
        }
        Ended {
            driver,
            stopped,
            statistics,
            #[cfg(feature = "realtime")]
            signal: None,
        }
    }
}
