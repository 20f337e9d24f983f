//! Stopping: outputs off, ports stopped, watchdog bitten.

use alloc::vec::Vec;
use core::fmt;
use core::ops::Deref;
use core::time::Duration;

use super::{BoardState, CycleError, Driver, DriverError, RemoteState, RemoteWatchdog, SerialPort};
use crate::advice::{self, Advice, MesaError};
use crate::bus::{Clock, Instant, RegisterBus};
use crate::sslbp::{PortError, RemoteLabel};

/// Attempts of the last transfer: over a network one packet may be lost.
const LAST_TRIES: u32 = 3;
/// Time for a command in flight: a START waits 17 ms for a remote that does not answer (FACTS 5.7).
const LAST_COMMAND: Duration = Duration::from_millis(20);
/// Ends the waiting on a bus whose clock stands still.
const MAX_CYCLES: u32 = 1000;
/// Time for the last transfer, which switches the remotes' outputs off.
const LAST_TRANSFER: Duration = Duration::from_millis(2);

/// A stopped driver, for inspection: its statistics, its pins in their last state and its events.
/// Without access to its board.
#[derive(Debug)]
pub struct Stopped<B: RegisterBus + Clock>(Driver<B>);

impl<B: RegisterBus + Clock> Stopped<B> {
    /// Gives the bus back.
    pub fn into_bus(mut self) -> B {
        self.0.bus.take()
    }
}

impl<B: RegisterBus + Clock> Deref for Stopped<B> {
    type Target = Driver<B>;

    fn deref(&self) -> &Driver<B> {
        &self.0
    }
}

/// The parts of a driver that could not be stopped. All others are stopped.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct StopError {
    /// The first step that failed. The outputs of the board itself are off by its watchdog.
    pub failed: Option<PortError>,
    /// The remotes that may still have an output on.
    pub not_reached: Vec<NotReached>,
}

impl fmt::Display for StopError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut between = "";
        if let Some(failed) = &self.failed {
            let own = "the board's own outputs are off by its watchdog";
            write!(f, "not all of it could be stopped: {failed}; {own}")?;
            between = "; ";
        }
        for remote in &self.not_reached {
            write!(f, "{between}{remote}")?;
            between = "; ";
        }
        Ok(())
    }
}

impl core::error::Error for StopError {}

impl MesaError for StopError {
    /// The next step, if there is one: that of the first remote with one, because its outputs may
    /// be on; else that of the step that failed.
    fn advice(&self) -> Option<Advice> {
        let mut remotes = self.not_reached.iter();
        let remote = remotes.find_map(NotReached::advice);
        remote.or_else(|| self.failed.as_ref()?.advice())
    }

    /// That of the step that failed.
    fn further_advice(&self) -> Option<Advice> {
        self.failed.as_ref()?.advice()
    }
}

/// A remote that may have an output on when the driver was stopped: it has not confirmed its safe
/// values, and its own watchdog, which switches the outputs off, is not known to have bitten yet.
/// Remotes that have not started, were not driven, or have had no frame for longer than the
/// watchdog's time, are not included: because they were offline, or because the board was not fed
/// and its own watchdog has bitten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct NotReached {
    /// The remote.
    pub remote: RemoteLabel,
    /// The watchdog of the remote.
    pub watchdog: RemoteWatchdog,
}

impl fmt::Display for NotReached {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { remote, watchdog } = self;
        write!(f, "{remote} was not reached: ")?;
        let usual = RemoteWatchdog::USUAL.as_millis();
        match watchdog {
            RemoteWatchdog::Known(time) => write!(
                f,
                "its outputs are off only by its own watchdog, {} ms later",
                time.as_millis()
            ),
            RemoteWatchdog::Assumed => write!(
                f,
                "its outputs are off only by its own watchdog, which is not known ({usual} ms as delivered)"
            ),
            RemoteWatchdog::Off => f.write_str(
                "its own watchdog is off, or has not bitten when it should have, so an output that was on stays on",
            ),
        }
    }
}

impl core::error::Error for NotReached {}

impl MesaError for NotReached {
    fn advice(&self) -> Option<Advice> {
        match self.watchdog {
            RemoteWatchdog::Off => Some(advice::SWITCH_OFF_POWER),
            RemoteWatchdog::Known(_) | RemoteWatchdog::Assumed => None,
        }
    }
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Stops: safe values to all outputs, every port stopped, all pins inputs, and the watchdog
    /// bites, so that the board drives nothing. Returns the bus.
    ///
    /// Every step is tried, whatever the result of the steps before. Dropping the driver does the
    /// same, but cannot return anything: parts that could not be stopped are reported in the `log`,
    /// if there is one.
    ///
    /// # Errors
    /// [`StopError`]: the first error of all steps, and the remotes that were not reached. An
    /// output of these may be on: until their own watchdogs bite, or for ever where those are off.
    ///
    /// # Real time
    /// Not for the cycle. Bounded: 20 ms where a remote is being restarted, some milliseconds for
    /// each port, or the bus's own time-outs.
    pub fn shutdown(self) -> (B, Result<(), StopError>) {
        let (stopped, result) = self.stop();
        (stopped.into_bus(), result)
    }

    /// Stops like [`shutdown`](Self::shutdown), and keeps the driver for inspection.
    ///
    /// # Errors
    /// As [`shutdown`](Self::shutdown).
    ///
    /// # Real time
    /// As [`shutdown`](Self::shutdown).
    pub fn stop(mut self) -> (Stopped<B>, Result<(), StopError>) {
        let result = self.stop_all();
        (Stopped(self), result)
    }

    fn not_reached(&self, now: Instant) -> impl Iterator<Item = NotReached> {
        let parts = &self.cycle.parts;
        let silent_since = parts.watchdog.bitten_by();
        parts.ports.iter().flat_map(move |port| {
            port.not_reached(now, silent_since)
                .map(move |remote| NotReached {
                    remote: remote.label,
                    watchdog: remote.watchdog,
                })
        })
    }

    fn stop_all(&mut self) -> Result<(), StopError> {
        if core::mem::replace(&mut self.is_stopped, true) {
            return Ok(());
        }
        let stopped = if self.answers_as_another() {
            self.bus.keep_off();
            Ok(())
        } else {
            self.stop_board()
        };
        let now = self.bus.now();
        self.cycle.end(now);
        let failed = stopped.err();
        let not_reached: Vec<_> = self.not_reached(now).collect();
        if failed.is_none() && not_reached.is_empty() {
            return Ok(());
        }
        Err(StopError {
            failed,
            not_reached,
        })
    }

    fn stop_board(&mut self) -> Result<(), PortError> {
        let mut first = self.last_transfer();
        for _ in 1..LAST_TRIES {
            // A running remote may have missed a transfer.
            let now = self.bus.now();
            let mut ports = self.cycle.parts.ports.iter();
            let missed = |port: &SerialPort| {
                let mut missed = port.not_reached(now, None);
                missed.any(|remote| remote.state == RemoteState::Running)
            };
            if first.is_err() || self.cycle.is_running() && ports.any(missed) {
                first = self.last_transfer();
            }
        }
        for port in &mut self.cycle.parts.ports {
            let stopped = port.port.on(&mut self.bus).stop_all();
            first = first.and(stopped);
        }
        let released = self.bus.release().map_err(PortError::Bus);
        first.and(released)
    }

    /// True if another board, or no HostMot2, answers: such a board has watchdogs of its own, and
    /// must not be written to. A running board is the same one.
    fn answers_as_another(&mut self) -> bool {
        if !self.cycle.is_running() {
            let now = self.bus.now();
            let identification = self.cycle.begin_identification(now);
            if let Err(CycleError::NotThere { .. }) = self.run(identification) {
                return true;
            }
        }
        self.cycle.state() == BoardState::OtherFirmware
    }

    /// Switches everything off, and makes sure that the board has received it: only then may the
    /// board do without its usual watchdog time.
    pub(super) fn all_off(&mut self) -> Result<(), DriverError> {
        for _ in 0..LAST_TRIES {
            self.last_transfer()?;
            if !self.cycle.is_running() {
                return Err(DriverError::NotRunning {
                    state: self.cycle.state(),
                });
            }
            // The last read has confirmed the last write.
            if self.cycle.is_sure() {
                return Ok(());
            }
        }
        Err(DriverError::NotConfirmed)
    }

    /// Sends safe values to all remotes, so that their outputs go off without their own watchdogs.
    pub(super) fn last_transfer(&mut self) -> Result<(), PortError> {
        self.cycle.is_last = true;
        let result = self.transfer_safe_values();
        self.cycle.is_last = false;
        match result {
            Ok(()) | Err(CycleError::NotThere { .. } | CycleError::OtherFirmware) => Ok(()),
            Err(CycleError::Read { source, .. } | CycleError::Write { source, .. }) => {
                Err(PortError::Bus(source))
            }
        }
    }

    fn transfer_safe_values(&mut self) -> Result<(), CycleError> {
        let begin = self.bus.now();
        self.cycle.make_safe();
        // A failing wait fails again in the following read, which returns the error.
        let _ = self.wait_ports(LAST_TRANSFER, SerialPort::poll);
        for _ in 0..MAX_CYCLES {
            let _ = self.read()?;
            // A port that is not idle gets nothing; the board's own outputs go off at once.
            let mut ports = self.cycle.parts.ports.iter();
            let all_idle = ports.all(|port| port.is_idle(&self.cycle.words));
            self.cycle.make_safe();
            self.write()?;
            if all_idle || self.bus.now().since(begin) >= LAST_COMMAND {
                break;
            }
            let pause = self.pacer.period.min(LAST_COMMAND);
            let _ = self.wait_ports(pause, |port, words, _| port.is_idle(words));
        }
        // Takes the faults in the replies; the values were sent whatever this read returns.
        let _ = self.wait_ports(LAST_TRANSFER, SerialPort::poll);
        let _ = self.read();
        Ok(())
    }
}

impl<B: RegisterBus + Clock> Drop for Driver<B> {
    fn drop(&mut self) {
        if self.is_stopped {
            return;
        }
        // An error can only be logged here; the watchdogs make the machine safe.
        let result = self.stop_all();
        #[cfg(feature = "log")]
        if let Err(error) = &result {
            let error = error.with_advice();
            log::error!(target: "mesa_hal", "{}: was dropped: {error}", self.name());
        }
        #[cfg(not(feature = "log"))]
        let _ = result;
    }
}
