//! From a bus to a driver: finding out what is there, setting it up, planning the cycle.

mod serial;

use alloc::{boxed::Box, format, string::String, vec::Vec};
use core::time::Duration;

pub use super::modules::{EncoderSetup, GpioConfig};

use super::board::Board;
use super::evidence::Directions;
use super::modules::{GpioModule, Making, ModuleChoices, build_modules};
use super::pace::Pacer;
use super::parameters::check_watchdog;
use super::set_up::SetUp;
use super::stop::release;
use super::{
    BuildError, Driver, DriverStatistics, FaultPolicy, Lists, MissingRemote, Module, Pace, Remark,
    SerialConfig, SerialPort, SetupList,
};
use crate::boards::fpga::FpgaPins;
use crate::bus::{Clock, ImageLimits, ImagePlan, RegisterBus, Reply};
use crate::hal::{AnyValue, GroupId, PinStore};
use crate::hostmot2::{HostMot2, IoPorts, PortPlan, Watchdog, WatchdogTime};

/// The most serial ports of a board.
const MAX_PORTS: usize = 4;

/// What a driver is to be, before it is built.
///
/// Everything has a default that fits a board on the bench: all ports with all their channels in
/// mode 0, all encoders, 1 ms.
#[derive(Debug)]
pub struct Builder<B: RegisterBus + Clock> {
    bus: B,
    config: Config,
    modules: Vec<Box<dyn Module>>,
}

#[derive(Clone, Debug)]
struct Config {
    number: u8,
    period: Duration,
    /// `None`: it follows the period.
    watchdog: Option<Duration>,
    ports: [Option<SerialConfig>; MAX_PORTS],
    /// A port that was configured and that no board has.
    port_beyond: Option<u8>,
    modules: ModuleChoices,
    gpio: Vec<(u16, GpioConfig)>,
    policy: FaultPolicy,
    parameters: Vec<ParameterChoice>,
    bus_error_limit: u32,
    limits: ImageLimits,
}

/// What a parameter of a remote is to be.
#[derive(Clone, Debug)]
struct ParameterChoice {
    port: u8,
    channel: u8,
    name: Box<str>,
    value: AnyValue,
}

/// What is being built, besides the bus.
struct Parts {
    firmware: HostMot2,
    name: String,
    pins: PinStore,
    /// The group of the board's own I/O.
    group: GroupId,
    /// The group of the driver's own pins.
    status: GroupId,
    plan: PortPlan,
    places: IoPorts,
    /// The handles of the board's own pins.
    made: FpgaPins,
    ports: Vec<SerialPort>,
    missing: Vec<MissingRemote>,
    remarks: Vec<Remark>,
}

impl<B: RegisterBus + Clock> Builder<B> {
    pub(super) fn new(bus: B) -> Self {
        Self {
            bus,
            config: Config {
                number: 0,
                period: Duration::from_millis(1),
                watchdog: None,
                ports: [None; MAX_PORTS],
                port_beyond: None,
                modules: ModuleChoices::default(),
                gpio: Vec::new(),
                policy: FaultPolicy::default(),
                parameters: Vec::new(),
                bus_error_limit: 5,
                limits: ImageLimits::default(),
            },
            modules: Vec::new(),
        }
    }

    /// The number of the board in pin names, for several boards of a kind; 0 at first.
    #[must_use]
    pub fn board_number(mut self, number: u8) -> Self {
        self.config.number = number;
        self
    }

    /// The period of the cycle: what the transfers must fit into, and what feeds the watchdogs. 1 us
    /// to 800 ms; 1 ms at first.
    ///
    /// What is not set otherwise follows it: the board's [`watchdog`](Self::watchdog), and the
    /// deadline of a reply, which is 80 % of it.
    #[must_use]
    pub fn period(mut self, period: Duration) -> Self {
        self.config.period = period;
        self
    }

    /// Who decides when a cycle begins; the host at first.
    #[must_use]
    pub fn pace(mut self, pace: Pace) -> Self {
        self.config.modules.pace = pace;
        self
    }

    /// The time after which the board's watchdog bites without a write. If this is not called: five
    /// periods, and at least 5 ms. It runs from the first write on.
    ///
    /// Less than two periods are refused by [`build`](Self::build), because one write that is lost
    /// must not let it bite.
    #[must_use]
    pub fn watchdog(mut self, timeout: Duration) -> Self {
        self.config.watchdog = Some(timeout);
        self
    }

    /// Which channels of serial port `port` (0 to 3) are used, and how.
    ///
    /// A port that is not mentioned is used with the default: whatever is there, in mode 0. One that
    /// the firmware does not have is refused by [`build`](Self::build).
    #[must_use]
    pub fn serial_port(mut self, port: u8, config: SerialConfig) -> Self {
        match self.config.ports.get_mut(usize::from(port)) {
            Some(slot) => *slot = Some(config),
            None => self.config.port_beyond = Some(port),
        }
        self
    }

    /// What a parameter is to be that the remote on `channel` (0 to 7) of `port` keeps, for example
    /// `nvwatchdogtimeout`: as the remote spells it, or as LinuxCNC does.
    ///
    /// It is written while the remotes are in setup mode, and read back; a non-volatile one only if
    /// it is another than before, and the remote uses it from its next power-up on. Of a remote
    /// that is missing and not required, nothing is written. A parameter that the remote does not
    /// have, or a value that it can not take, makes [`build`](Self::build) fail.
    #[must_use]
    pub fn remote_parameter(
        mut self,
        port: u8,
        channel: u8,
        name: &str,
        value: impl Into<AnyValue>,
    ) -> Self {
        self.config.parameters.push(ParameterChoice {
            port,
            channel,
            name: name.into(),
            value: value.into(),
        });
        self
    }

    /// How the encoders are set up.
    #[must_use]
    pub fn encoders(mut self, setup: EncoderSetup) -> Self {
        self.config.modules.encoders = setup;
        self
    }

    /// The PWM frequency of all generators in Hz. At first what the board is made for: on a 7I97
    /// 48 kHz, or 96 kHz with dither where the firmware has it; else 20 kHz.
    #[must_use]
    pub fn pwm_frequency(mut self, hz: u32) -> Self {
        self.config.modules.pwm_hz = Some(hz);
        self
    }

    /// How I/O pin `pin` begins, which must be one that no module uses. The others are inputs.
    #[must_use]
    pub fn gpio(mut self, pin: u16, config: GpioConfig) -> Self {
        self.config.gpio.push((pin, config));
        self
    }

    /// Leaves the phase-locked loop alone: for a period that it can not follow.
    #[must_use]
    pub fn without_dpll(mut self) -> Self {
        self.config.modules.no_dpll = true;
        self
    }

    /// When remotes are set aside, and how they come back.
    #[must_use]
    pub fn fault_policy(mut self, policy: FaultPolicy) -> Self {
        self.config.policy = policy;
        self
    }

    /// The `limit`-th read or write in a row that fails makes everything safe; 5 at first.
    ///
    /// Fewer in a row do it, too, when others failed shortly before: failures are counted as
    /// LinuxCNC counts them, see
    /// [`packet_error_level`](crate::boards::fpga::EthernetPins::packet_error_level). A failure adds
    /// `packet-error-increment` (2), a read that succeeds takes `packet-error-decrement` (1) off, and
    /// `packet-error-limit` is set to `limit` increments: 10.
    #[must_use]
    pub fn bus_error_limit(mut self, limit: u32) -> Self {
        self.config.bus_error_limit = limit.max(1);
        self
    }

    /// How the registers of a cycle are laid out.
    #[must_use]
    pub fn image_limits(mut self, limits: ImageLimits) -> Self {
        self.config.limits = limits;
        self
    }

    /// Adds a part of the board that this crate does not know.
    #[must_use]
    pub fn module(mut self, module: Box<dyn Module>) -> Self {
        self.modules.push(module);
        self
    }

    /// Finds out what is there, sets it up, starts the remotes and plans the cycle.
    ///
    /// The remotes run then, with all outputs off, until the first write. If this fails,
    /// everything that was started is stopped again.
    ///
    /// # Real time
    /// Not for the cycle. Bounded; up to some seconds with many remotes.
    pub fn build(mut self) -> Result<Driver<B>, BuildError<B::Error>> {
        self.config.check_times()?;
        let policy = &mut self.config.policy;
        let most_of_a_period = self.config.period * 3 / 4;
        policy.rest = policy
            .rest
            .max(FaultPolicy::SHORTEST_REST)
            .max(most_of_a_period);
        self.bus.follow_period(self.config.period);
        let firmware = HostMot2::identify(&mut self.bus)?;
        let watchdog = Watchdog::locate(&firmware)?;
        let places = IoPorts::locate(&firmware)?;
        match self.build_on(firmware, watchdog) {
            Ok(parts) => {
                let driver = parts.into_driver(self.bus, &self.config);
                #[cfg(feature = "log")]
                super::messages::found(&driver);
                Ok(driver)
            }
            Err(error) => {
                // The error counts; whatever can still be made safe is made safe.
                let _ = release(&mut self.bus, &watchdog, &places);
                Err(error)
            }
        }
    }

    fn build_on(
        &mut self,
        firmware: HostMot2,
        watchdog: Watchdog,
    ) -> Result<Built<B::List>, BuildError<B::Error>> {
        let bus = &mut self.bus;
        let config = &self.config;
        let mut parts = Parts::new(firmware, config.number)?;
        let mut board = Board::new(
            &mut parts.pins,
            parts.status,
            &parts.name,
            watchdog,
            (config.watchdog_time(), config.period),
            config.bus_error_limit,
        )?;
        board.tell(&mut parts.made);
        let choices = &config.modules;
        let mut modules = build_modules(&mut parts.making(), bus, choices, config.period)?;
        modules.append(&mut self.modules);
        let mut ports = parts.locate_ports(config)?;
        let places = parts.places;
        let gpio = GpioModule::build(&mut parts.making(), &places, &config.gpio)?;
        modules.push(Box::new(gpio));
        let setup = parts.set_up(watchdog, &modules);
        setup.replay(bus).map_err(BuildError::Bus)?;
        board
            .evidence
            .watch(parts.directions(bus).map_err(BuildError::Bus)?);
        let started = parts.start_ports(bus, &mut ports, config);
        if let Err(error) = started {
            for (port, _) in &mut ports {
                let _ = port.stop_all(bus);
            }
            return Err(error);
        }
        let mut plan = ImagePlan::new();
        board.claim(&mut plan);
        for port in &mut parts.ports {
            port.claim(&mut plan);
        }
        for module in &mut modules {
            module.claim(&mut plan);
        }
        let held = config.modules.pace.held(config.period);
        let (image, image_lists) = plan.freeze(bus, config.limits, held)?;
        let ports = parts.plan.ports();
        let set_up = SetUp::prepare(bus, &setup, &board.evidence, &places, &watchdog, ports);
        let (set_up, set_up_lists) = set_up.map_err(BuildError::Bus)?;
        Ok(Built {
            parts,
            board,
            modules,
            set_up,
            image,
            lists: Lists {
                image: image_lists,
                set_up: set_up_lists,
            },
        })
    }
}

/// How often a watchdog must be fed within its time: a write, or a transfer, may be lost.
pub(super) const WATCHDOG_FEEDS: u32 = 2;

impl Config {
    fn watchdog_time(&self) -> Duration {
        let follows = self.period.saturating_mul(5).max(Watchdog::DEFAULT_TIMEOUT);
        self.watchdog.unwrap_or(follows)
    }

    /// Whether the times fit each other.
    fn check_times<E: crate::bus::BusError>(&self) -> Result<(), BuildError<E>> {
        let period = self.period;
        if !(Duration::from_micros(1)..=Duration::from_millis(800)).contains(&period) {
            return Err(BuildError::BadPeriod { period });
        }
        let (watchdog, needed) = (self.watchdog_time(), period * WATCHDOG_FEEDS);
        if watchdog < needed {
            return Err(BuildError::WatchdogTooShort {
                watchdog,
                needed,
                period,
            });
        }
        for choice in &self.parameters {
            check_watchdog(&choice.name, choice.value, period).map_err(|source| {
                BuildError::RemoteParameter {
                    port: choice.port,
                    channel: choice.channel,
                    name: choice.name.clone(),
                    source,
                }
            })?;
        }
        Ok(())
    }

    /// Whether the period feeds the watchdogs of a port's remotes.
    fn check_remotes<E: crate::bus::BusError>(
        &self,
        port: &SerialPort,
    ) -> Result<(), BuildError<E>> {
        let (period, needed) = (self.period, self.period * WATCHDOG_FEEDS);
        for remote in port.remotes() {
            if let Some(watchdog) = remote.watchdog().time().filter(|time| *time < needed) {
                return Err(BuildError::RemoteWatchdogTooShort {
                    port: port.layout().instance(),
                    channel: remote.started().channel,
                    watchdog,
                    needed,
                    period,
                });
            }
        }
        Ok(())
    }
}

/// Everything but the bus.
struct Built<L> {
    parts: Parts,
    board: Board,
    modules: Vec<Box<dyn Module>>,
    set_up: SetUp,
    image: crate::bus::CycleImage,
    lists: Lists<L>,
}

impl<L> Built<L> {
    fn into_driver<B: RegisterBus<List = L> + Clock>(self, bus: B, config: &Config) -> Driver<B> {
        Driver {
            bus,
            firmware: self.parts.firmware,
            name: self.parts.name,
            period: config.period,
            image: self.image,
            lists: self.lists,
            pins: self.parts.pins,
            group: self.parts.group,
            board: self.board,
            ports: self.parts.ports,
            modules: self.modules,
            set_up: self.set_up,
            places: self.parts.places,
            fpga_pins: self.parts.made,
            missing: self.parts.missing,
            remarks: self.parts.remarks,
            statistics: DriverStatistics::default(),
            news: Reply::CERTAIN,
            pacer: Pacer::new(config.modules.pace, config.period),
            read_failures: 0,
            write_failures: 0,
            writes: super::WriteNews::default(),
            look_closely: true,
            is_last: false,
            is_shut_down: false,
        }
    }
}

impl Parts {
    fn new<E: crate::bus::BusError>(firmware: HostMot2, number: u8) -> Result<Self, BuildError<E>> {
        let name = format!("hm2_{}.{number}", firmware.idrom().board_name.board());
        let places = IoPorts::locate(&firmware)?;
        let plan = PortPlan::new(&places);
        let mut pins = PinStore::new();
        let status = pins.add_group();
        let group = pins.add_group();
        Ok(Self {
            firmware,
            name,
            pins,
            group,
            status,
            plan,
            places,
            made: FpgaPins::default(),
            ports: Vec::new(),
            missing: Vec::new(),
            remarks: Vec::new(),
        })
    }

    /// What the modules of the FPGA are made from.
    fn making(&mut self) -> Making<'_> {
        Making {
            firmware: &self.firmware,
            plan: &mut self.plan,
            pins: &mut self.pins,
            group: self.group,
            board: &self.name,
            made: &mut self.made,
        }
    }

    /// The directions of the ports, if this board reads them back: only then they can tell later
    /// that they are gone.
    fn directions<B: RegisterBus + Clock>(&self, bus: &mut B) -> Result<Vec<Directions>, B::Error> {
        let mut all = Vec::new();
        let mut reads_back = false;
        for (port, setup) in (0u8..).zip(self.plan.ports()) {
            if let Some(address) = self.places.direction.address(port) {
                let outputs = setup.direction;
                reads_back |= outputs != 0 && bus.read(address)? == outputs;
                all.push(Directions::new(address, outputs));
            }
        }
        if !reads_back {
            all.clear();
        }
        Ok(all)
    }

    /// The writes that set the board up, in an order in which nothing is driven before it is
    /// ready: quiesce, configure, route, drive, enable.
    fn set_up(&self, watchdog: Watchdog, modules: &[Box<dyn Module>]) -> SetupList {
        let mut list = SetupList::default();
        // It must not bite before the cycle feeds it: discovery takes seconds. If it runs, it bites
        // now (FACTS 12.1).
        list.push(watchdog.time, WatchdogTime::DISABLED.0);
        self.places.make_inputs(&mut list);
        for module in modules {
            module.set_up(&mut list);
        }
        self.places.set_up(&mut list, &self.plan);
        for module in modules {
            module.start(&mut list);
        }
        // Older firmware starts with a bite.
        list.push(watchdog.status, 0);
        list
    }
}
