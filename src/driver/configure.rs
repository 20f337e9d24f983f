//! From a bus to a driver: identification, set-up, planning of the cycle.

use alloc::{boxed::Box, vec::Vec};
use core::any::Any;
use core::ops::Deref;

use super::arrival::ArrivalClock;
use super::connection::Connection;
use super::cycle::BoardCycle;
use super::pace::ExchangePacer;
use super::parts::{ModulePart, Parts};
use super::period::check_range;
use super::plan::Plan;
use super::remotes::PortStage;
use super::safe_bus::SafeBus;
use super::{Defaults, Driver, DriverError, FaultPolicy, Pace, Remark, RemarkKind, Settings};
use crate::bus::{Access, BusError, Clock, Effort, Exchanges, RegisterBus, Words};
use crate::fraction::Fraction;
use crate::hostmot2::{FirmwareCheck, Gtag, HostMot2, IoPorts};
use crate::modules::built_in::BUILT_IN;
use crate::modules::dpll::Dpll;
use crate::modules::gpio::Gpio;
use crate::modules::watchdog::{Watchdog, WatchdogRegisters};
use crate::modules::{RegisterError, Registrar, undriven};

/// An identified board: its firmware is known, and nothing is driven. Modules are
/// [added](Self::add) in this stage. Firmware, name and pins are those of its [`Plan`].
///
/// Dropping it makes the board drive nothing.
#[derive(Debug)]
pub struct Board<B: RegisterBus + Clock>(pub(super) Assembly<B>);

/// A board that is set up, with all outputs off, and whose remotes are known.
///
/// The remotes stay in setup mode until the [start](Self::start): in this stage their parameters
/// are [read](Self::read_remote_parameter) and [written](Self::write_remote_parameter), and handles
/// are [attached](Self::attach). Firmware, name and pins are those of its [`Plan`]. Dropping it
/// makes the board drive nothing.
#[derive(Debug)]
pub struct Configured<B: RegisterBus + Clock>(pub(super) Assembly<B>);

/// The parts of a driver before its start.
#[derive(Debug)]
pub(super) struct Assembly<B: RegisterBus + Clock> {
    pub bus: SafeBus<B>,
    pub plan: Plan,
    pub stages: Vec<PortStage>,
    pub parts: Parts,
    description: FirmwareCheck,
}

impl<B: RegisterBus + Clock> Deref for Board<B> {
    type Target = Plan;

    fn deref(&self) -> &Plan {
        &self.0.plan
    }
}

impl<B: RegisterBus + Clock> Deref for Configured<B> {
    type Target = Plan;

    fn deref(&self) -> &Plan {
        &self.0.plan
    }
}

impl<B: RegisterBus + Clock> Board<B> {
    /// Identifies the firmware of the board, and registers the modules that this crate supports.
    ///
    /// # Errors
    /// [`DriverError`]: the bus, the firmware, or settings that do not fit the firmware.
    ///
    /// # Real time
    /// Not for the cycle. Bounded.
    pub fn identify(bus: B, settings: Settings) -> Result<Self, DriverError> {
        Self::identify_then(bus, settings, |_, _| {})
    }

    /// As [`identify`](Self::identify), with settings that depend on the firmware: `adjust` changes
    /// them when the firmware is known, before any pin is made. LinuxCNC numbers the boards of each
    /// kind on their own:
    ///
    /// ```
    /// use std::collections::BTreeMap;
    /// use mesa_hal::{Board, Settings};
    /// use mesa_hal_sim::machines;
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut of_kind = BTreeMap::<String, u8>::new();
    /// let buses = [machines::i7i97(1), machines::i7i92_7i77(), machines::i7i97(1)];
    /// let boards = buses.map(|bus| {
    ///     Board::identify_then(bus, Settings::default(), |firmware, settings| {
    ///         let next = of_kind.entry(firmware.idrom.board()).or_default();
    ///         settings.board_number = *next;
    ///         *next += 1;
    ///     })
    /// });
    /// let [first, second, third] = boards;
    /// let names = [first?, second?, third?].map(|board| board.name().to_owned());
    /// assert_eq!(names, ["hm2_7i97.0", "hm2_7i92.0", "hm2_7i97.1"]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`identify`](Self::identify), before and after `adjust`.
    ///
    /// # Real time
    /// As [`identify`](Self::identify).
    pub fn identify_then(
        mut bus: B,
        settings: Settings,
        adjust: impl FnOnce(&HostMot2, &mut Settings),
    ) -> Result<Self, DriverError> {
        let mut settings = begin_cycle(&mut bus, settings)?;
        let (firmware, description) = identify_steady(&mut bus)?;
        adjust(&firmware, &mut settings);
        let settings = begin_cycle(&mut bus, settings)?;
        settings.check_firmware(&firmware)?;
        let ports = IoPorts::locate(&firmware).map_err(RegisterError::from)?;
        let watchdog = WatchdogRegisters::locate(&firmware).map_err(RegisterError::from)?;
        let mut bus = SafeBus::new(bus, &ports, &watchdog);
        let mut plan = Plan::new(firmware, ports, settings);
        let status = plan.status;
        let watchdog = plan.register(&mut bus, status, Watchdog::register)?;
        let connection = plan.register(&mut bus, status, Connection::register)?;
        let mut board = Assembly {
            bus,
            plan,
            stages: Vec::new(),
            parts: Parts {
                watchdog,
                connection,
                ports: Vec::new(),
                modules: Vec::new(),
            },
            description,
        };
        board.add_built_in()?;
        board.stages = board.plan.locate_ports()?;
        Ok(Self(board))
    }

    /// Adds modules of the application's own. `register` registers their registers and pins, and
    /// [adds](Registrar::add) them; this function returns what `register` returns: the handles of
    /// their pins. These handles are valid for this board in all further stages, up to the
    /// [`Driver`].
    ///
    /// The guide [your own module](crate::guides::own_module) has an example.
    ///
    /// # Errors
    /// [`DriverError::Register`]: the module cannot be used, with the reason. [`DriverError::Bus`]:
    /// a [`Registrar::peek`] failed.
    pub fn add<T>(
        &mut self,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<T, RegisterError>,
    ) -> Result<T, DriverError> {
        self.0.add(register)
    }

    /// Sets the board up, with everything off, and discovers its remotes.
    ///
    /// # Errors
    /// [`DriverError`]. Everything that was started is stopped again.
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn discover(self) -> Result<Configured<B>, DriverError> {
        let mut assembly = self.0;
        match assembly.find_remotes() {
            Ok(()) => Ok(Configured(assembly)),
            Err(error) => Err(assembly.stopped(error)),
        }
    }

    /// [Discovers](Self::discover) the remotes, and [starts](Configured::start).
    ///
    /// # Errors
    /// [`DriverError`].
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn start(self) -> Result<Driver<B>, DriverError> {
        self.discover()?.start()
    }
}

impl<B: RegisterBus + Clock> Configured<B> {
    /// Starts the remotes and plans the cycle.
    ///
    /// The remotes then run, with all outputs off, until the first write. If the start fails,
    /// everything that was started is stopped again.
    ///
    /// # Errors
    /// [`DriverError`].
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn start(self) -> Result<Driver<B>, DriverError> {
        let mut assembly = self.0;
        match assembly.start_ports() {
            Ok((exchanges, words)) => Ok(assembly.into_driver(exchanges, words)),
            Err(error) => Err(assembly.stopped(error)),
        }
    }
}

impl<B: RegisterBus + Clock> Assembly<B> {
    fn add_built_in(&mut self) -> Result<(), DriverError> {
        for register in BUILT_IN.iter().filter_map(|kind| kind.register) {
            self.add(register)?;
        }
        if self.plan.settings.pace == Pace::Board && self.parts.of::<Dpll>().next().is_none() {
            let why = "this firmware's phase-locked loop is missing, or left alone";
            return Err(DriverError::NotPaced { why });
        }
        Ok(())
    }

    pub(super) fn add<T>(
        &mut self,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<T, RegisterError>,
    ) -> Result<T, DriverError> {
        let group = self.plan.pins.add_part(self.plan.group);
        let group = group.map_err(RegisterError::from)?;
        let registered = self.plan.register(&mut self.bus, group, register);
        let added = core::mem::take(&mut self.plan.added);
        let handles = registered?;
        let parts = added.into_iter().map(|module| ModulePart {
            module,
            group,
            version: None,
        });
        self.parts.modules.extend(parts);
        Ok(handles)
    }

    fn start_ports(&mut self) -> Result<(Exchanges, Words), DriverError> {
        let bus = &mut self.bus;
        for stage in &mut self.stages {
            self.parts.ports.push(self.plan.start(bus, stage)?);
        }
        // The ports have added evidence since the modules registered.
        self.plan.image.check().map_err(RegisterError::from)?;
        // The board's timer fires once in a period: a longer wait means that it stands still.
        let Settings { pace, period, .. } = self.plan.settings;
        let held = (pace == Pace::Board).then(|| period.fraction(5, 4));
        let frozen = self.plan.image.freeze(bus, held);
        let frozen = frozen.map_err(DriverError::Bus)?;
        self.expect_set_up(STARTED)?;
        Ok(frozen)
    }

    fn find_remotes(&mut self) -> Result<(), DriverError> {
        // I/O pins come last, after all modules have taken theirs.
        self.add(Gpio::register)?;
        let undriven = undriven(&self.plan.firmware, &self.plan.claimed).into_iter();
        let remarks = undriven.map(|module| RemarkKind::Undriven(Box::new(module)));
        self.plan.remarks.extend(remarks.map(Remark::of_board));
        if self.plan.settings.instances.get(&Gtag::STEPGEN) != Some(&0) {
            self.plan.remark_old_stepgens();
        }
        self.set_up()?;
        self.plan
            .image
            .watch(&mut self.bus)
            .map_err(DriverError::Bus)?;
        self.expect_set_up("it was set up")?;
        for stage in &mut self.stages {
            self.plan.discover(&mut self.bus, stage)?;
        }
        self.finish_gpio()
    }

    /// Gives the pins of serial channels on which nothing answers back to plain I/O, as LinuxCNC
    /// does, and gives those of modules their second names.
    fn finish_gpio(&mut self) -> Result<(), DriverError> {
        if self.plan.settings.defaults != Defaults::LinuxCnc {
            return Ok(());
        }
        let silent = self.stages.iter().flat_map(PortStage::silent_pins);
        let silent: Vec<u16> = silent.collect();
        let mut parts = self.parts.modules.iter_mut();
        let gpio = parts.find_map(|part| {
            let module: &mut dyn Any = &mut *part.module;
            Some((part.group, module.downcast_mut::<Gpio>()?))
        });
        let Some((group, gpio)) = gpio else {
            return Ok(());
        };
        let writes = self.plan.register(&mut self.bus, group, |r| {
            let writes = gpio.give_back(r, &silent)?;
            gpio.add_aliases(r)?;
            Ok(writes)
        })?;
        let (accesses, mut words) = Access::writes(writes);
        if words.is_empty() {
            return Ok(());
        }
        let written = self.bus.exchange(&accesses, &mut words);
        written.map_err(DriverError::Bus)
    }

    /// Writes the set-up, until the board has all of it. A reset in the middle of the set-up leaves
    /// its end without its beginning: driven pins of modules that are not set up.
    fn set_up(&mut self) -> Result<(), DriverError> {
        for _ in 0..TRIES {
            self.plan
                .image
                .set_up(&mut self.bus)
                .map_err(DriverError::Bus)?;
            if self.confirm_set_up().map_err(DriverError::Bus)? {
                return Ok(());
            }
        }
        self.expect_set_up("it was set up")
    }

    /// Fails if the board has lost its set-up since it was written, and makes it drive nothing.
    fn expect_set_up(&mut self, during: &'static str) -> Result<(), DriverError> {
        if self.confirm_set_up().map_err(DriverError::Bus)? {
            return Ok(());
        }
        // If this fails, the watchdog does the rest.
        let _ = self.bus.release();
        Err(DriverError::Unsteady { during })
    }

    /// True if the board has not been reset since its set-up began. A read in the middle of a reset
    /// is no evidence, so the board's description has to be unchanged as well.
    fn confirm_set_up(&mut self) -> Result<bool, BusError> {
        let bus = &mut self.bus;
        Ok(self.description.is_still(bus, Effort::Repeated)?
            && self.parts.watchdog.registers.are_at_first(bus)?)
    }

    /// Stops everything after a failed start, and returns its error. A failure of a port or a
    /// remote after a reset is reported as the reset.
    fn stopped(&mut self, error: DriverError) -> DriverError {
        let is_of_port = matches!(error, DriverError::Port(_) | DriverError::Missing(_));
        if is_of_port && let Err(reset @ DriverError::Unsteady { .. }) = self.expect_set_up(STARTED)
        {
            return reset;
        }
        for stage in &mut self.stages {
            // Further errors are ignored; everything that can still be stopped is stopped.
            let _ = stage.port.on(&mut self.bus).stop_all();
        }
        error
    }

    fn into_driver(self, exchanges: Exchanges, words: Words) -> Driver<B> {
        let mut plan = self.plan;
        plan.pins.shrink_to_fit();
        let Settings { pace, period, .. } = plan.settings;
        let driver = Driver {
            bus: self.bus,
            firmware: plan.firmware,
            name: plan.name,
            exchanges,
            cycle: BoardCycle::new(
                words,
                plan.pins,
                plan.group,
                self.parts,
                plan.events,
                ArrivalClock::new(pace, period),
            ),
            description: self.description,
            missing: plan.missing,
            remarks: plan.remarks,
            pacer: ExchangePacer::new(pace, period),
            is_stopped: false,
        };
        #[cfg(feature = "log")]
        super::messages::found(&driver);
        driver
    }
}

/// The step after the set-up, for error texts.
const STARTED: &str = "its remotes were started";

/// Attempts to identify a board, or to set it up, when it is reset meanwhile.
const TRIES: u32 = 3;

/// Identifies the firmware of the board, and the words that identify it, read twice with the same
/// result: words read around a reset do not identify a firmware.
fn identify_steady<B: RegisterBus>(bus: &mut B) -> Result<(HostMot2, FirmwareCheck), DriverError> {
    for _ in 0..TRIES {
        let (firmware, description) = HostMot2::describe(bus)?;
        let mut description = description.known(bus).map_err(DriverError::Bus)?;
        let is_still = description.is_still(bus, Effort::Repeated);
        if is_still.map_err(DriverError::Bus)? {
            return Ok((firmware, description));
        }
    }
    let during = "its firmware was identified";
    Err(DriverError::Unsteady { during })
}

/// Sets the bus up for the cycle of the settings, and refuses those that are invalid for any board.
fn begin_cycle<B: RegisterBus>(bus: &mut B, settings: Settings) -> Result<Settings, DriverError> {
    let settings = checked(settings)?;
    if settings.pace == Pace::Board && !bus.can_hold() {
        let why = "this bus cannot hold reads back";
        return Err(DriverError::NotPaced { why });
    }
    bus.set_cycle(settings.period, None);
    Ok(settings)
}

/// Refuses times that do not fit each other, and a rest that is too short.
fn checked(mut settings: Settings) -> Result<Settings, DriverError> {
    let period = settings.period;
    check_range(period)?;
    DriverError::check_watchdog(None, settings.watchdog_time(), period)?;
    settings.check()?;
    let rest = &mut settings.fault_policy.rest;
    *rest = (*rest).max(FaultPolicy::SHORTEST_REST);
    Ok(settings)
}
