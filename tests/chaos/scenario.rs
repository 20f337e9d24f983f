//! One scenario from power-up to the end.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::driver::{
    BoardState, Builder, Driver, FaultPolicy, GpioConfig, Pace, RemoteConfig, SerialConfig,
};
use mesa_hal::sim::{BoardConfig, FaultKind, Place, SimBoard};
use mesa_hal::transport::Faulty;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

use super::application::Application;
use super::chance::Chance;
use super::journal::{Event, Journal, What};
use super::machine::{Gpio, machine};
use super::network::{Bad, ChaosLink, Direct, Host, Life, Network, Sim};
use super::oracle::{Checked, Failure, Oracle, Promise, ensure};
use super::plan::{Board, Card, MICRO, MILLI, Moment, Plan, Planned};
use super::stage::{Player, Stage};

/// A machine that is well again is so after this time.
const COMES_BACK_IN: u64 = 3_000 * MILLI;
/// While a remote is restarted its port transfers nothing for so long (FACTS 5.7).
const ATTEMPT: u64 = 18 * MILLI;

/// Runs a plan. What happened is on the stage.
pub fn run(plan: &Plan, stage: &Stage) -> Checked {
    let journal = Journal::default();
    let (mut fpga, gpio) = machine(plan, &journal);
    let player = Player::new(stage, plan, &gpio, &journal);
    fpga.set_director(Box::new(player));
    let scenario = |sim| Scenario {
        plan: plan.clone(),
        chance: Chance(super::plan::scrambled(plan.seed ^ 0xA99)),
        sim,
        stage: stage.clone(),
        journal: journal.clone(),
        oracle: Oracle::new(plan),
        gpio: gpio.clone(),
        host: Vec::new(),
        watch: None,
        told: None,
        is_armed: false,
    };
    if plan.is_network {
        let name = if plan.board == Board::I7i97 {
            "7I97"
        } else {
            "7I92"
        };
        let board = SimBoard::new(BoardConfig::new(name), fpga);
        let network = Rc::new(RefCell::new(Network::new(board, plan.seed)));
        let config = UdpConfig {
            cycle_deadline: Duration::from_nanos(deadline(plan)),
            ..UdpConfig::default()
        };
        scenario(Sim::Network(Rc::clone(&network))).play(|life| {
            network.borrow_mut().new_socket();
            let link = ChaosLink {
                network: Rc::clone(&network),
                life,
            };
            UdpBus::new(link, config).map_err(|error| error.to_string())
        })
    } else {
        let fpga = Rc::new(RefCell::new(fpga));
        scenario(Sim::Embedded(Rc::clone(&fpga))).play(|life| {
            let direct = Direct {
                fpga: Rc::clone(&fpga),
                life,
            };
            Ok(Faulty::new(direct, plan.seed))
        })
    }
}

fn deadline(plan: &Plan) -> u64 {
    plan.period * 3 / 5
}

struct Scenario {
    plan: Plan,
    chance: Chance,
    sim: Sim,
    stage: Stage,
    journal: Journal,
    oracle: Oracle,
    gpio: Gpio,
    /// Faults that the application itself brings about, or lets its bus have.
    host: Vec<(u64, Planned)>,
    /// The board was found bitten or reset: since when, and how many good reads may miss it.
    watch: Option<(u64, u32, &'static str)>,
    /// A remote has told of a fault: its number, since when, its faults before, and how many good
    /// reads may miss it.
    told: Option<(usize, u64, u64, u32)>,
    /// All was armed once.
    is_armed: bool,
}

/// A process: the driver, its application, and its end.
struct Process<B: Host> {
    driver: Driver<B>,
    application: Application,
    life: Life,
}

impl Scenario {
    fn play<B: Host>(mut self, connect: impl Fn(Life) -> Result<B, String>) -> Checked {
        let start = self.sim.now();
        for fault in self.plan.faults.clone() {
            if fault.in_build {
                self.schedule(fault, start + fault.after);
            }
        }
        let mut process = self.start(&connect)?;
        let start = self.sim.now();
        for fault in self.plan.faults.clone() {
            if !fault.in_build {
                self.schedule(fault, start + fault.after);
            }
        }
        let end = start + self.plan.run;
        while self.sim.now() < end {
            self.cycle(&mut process, true)?;
            if self.kill_is_due() {
                process = self.killed(process, &connect)?;
            }
        }
        self.heal(&mut process.driver);
        if process.application.remotes() < self.plan.remotes() {
            // Some were not there when the driver was built.
            self.leave(process, 0)?;
            process = self.start(&connect)?;
        }
        self.comes_back(&mut process)?;
        let leaves = self.plan.habits.leaves;
        self.leave(process, leaves)
    }

    fn schedule(&mut self, fault: Planned, at: u64) {
        let Planned {
            kind, lasts, dice, ..
        } = fault;
        match (kind.place(), &self.sim) {
            (Place::Bus, _) if fault.in_build => {
                // By the number of the exchange: nobody can act while the driver is built.
                self.host.push((0, fault));
                return;
            }
            (Place::Bus | Place::Host, _) => self.host.push((at, fault)),
            (Place::Network, Sim::Network(network)) => {
                let one_in = [1, 2, 5, 20][(dice % 4) as usize];
                let longest = match self.plan.pace {
                    Pace::Host => self.plan.period * 3 / 2,
                    // Where packets also wait in the board, longer delays make a write later than
                    // it can be told.
                    Pace::Board => self.plan.period / 2,
                };
                network.borrow_mut().faults.push(Bad {
                    kind,
                    from: at,
                    until: at + lasts,
                    one_in: if kind == FaultKind::NetworkDown {
                        1
                    } else {
                        one_in
                    },
                    delay: longest,
                });
            }
            (Place::Fpga, Sim::Network(network)) => match kind {
                FaultKind::FpgaReset => network.borrow_mut().resets.push((at, 0)),
                FaultKind::FpgaResetLong => network.borrow_mut().resets.push((at, lasts)),
                _ => {}
            },
            _ => {}
        }
        self.stage.schedule(fault, at);
    }

    /// A new process builds its driver. With a fault that may fail, but then everything is off;
    /// and without it does not.
    fn start<B: Host>(
        &mut self,
        connect: &impl Fn(Life) -> Result<B, String>,
    ) -> Result<Process<B>, Failure> {
        self.stage.set_well(None);
        self.watch = None;
        self.told = None;
        for attempt in 0..2 {
            let at = self.sim.now();
            let active = self.stage.begun().iter().any(|begun| begun.ended.is_none());
            let had_bus_fault = !self.host.is_empty();
            let built = self.build(connect);
            self.look()?;
            let now = self.sim.now();
            let troubled = active
                || had_bus_fault
                || self
                    .stage
                    .begun()
                    .iter()
                    .any(|b| b.ended.is_none_or(|ended| ended >= at));
            match built {
                Ok(process) => {
                    let found = process.application.remotes();
                    ensure(
                        found == self.plan.remotes() || troubled,
                        Promise::Works,
                        now,
                        || format!("{:?}", process.driver.missing()),
                    )?;
                    self.oracle
                        .check_all_off(now, "before anything was commanded")?;
                    // A new process starts armed, with everything off.
                    self.oracle.rearmed(None);
                    self.is_armed = false;
                    self.stage.tell(now, format!("built, {found} remotes"));
                    return Ok(process);
                }
                Err(error) => {
                    self.stage.tell(now, format!("not built: {error}"));
                    ensure(troubled && attempt == 0, Promise::Works, now, || error)?;
                    self.oracle
                        .check_all_off(now, "after the driver was not built")?;
                    self.end_faults();
                    self.sim.pass(100 * MILLI);
                    self.look()?;
                }
            }
        }
        Err(Failure {
            promise: Promise::Works,
            at: self.sim.now(),
            text: "a machine without faults is not built".to_owned(),
        })
    }

    fn build<B: Host>(
        &mut self,
        connect: &impl Fn(Life) -> Result<B, String>,
    ) -> Result<Process<B>, String> {
        let life = Life::default();
        let mut bus = connect(life.clone())?;
        for (_, fault) in self.host.extract_if(.., |(at, _)| *at == 0) {
            let skip = if fault.dice & 1 == 0 {
                fault.dice % 15
            } else {
                15 + fault.dice % 1500
            };
            let count = 1 + fault.dice % 3;
            bus.fail(fault.kind, skip, count);
            let moment = if skip < 15 {
                Moment::Start
            } else {
                Moment::Discovery
            };
            self.stage.note_fault(fault.kind, moment);
            self.stage.tell(
                0,
                format!("{} at exchange {skip} of the set-up", fault.kind),
            );
        }
        let driver = self.configured(Driver::builder(bus)).build();
        let driver = driver.map_err(|error| error.to_string())?;
        let application = Application::new(&driver, &self.plan, &self.gpio);
        Ok(Process {
            application: application.map_err(|error| error.to_string())?,
            driver,
            life,
        })
    }

    fn configured<B: Host>(&self, builder: Builder<B>) -> Builder<B> {
        let plan = &self.plan;
        let mut builder = builder
            .period(Duration::from_nanos(plan.period))
            .watchdog(Duration::from_nanos(plan.watchdog))
            .pace(plan.pace)
            .fault_policy(FaultPolicy {
                first_backoff: Duration::from_millis(20),
                longest_backoff: Duration::from_millis(300),
                ..FaultPolicy::default()
            });
        for (port, cards) in plan.ports.iter().enumerate() {
            let mut config = SerialConfig::NONE;
            for (channel, card) in cards.iter().enumerate() {
                let mode = if *card == Card::Field {
                    plan.field_mode
                } else {
                    0
                };
                config = config.with(channel as u8, RemoteConfig::in_mode(mode));
            }
            builder = builder.serial_port(port as u8, config);
        }
        for &pin in &self.gpio.outputs {
            let config = GpioConfig {
                output: true,
                ..GpioConfig::default()
            };
            builder = builder.gpio(pin as u16, config);
        }
        builder
    }

    /// One period of the application.
    fn cycle<B: Host>(&mut self, process: &mut Process<B>, is_wild: bool) -> Checked {
        let Process {
            driver,
            application,
            ..
        } = process;
        let started = self.sim.now();
        self.bus_faults(driver, started);
        let good = driver.read().is_ok();
        let took = match self.plan.pace {
            Pace::Host => self.sim.now() - started,
            Pace::Board => deadline(&self.plan),
        };
        application.notice(driver);
        self.look()?;
        application.check_inputs(driver, &self.stage, took)?;
        self.detected(driver, application, good)?;
        self.neighbours(driver, application)?;
        if is_wild {
            self.habits(driver, application);
        }
        let idle_one_in = self.plan.habits.idle_one_in;
        let set_anew = !is_wild || !self.chance.one_in(idle_one_in);
        if is_wild {
            self.host_faults(false);
        }
        application.command(driver, &mut self.chance, set_anew);
        application.announce(driver, &mut self.oracle, self.sim.now());
        let _ = driver.write();
        application.notice(driver);
        if is_wild {
            self.host_faults(true);
        }
        if self.plan.pace == Pace::Host {
            let passed = self.sim.now() - started;
            self.sim.pass(self.plan.period.saturating_sub(passed));
        }
        self.look()?;
        self.oracle.check(self.sim.now())?;
        let well = application.all_is_well(driver).is_ok();
        self.stage.set_well(Some(well));
        self.is_armed |= well;
        Ok(())
    }

    /// Takes what happened since.
    fn look(&mut self) -> Checked {
        let events = self.journal.take();
        if events.is_empty() {
            return Ok(());
        }
        let begun = self.stage.begun();
        let alone = begun.len() <= 1 && self.plan.faults.len() <= 1;
        events.iter().try_for_each(|event| {
            self.expect_detection(event, alone);
            self.oracle.event(event, alone)
        })
    }

    fn expect_detection(&mut self, event: &Event, alone: bool) {
        // A read that the board holds back can be older.
        let reads = if self.plan.pace == Pace::Board { 5 } else { 4 };
        match event.what {
            What::Bite => {
                self.stage.tell(event.at, "the watchdog bites");
                self.watch = self.watch.or(Some((event.at, reads, "a bite")));
            }
            What::Reset => {
                self.stage.tell(event.at, "the FPGA is reset");
                self.watch = self.watch.or(Some((event.at, reads, "a reset")));
            }
            What::Faults(remote, faults) => {
                self.stage
                    .tell(event.at, format!("remote {remote} has faults {faults:02x}"));
                let is_told = |fault: &Planned| fault.kind.fault_bit().is_some();
                if faults != 0 && alone && self.is_armed && self.plan.faults.iter().all(is_told) {
                    self.told = self.told.or(Some((remote, event.at, u64::MAX, reads)));
                }
            }
            _ => {}
        }
    }

    /// Whether what has happened was noticed in its time.
    fn detected<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
        good: bool,
    ) -> Checked {
        let now = self.sim.now();
        if driver.board_state() != BoardState::Running {
            self.watch = None;
            self.told = None;
        }
        if let Some((at, left, what)) = &mut self.watch
            && good
        {
            *left -= 1;
            let (left, at, what) = (*left, *at, *what);
            ensure(left > 0, Promise::Detected, now, || {
                format!("{what} at {at} is not noticed")
            })?;
        }
        let Some((remote, at, faults, left)) = &mut self.told else {
            return Ok(());
        };
        let state = application.remote_state(driver, *remote);
        let Some(state) = state.filter(|state| state.armed && state.faults <= *faults) else {
            self.told = None;
            return Ok(());
        };
        *faults = state.faults;
        if good {
            *left -= 1;
        }
        let (left, at, remote) = (*left, *at, *remote);
        ensure(left > 0, Promise::Detected, now, || {
            format!("the fault of remote {remote} at {at} is not noticed")
        })
    }

    /// While all faults are of one remote, the others lose nothing but what a restart costs.
    fn neighbours<B: Host>(&mut self, driver: &Driver<B>, application: &Application) -> Checked {
        let (Some(victim), true) = (self.plan.victim(), self.is_armed) else {
            return Ok(());
        };
        let now = self.sim.now();
        let (port, _) = self.plan.place(victim);
        for other in (0..self.plan.remotes()).filter(|n| *n != victim) {
            let Some(state) = application.remote_state(driver, other) else {
                continue;
            };
            ensure(state.armed, Promise::Neighbours, now, || {
                format!("remote {other} is not armed, though only remote {victim} has faults")
            })?;
            let is_near = self.plan.place(other).0 == port;
            let longest = if is_near { ATTEMPT } else { 0 } + 4 * self.plan.period;
            ensure(
                state.age.time.as_nanos() <= longest.into(),
                Promise::Neighbours,
                now,
                || {
                    format!(
                        "remote {other} has no data for {:?}, though only remote {victim} has faults",
                        state.age.time
                    )
                },
            )?;
        }
        Ok(())
    }

    /// What the application does besides.
    fn habits<B: Host>(&mut self, driver: &mut Driver<B>, application: &mut Application) {
        let habits = self.plan.habits;
        let is_well = application.all_is_well(driver).is_ok();
        let often = |every: u64, chance: &mut Chance| every > 0 && chance.one_in(every);
        if often(habits.rearm_every, &mut self.chance)
            || (!is_well && often(habits.rearm_when_safe, &mut self.chance))
        {
            if self.chance.one_in(4) && driver.board_state() == BoardState::Running {
                let which = self.chance.below(application.remotes().max(1) as u64) as usize;
                if let Some(remote) = application.rearm_one(driver, which) {
                    self.oracle.rearmed(Some(remote));
                }
            } else {
                self.rearm(driver, application);
            }
        }
        if often(habits.settings_one_in, &mut self.chance) {
            let what = application.change_setting(driver, &mut self.chance);
            self.stage.tell(self.sim.now(), what);
        }
        if often(habits.index_one_in, &mut self.chance) {
            application.ask_for_index(driver, self.sim.now());
        }
    }

    fn rearm<B: Host>(&mut self, driver: &mut Driver<B>, application: &mut Application) {
        let was_down = driver.board_state() != BoardState::Running;
        // What goes wrong in it comes after it.
        let _ = self.look();
        self.oracle.rearmed(None);
        let done = driver.rearm();
        application.rearmed(driver, was_down);
        if was_down {
            self.stage
                .tell(self.sim.now(), format!("re-armed: {done:?}"));
        }
    }

    /// The application is late or stands still, after its write or before it.
    fn host_faults(&mut self, after_write: bool) {
        let now = self.sim.now();
        let due = |(at, fault): &mut (u64, Planned)| {
            *at > 0
                && *at <= now
                && (fault.dice & 1 == 1) == after_write
                && matches!(fault.kind, FaultKind::HostLate | FaultKind::HostStall)
        };
        let due: Vec<_> = self.host.extract_if(.., due).collect();
        for (_, fault) in due {
            let time = if fault.kind == FaultKind::HostLate {
                self.plan.watchdog / 2
            } else {
                2 * self.plan.watchdog + fault.lasts.min(100 * MILLI)
            };
            // Somebody looks all the time, though not the application.
            for _ in 0..time / MILLI {
                self.sim.pass(MILLI);
            }
        }
    }

    fn bus_faults<B: Host>(&mut self, driver: &mut Driver<B>, now: u64) {
        let due = |(at, fault): &mut (u64, Planned)| {
            *at > 0 && *at <= now && fault.kind.place() == Place::Bus
        };
        for (_, fault) in self.host.extract_if(.., due) {
            let count = (fault.lasts / self.plan.period).clamp(1, 12);
            driver.bus_mut().fail(fault.kind, fault.dice % 2, count);
        }
    }

    fn kill_is_due(&self) -> bool {
        let now = self.sim.now();
        let mut host = self.host.iter();
        host.any(|(at, fault)| fault.kind == FaultKind::HostKilled && *at <= now)
    }

    /// The process is killed, and after a while somebody starts it again.
    fn killed<B: Host>(
        &mut self,
        process: Process<B>,
        connect: &impl Fn(Life) -> Result<B, String>,
    ) -> Result<Process<B>, Failure> {
        self.host
            .retain(|(_, fault)| fault.kind != FaultKind::HostKilled);
        self.leave(process, 2)?;
        self.start(connect)
    }

    fn end_faults(&mut self) {
        let now = self.sim.now();
        self.stage.end_all(now);
        self.host.clear();
        if let Sim::Network(network) = &self.sim {
            let mut network = network.borrow_mut();
            network.faults.clear();
            network.resets.clear();
        }
        self.sim.pass(MICRO);
    }

    fn heal<B: Host>(&mut self, driver: &mut Driver<B>) {
        driver.bus_mut().heal();
        self.end_faults();
        self.stage.tell(self.sim.now(), "all faults have ended");
    }

    /// With all faults over, the machine is armed again, and outputs follow.
    fn comes_back<B: Host>(&mut self, process: &mut Process<B>) -> Checked {
        let until = self.sim.now() + COMES_BACK_IN;
        let mut cycles = 0u64;
        loop {
            self.cycle(process, false)?;
            let Process {
                driver,
                application,
                ..
            } = process;
            match application.all_is_well(driver) {
                Ok(()) => break,
                Err(why) => {
                    let now = self.sim.now();
                    ensure(now < until, Promise::ComesBack, now, || {
                        format!("{} ms after all faults ended: {why}", COMES_BACK_IN / MILLI)
                    })?;
                }
            }
            if self.plan.habits.restarts && cycles == 5 {
                application.restart_all(driver);
            }
            if cycles % 20 == 3 {
                self.rearm(driver, application);
            }
            cycles += 1;
        }
        for _ in 0..6 {
            self.cycle(process, false)?;
        }
        let Process {
            driver,
            application,
            ..
        } = process;
        let now = self.sim.now();
        if self.plan.is_network {
            // The last write is on its way.
            self.sim.pass(self.plan.period / 4);
            self.look()?;
        }
        application.all_is_well(driver).map_err(|text| Failure {
            promise: Promise::ComesBack,
            at: now,
            text,
        })?;
        let lags = (0..self.plan.remotes()).find(|remote| !self.oracle.follows(*remote));
        ensure(lags.is_none(), Promise::ComesBack, now, || {
            format!("remote {lags:?} does not follow")
        })?;
        let expected = application.expected_board();
        ensure(
            self.oracle.board_follows(&expected),
            Promise::ComesBack,
            now,
            || {
                let lags = self.oracle.board_lags(&expected);
                format!("the board does not follow: {lags}")
            },
        )
    }

    /// The process ends: 0 in order, 1 by dropping the driver, else it is killed.
    fn leave<B: Host>(&mut self, process: Process<B>, how: u64) -> Checked {
        let Process {
            mut driver, life, ..
        } = process;
        let now = self.sim.now();
        if how >= 2 {
            life.kill(now);
            self.stage.tell(now, "the process is killed");
            drop(driver);
            self.oracle.nobody_commands(now);
        } else {
            if how == 0 {
                let _ = driver.shutdown();
            }
            drop(driver);
            self.oracle.nobody_commands(now);
            self.sim.pass(MILLI);
            self.look()?;
            let is_quiet = self
                .stage
                .begun()
                .iter()
                .all(|b| b.ended.is_some_and(|end| end < now));
            if is_quiet {
                self.oracle
                    .check_all_off(self.sim.now(), "after the driver was shut down")?;
            }
        }
        for _ in 0..20 {
            self.sim.pass(5 * MILLI);
            self.look()?;
            self.oracle.check(self.sim.now())?;
        }
        self.oracle
            .check_all_off(self.sim.now(), "100 ms after the process ended")
    }
}
