//! From a bus to a driver: finding out what is there, setting it up, planning the cycle.

use alloc::{boxed::Box, format, string::String, vec::Vec};
use core::time::Duration;

use super::connection::Connection;
use super::held::Held;
use super::pace::Pacer;
use super::remotes::{PortStage, Remotes};
use super::{
    BoardState, Driver, DriverStatistics, FaultPolicy, MissingRemote, Pace, Part, Parts, Remark,
    SerialPort, Settings, StartError,
};
use crate::boards::{AttachError, BoardHandles, BoardTable, REMOTES, RemoteHandles};
use crate::bus::{BusError, Clock, Image, ImagePlan, RegisterBus};
use crate::discovery::RemoteTable;
use crate::hal::{GroupId, Input, PinStore, Pins};
use crate::hostmot2::{HostMot2, IoPorts};
use crate::modules::dpll::Dpll;
use crate::modules::encoder::Encoders;
use crate::modules::gpio::Gpio;
use crate::modules::in_mux::InMux;
use crate::modules::led::Leds;
use crate::modules::outputs::Outputs;
use crate::modules::pwm::Pwm;
use crate::modules::watchdog::{Watchdog, WatchdogRegisters};
use crate::modules::{Module, RegisterError, Registrar};

/// A board that is being configured: its firmware is known, and nothing is driven yet.
///
/// Dropping it leaves the board driving nothing.
#[derive(Debug)]
pub struct Board<B: RegisterBus + Clock> {
    bus: Held<B>,
    plan: Plan,
    watchdog: Watchdog,
    connection: Connection,
    modules: Vec<Part>,
    phase_error_us: Option<Input<f64>>,
    ports: Vec<PortStage>,
    is_discovered: bool,
}

/// Everything that a driver is planned from, but the bus.
#[derive(Debug)]
pub(super) struct Plan {
    pub firmware: HostMot2,
    pub name: String,
    pub table: &'static BoardTable,
    pub settings: Settings,
    pub pins: PinStore,
    /// The group of the board's own I/O.
    pub group: GroupId,
    /// The group of the driver's own pins.
    pub status: GroupId,
    pub io: IoPorts,
    pub image: ImagePlan,
    pub missing: Vec<MissingRemote>,
    pub remarks: Vec<Remark>,
    /// Kinds of remotes: those that were added, then those that are built in.
    pub tables: Vec<&'static RemoteTable>,
}

impl<B: RegisterBus + Clock> Board<B> {
    /// Finds out what firmware the board has, and registers the modules that this crate knows.
    ///
    /// # Errors
    /// [`StartError`]: the bus, the firmware, or settings that do not fit it.
    ///
    /// # Real time
    /// Not for the cycle. Bounded.
    pub fn identify(mut bus: B, settings: Settings) -> Result<Self, StartError<B::Error>> {
        let settings = checked(settings)?;
        if settings.pace == Pace::Board && !B::CAN_HOLD {
            return Err(StartError::NotPaced);
        }
        bus.set_cycle(settings.period, None);
        let firmware = HostMot2::identify(&mut bus)?;
        let ports = IoPorts::locate(&firmware).map_err(RegisterError::from)?;
        let watchdog = WatchdogRegisters::locate(&firmware).map_err(RegisterError::from)?;
        let mut bus = Held::new(bus, &ports, &watchdog);
        let mut plan = Plan::new(firmware, ports, settings);
        let status = plan.status;
        let watchdog = plan.register(&mut *bus, status, Watchdog::register)?;
        let connection = plan.register(&mut *bus, status, Connection::register)?;
        let mut board = Self {
            bus,
            plan,
            watchdog,
            connection,
            modules: Vec::new(),
            phase_error_us: None,
            ports: Vec::new(),
            is_discovered: false,
        };
        board.add_built_in()?;
        board.ports = board.plan.locate_ports()?;
        Ok(board)
    }

    fn add_built_in(&mut self) -> Result<(), StartError<B::Error>> {
        let mut phase_error_us = None;
        self.add(|r| {
            let dpll = Dpll::register(r)?;
            phase_error_us = dpll.as_ref().map(|dpll| dpll.pins.phase_error_us);
            Ok(dpll)
        })?;
        self.phase_error_us = phase_error_us;
        if self.plan.settings.pace == Pace::Board && phase_error_us.is_none() {
            return Err(StartError::NoPace);
        }
        self.add(Encoders::register)?;
        self.add(Pwm::register)?;
        self.add(InMux::register)?;
        self.add(Outputs::register)?;
        self.add(Leds::register)
    }

    /// Adds a part of the board: none, one or several instances of a module that `register` makes.
    ///
    /// # Errors
    /// [`StartError::Register`]: why it can not be used. [`StartError::AddedLate`] after
    /// [`discover`](Self::discover).
    pub fn add<M, I>(
        &mut self,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<I, RegisterError>,
    ) -> Result<(), StartError<B::Error>>
    where
        M: Module,
        I: IntoIterator<Item = M>,
    {
        if self.is_discovered {
            return Err(StartError::AddedLate);
        }
        let group = self.plan.pins.add_part(self.plan.group);
        let group = group.map_err(RegisterError::from)?;
        let made = self.plan.register(&mut *self.bus, group, register)?;
        self.modules.extend(made.into_iter().map(|module| Part {
            module: Box::new(module),
            group,
            version: None,
        }));
        Ok(())
    }

    /// What the board's firmware says of itself.
    pub fn firmware(&self) -> &HostMot2 {
        &self.plan.firmware
    }

    /// What the names of its pins begin with, for example `hm2_7i92.0`.
    pub fn name(&self) -> &str {
        &self.plan.name
    }

    /// All pins and parameters so far.
    pub fn pins(&self) -> &Pins {
        &self.plan.pins
    }

    /// Sets the board up, starts the remotes and plans the cycle.
    ///
    /// The remotes run then, with all outputs off, until the first write. If this fails, everything
    /// that was started is stopped again.
    ///
    /// # Errors
    /// [`StartError`].
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn start(mut self) -> Result<Driver<B>, StartError<B::Error>> {
        self.discover()?;
        let started = self.plan.start_ports(&mut *self.bus, &mut self.ports);
        match started.and_then(|ports| Ok((self.plan.prepare(&mut *self.bus)?, ports))) {
            Ok((image, ports)) => Ok(self.into_driver(image, ports)),
            Err(error) => Err(self.stopped(error)),
        }
    }

    /// Adds a kind of remote that this crate does not know: it names terminals, units and safe
    /// values. Those that are added count before those that are built in.
    ///
    /// # Errors
    /// [`StartError::AddedLate`] after [`discover`](Self::discover).
    pub fn add_remote(&mut self, table: &'static RemoteTable) -> Result<(), StartError<B::Error>> {
        if self.is_discovered {
            return Err(StartError::AddedLate);
        }
        let tables = &mut self.plan.tables;
        tables.insert(tables.len() - REMOTES.len(), table);
        Ok(())
    }

    /// Sets the board up, with everything off, and finds out what remotes there are. They stay in
    /// setup mode until the [start](Self::start): here their parameters are read and written.
    ///
    /// The first call does so; [`start`](Self::start) does, if nobody has.
    ///
    /// # Errors
    /// [`StartError`]. Everything that was started is stopped again.
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn discover(&mut self) -> Result<Remotes<'_, B>, StartError<B::Error>> {
        if !self.is_discovered
            && let Err(error) = self.find_remotes()
        {
            return Err(self.stopped(error));
        }
        Ok(Remotes::new(
            &mut *self.bus,
            &mut self.plan,
            &mut self.ports,
        ))
    }

    fn find_remotes(&mut self) -> Result<(), StartError<B::Error>> {
        // I/O pins come last, when everybody has taken theirs.
        self.add(|r| Ok([Gpio::register(r)?]))?;
        self.is_discovered = true;
        let bus = &mut *self.bus;
        self.plan.image.set_up(bus).map_err(StartError::Bus)?;
        self.plan.image.watch(bus).map_err(StartError::Bus)?;
        self.plan.discover(bus, &mut self.ports)
    }

    fn stopped(&mut self, error: StartError<B::Error>) -> StartError<B::Error> {
        for stage in &mut self.ports {
            // The error counts; whatever can still be stopped is stopped.
            let _ = stage.port.stop_all(&mut *self.bus);
        }
        error
    }

    /// The handles of the remote on `channel` (0 to 7) of `port`, which has to be of their kind.
    /// After [`discover`](Self::discover).
    ///
    /// # Errors
    /// [`AttachError`]: no remote takes part there, it is of another kind or another part of a card
    /// (swapped channels), or it lacks a pin in its software mode.
    pub fn attach<T: RemoteHandles>(&self, port: u8, channel: u8) -> Result<T, AttachError> {
        self.plan.attach(&self.ports, (port, channel))
    }

    /// The handles of the board's own functions.
    ///
    /// # Errors
    /// [`AttachError`]: it is another board, its firmware lacks a module, or not all instances are
    /// in use.
    pub fn attach_board<T: BoardHandles>(&self) -> Result<T, AttachError> {
        BoardTable::attach((self.pins(), self.name()), self.firmware())
    }

    fn into_driver(self, image: Image<B>, ports: Vec<SerialPort>) -> Driver<B> {
        let Self {
            bus,
            plan,
            watchdog,
            connection,
            modules,
            phase_error_us,
            ..
        } = self;
        let Settings { pace, period, .. } = plan.settings;
        let driver = Driver {
            bus,
            firmware: plan.firmware,
            name: plan.name,
            period,
            image,
            pins: plan.pins,
            group: plan.group,
            parts: Parts {
                watchdog,
                ports,
                modules,
            },
            connection,
            phase_error_us,
            missing: plan.missing,
            remarks: plan.remarks,
            state: BoardState::Running,
            shown: None,
            statistics: DriverStatistics::default(),
            pacer: Pacer::new(pace, period),
            read_failures: 0,
            write_failures: 0,
            is_repeated: false,
            look_closely: true,
            wants_extra: false,
            is_last: false,
            is_stopped: false,
        };
        #[cfg(feature = "log")]
        super::messages::found(&driver);
        driver
    }
}

/// Refuses times that do not fit each other, and completes what follows the period.
fn checked<E: BusError>(mut settings: Settings) -> Result<Settings, StartError<E>> {
    let period = settings.period;
    if !(Duration::from_micros(1)..=Duration::from_millis(800)).contains(&period) {
        return Err(StartError::BadPeriod { period });
    }
    let (watchdog, needed) = (settings.watchdog_time(), period * WATCHDOG_FEEDS);
    if watchdog < needed {
        return Err(StartError::WatchdogTooShort {
            watchdog,
            needed,
            period,
        });
    }
    let rest = settings.fault_policy.rest.max(FaultPolicy::SHORTEST_REST);
    settings.fault_policy.rest = rest.max(period * 3 / 4);
    Ok(settings)
}

/// How often a watchdog must be fed within its time: a write, or a transfer, may be lost.
pub(super) const WATCHDOG_FEEDS: u32 = 2;

impl Plan {
    fn new(firmware: HostMot2, io: IoPorts, settings: Settings) -> Self {
        let name = {
            let board = firmware.idrom.board();
            format!("hm2_{board}.{}", settings.board_number)
        };
        let mut pins = PinStore::default();
        Self {
            table: BoardTable::for_firmware(&firmware, &settings.boards),
            status: pins.add_group(),
            group: pins.add_group(),
            pins,
            io,
            image: ImagePlan::default(),
            name,
            settings,
            firmware,
            missing: Vec::new(),
            remarks: Vec::new(),
            tables: REMOTES.to_vec(),
        }
    }

    /// Lays out all that was registered, and has the bus prepare its lists.
    fn prepare<B: RegisterBus>(&self, bus: &mut B) -> Result<Image<B>, StartError<B::Error>> {
        self.image.check().map_err(RegisterError::from)?;
        // The board's timer comes once in a period: a longer wait means that it stands still.
        let Settings { pace, period, .. } = self.settings;
        let held = (pace == Pace::Board).then(|| period.saturating_add(period / 4));
        self.image.freeze(bus, held).map_err(StartError::Bus)
    }

    /// Lets something register, with pins of this group.
    pub fn register<B: RegisterBus, T>(
        &mut self,
        bus: &mut B,
        group: GroupId,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<T, RegisterError>,
    ) -> Result<T, StartError<B::Error>> {
        let mut bus_error = None;
        let mut peek = |address| {
            bus.read(address).map_err(|error| {
                bus_error = Some(error);
                RegisterError::Peek { address }
            })
        };
        let registered = register(&mut Registrar {
            firmware: &self.firmware,
            board: self.table,
            name: &self.name,
            settings: &self.settings,
            group,
            status: self.status,
            pins: &mut self.pins,
            io: &mut self.io,
            plan: &mut self.image,
            bus: &mut peek,
        });
        match (registered, bus_error) {
            (Ok(made), _) => {
                self.image.check().map_err(RegisterError::from)?;
                Ok(made)
            }
            (Err(RegisterError::Peek { .. }), Some(error)) => Err(StartError::Bus(error)),
            (Err(error), _) => Err(StartError::Register(error)),
        }
    }
}
