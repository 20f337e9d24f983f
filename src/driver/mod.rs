//! The cycle: `read()` and `write()` on a planned image, faults, recovery, statistics.
//!
//! A [`Board`] is configured once, which discovers its firmware and remotes and sets them up; it is
//! started as a [`Driver`] on the planned registers of a cycle. Then the application does the
//! following, once in each period:
//!
//! 1. [`Driver::read`]: one exchange. It is validated as a whole before any pin changes; then each
//!    part of the board takes its inputs.
//! 2. its own work on [`Driver::pins`] and [`Driver::pins_mut`];
//! 3. [`Driver::write`]: each part puts its outputs; one exchange, with DOIT after all data.
//!
//! The application waits for the next period between the write and the next read, or lets the board
//! do that: [`Pace::Board`].
//!
//! The order is the manual's "cyclic access with write before read": a read delivers the replies to
//! the last write. For read-modify-write call [`Driver::wait_transfers`] between `write` and
//! `read`.
//!
//! # Faults and their effects
//! A summary; all faults in detail are in [`guides::faults`](crate::guides::faults).
//! - A transfer of a remote: its inputs are not taken, become invalid, and grow older. After too
//!   many failures the remote goes offline alone, its outputs are safe, and it is tried again with
//!   growing pauses, in small steps inside the cycle. See [`RemoteState`], [`FaultPolicy`].
//! - A remote reports a fault: it goes offline at once and gets no frame, so that its own watchdog
//!   switches all its outputs off, and it is started again afterwards. See [`FaultPolicy`],
//!   [`RemoteStatus::faults`], [`RemoteStatus::first_fault`].
//! - The bus: no input is taken; when it fails too often, everything is safe. See
//!   [`Settings::bus_error_limit`].
//! - The board's watchdog bites, or the board is reset: everything is safe. See [`BoardState`].
//!
//! Outputs that became safe stay so until the application re-arms them: one remote with
//! [`Pins::rearm`](crate::hal::Pins::rearm), everything with [`Driver::rearm`].
//!
//! # Real time
//! `read` and `write` do one exchange each, bounded in time by the bus; the rest is proportional to
//! the words of process data. Both do not allocate, log, or panic, and do not wait, except `read`
//! for the next period of a board that paces.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod arrival;
mod attach;
mod configure;
mod connection;
mod cycle;
mod discovered;
mod error;
mod exchange;
mod found;
mod listen;
#[cfg(feature = "log")]
mod messages;
mod own_pins;
mod pace;
mod parameters;
mod parts;
mod period;
mod plan;
mod recovery;
mod remark;
mod remotes;
mod report;
mod rows;
mod safe_bus;
mod settings;
mod setup_line;
mod stop;
mod watchdogs;

pub use crate::ParseError;
pub use crate::events::{
    BoardState, CorrectedValue, CycleReport, Event, EventKind, EventMask, Events, OfflineReason,
    Positions, Repeating,
};
pub use crate::modules::gpio::GpioConfig;
pub use crate::modules::serial::{
    Failure, FailureCounts, PortStatistics, RemotePart, RemoteState, RemoteStatus, RemoteWatchdog,
    SerialPort, TimeHistogram,
};
pub use crate::settings::{
    Defaults, FaultPolicy, Pace, Presence, PwmConfig, RemoteConfig, SerialConfig, Settings,
};
pub use configure::{Board, Configured};
pub use error::{CycleError, DriverError};
pub use listen::Listener;
pub use plan::Plan;
pub use remark::silent_part;
pub use remark::{Remark, RemarkKind};
pub use report::{DriverStatistics, Rearmed};
pub use stop::{NotReached, StopError, Stopped};

use alloc::{string::String, vec::Vec};
use core::time::Duration;

use crate::bus::{BusLayer, BusStatistics, Clock, CycleLists, Exchanges, RegisterBus};
use crate::hal::{GroupId, Pins};
use crate::hostmot2::{FirmwareCheck, HostMot2};
use crate::modules::Module;
use cycle::BoardCycle;
use pace::ExchangePacer;
use safe_bus::SafeBus;

/// A board with all its parts, in the cycle.
///
/// # Calls and their order
/// - **The cycle**, once in each period: [`read`](Self::read), the application's own work,
///   [`write`](Self::write). Between the write and the next read, where they are needed:
///   [`wait_transfers`](Self::wait_transfers), then [`request_read`](Self::request_read).
/// - **Around a fault**, between two cycles: [`rearm`](Self::rearm) or
///   [`rearm_when_running`](Self::rearm_when_running), [`restore`](Self::restore),
///   [`restart`](Self::restart); and [`follow`](Self::follow) in place of a cycle.
/// - **Before the first write**: [`set_period`](Self::set_period).
/// - **Maintenance**, after which the cycle continues at once and is re-armed:
///   [`write_remote_parameter`](Self::write_remote_parameter),
///   [`prove_watchdogs`](Self::prove_watchdogs).
/// - **The end**: [`stop`](Self::stop) or [`shutdown`](Self::shutdown), once.
///
/// Everything else only looks, and may be called at any time: pins, modules, states, statistics,
/// [`events`](Self::events).
///
/// End it with [`stop`](Self::stop) or [`shutdown`](Self::shutdown), which return what could not be
/// stopped: outputs of a remote that was [not reached](NotReached) may stay on. Dropping the driver
/// does the same, and only logs the result.
#[derive(Debug)]
pub struct Driver<B: RegisterBus + Clock> {
    bus: SafeBus<B>,
    firmware: HostMot2,
    name: String,
    exchanges: Exchanges,
    cycle: BoardCycle,
    /// The firmware's description of itself, as read when it was set up.
    description: FirmwareCheck,
    missing: Vec<Remark>,
    remarks: Vec<Remark>,
    pacer: ExchangePacer,
    is_stopped: bool,
}

/// Functions for applications.
impl<B: RegisterBus + Clock> Driver<B> {
    /// Discovers firmware and remotes, sets the board up, starts the remotes and plans the cycle:
    /// [`Board::identify`] and [`Board::start`], for applications that need nothing between them.
    ///
    /// # Errors
    /// [`DriverError`]. Everything that was started is stopped again.
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn start(bus: B, settings: Settings) -> Result<Self, DriverError> {
        Board::identify(bus, settings)?.start()
    }

    /// All pins and parameters.
    pub fn pins(&self) -> &Pins {
        &self.cycle.pins
    }

    /// All pins and parameters, for setting them.
    pub fn pins_mut(&mut self) -> &mut Pins {
        &mut self.cycle.pins
    }

    /// The modules of a kind, in the order in which they were added, for access to the pins of
    /// built-in modules. [`Board::add`] returns those of your own.
    ///
    /// ```no_run
    /// # fn pins(driver: &mesa_hal::Driver<mesa_hal_sim::SimFpga>) {
    /// use mesa_hal::modules::led::Leds;
    /// let leds = driver.modules::<Leds>().next().map(|module| &module.leds);
    /// # }
    /// ```
    pub fn modules<M: Module>(&self) -> impl Iterator<Item = &M> {
        self.cycle.parts.of()
    }

    /// The group of the board's own pins.
    pub fn group(&self) -> GroupId {
        self.cycle.group
    }

    /// Prefix of the names of the board's pins, for example `hm2_7i92.0`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The period of the cycle, as planned.
    pub fn period(&self) -> Duration {
        self.pacer.period
    }

    /// The source of the cycle's timing.
    pub fn pace(&self) -> Pace {
        self.pacer.pace
    }

    /// The description of the board's firmware.
    pub fn firmware(&self) -> &HostMot2 {
        &self.firmware
    }

    /// The serial ports.
    pub fn ports(&self) -> &[SerialPort] {
        &self.cycle.parts.ports
    }

    /// Remotes that were configured and do not take part, with the reason.
    pub fn missing(&self) -> &[Remark] {
        &self.missing
    }

    /// Remarks about the remotes that run: differences from the built-in tables of their kind, and
    /// problems of their tables that do not keep them from running.
    pub fn remarks(&self) -> &[Remark] {
        &self.remarks
    }

    /// State of the board itself.
    pub fn board_state(&self) -> BoardState {
        self.cycle.state()
    }

    /// The statistics so far.
    pub fn statistics(&self) -> DriverStatistics {
        self.cycle.statistics
    }

    /// The statistics of the bus so far: packets that were late, lost or not the board's.
    pub fn bus_statistics(&self) -> BusStatistics {
        self.bus().statistics()
    }

    /// The driver's events: for this thread between two cycles, or for another one.
    ///
    /// ```
    /// # use mesa_hal::{Clock, Driver, Settings};
    /// # use mesa_hal_sim::machines;
    /// # let bus = machines::six_axes_7i92(Default::default());
    /// let mut driver = Driver::start(bus, Settings::default())?;
    /// let mut events = driver.events();
    /// let logger = std::thread::spawn(move || {
    ///     let mut lines = Vec::new();
    ///     loop {
    ///         let is_last = events.has_ended(); // before the last events are taken
    ///         // cycle 5021, 5.020113 s: 7i77.0.1: ...
    ///         lines.extend(events.by_ref().map(|event| event.to_string()));
    ///         if is_last {
    ///             return lines;
    ///         }
    ///         std::thread::sleep(std::time::Duration::from_millis(20));
    ///     }
    /// });
    /// # for cycle in 0..100 {
    /// #     let _ = driver.read()?;
    /// #     driver.write()?;
    /// #     let is_stall = cycle == 50; // the watchdog bites
    /// #     let pause = driver.period() * if is_stall { 50 } else { 1 };
    /// #     driver.bus_mut().wait(pause);
    /// # }
    /// // ... the cycle, in this thread
    /// driver.shutdown().1?;
    /// let lines = logger.join().expect("it ends with the driver");
    /// # assert!(lines[0].contains("watchdog has bitten"), "{lines:?}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Real time
    /// Constant time. No allocation.
    pub fn events(&self) -> Events {
        self.cycle.events.events()
    }

    /// The lists of accesses of a cycle, for inspection.
    pub fn lists(&self) -> CycleLists<'_> {
        self.exchanges.lists()
    }

    /// The bus.
    pub fn bus(&self) -> &B {
        self.bus.inner()
    }

    /// The bus, for example to let its time pass. Do not write to the board's registers.
    pub fn bus_mut(&mut self) -> &mut B {
        self.bus.inner_mut()
    }
}
