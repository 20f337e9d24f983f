//! One scenario from power-up to the end.

mod deeds;
mod process;
mod told;
mod validity;
mod watch;

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::driver::{BoardState, Driver, Pace};
use mesa_hal::sim::{BoardConfig, FaultKind, Place, SimBoard};
use mesa_hal::transport::Faulty;
use mesa_hal::transport::udp::{Link, UdpBus, UdpConfig};

use super::application::Application;
use super::journal::Journal;
use super::machine::{Gpio, machine};
use super::network::{Bad, ChaosLink, Direct, Host, Life, Network, Sim};
use super::oracle::{Checked, Failure, Oracle, Promise, ensure};
use super::plan::{Board, MICRO, MILLI, Plan, Planned, Stranger};
use super::stage::{Player, Stage};
use crate::common::chance::Chance;
use told::Told;
use validity::Validity;

/// A machine that is well again is so after this time.
const COMES_BACK_IN: u64 = 3_000 * MILLI;

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
        took: 0,
        is_written: false,
        is_open: false,
        opened: 0,
        told: None,
        is_armed: false,
        cycles: 0,
        without_data: 0,
        validity: Validity::default(),
        what_is_told: Told::default(),
        waits: false,
        stranger: (u64::MAX, false),
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
            network.borrow_mut().link.new_socket();
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

#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
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
    /// How long the last good read took.
    took: u64,
    /// The set-up is written, as far as the simulator knows: since the driver began to build, or to
    /// restore the board, a register was written, and then a pin was driven.
    is_written: bool,
    is_open: bool,
    /// When a pin was driven first after none was.
    opened: u64,
    /// A remote has told of a fault: its number, since when, its faults before, and how many good
    /// reads may miss it.
    told: Option<(usize, u64, u64, u32)>,
    /// All was armed once.
    is_armed: bool,
    /// Cycles of remotes without faults of their own, and those without new data.
    cycles: u64,
    without_data: u64,
    validity: Validity,
    what_is_told: Told,
    /// The next write is followed by a wait for its transfers.
    waits: bool,
    /// When something else is there instead of the board, and whether it is.
    stranger: (u64, bool),
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
                self.stranger.0 = self.stranger.0.min(start + fault.after + fault.lasts / 2);
            }
        }
        let end = start + self.plan.run;
        while self.sim.now() < end {
            self.cycle(&mut process, true)?;
            if self.kill_is_due() {
                process = self.killed(process, &connect)?;
            }
        }
        self.lost_in_a_minute()?;
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
                    Pace::Host if self.plan.is_homing => self.plan.period * 7 / 2,
                    Pace::Host => self.plan.period * 3 / 2,
                    // Where packets also wait in the board, longer delays make a write later than
                    // it can be told.
                    Pace::Board => self.plan.period / 2,
                };
                network.borrow_mut().add(Bad {
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
                FaultKind::FpgaReset => network.borrow_mut().link.resets.push((at, 0)),
                FaultKind::FpgaResetLong => network.borrow_mut().link.resets.push((at, lasts)),
                _ => {}
            },
            _ => {}
        }
        self.stage.schedule(fault, at);
    }

    /// One period of the application.
    fn cycle<B: Host>(&mut self, process: &mut Process<B>, is_wild: bool) -> Checked {
        let Process {
            driver,
            application,
            life,
        } = process;
        let started = self.sim.now();
        self.bus_faults(driver, started);
        self.other_master();
        if is_wild {
            self.strangers(true);
        }
        if self.plan.extras.reads_ahead && is_wild {
            driver.request_read();
            self.sim.pass(self.plan.period / 10);
        }
        let read = driver.read();
        let good = read.is_ok();
        self.what_is_told.read(good);
        let others = read.map_or(0, |report| report.others);
        let has_other = self.plan.extras.second_master;
        ensure(others == 0 || has_other, Promise::Works, started, || {
            format!("{others} packets of another master, and there is none")
        })?;
        // The age of what the board itself shows counts from the end of the read that brought it,
        // which is not this one if this one failed.
        if good {
            self.took = match self.plan.pace {
                Pace::Host => self.sim.now() - started,
                Pace::Board => deadline(&self.plan),
            };
        }
        application.notice(driver);
        self.look()?;
        application.check_inputs(driver, &self.stage, self.took)?;
        self.validity(driver, application, good)?;
        self.detected(driver, application, good)?;
        self.neighbours(driver, application)?;
        if is_wild {
            self.habits(driver, application)?;
        }
        let idle_one_in = self.plan.habits.idle_one_in;
        let set_anew = !is_wild || !self.chance.one_in(idle_one_in);
        if is_wild {
            self.host_faults(life, false);
        }
        application.command(driver, &mut self.chance, (is_wild, set_anew));
        application.announce(driver, &mut self.oracle, self.sim.now());
        let written = driver.write();
        self.what_is_told.written(written.is_ok());
        application.notice(driver);
        if is_wild {
            self.waits_for_transfers(driver);
            self.host_faults(life, true);
        }
        if self.plan.pace == Pace::Host {
            let passed = self.sim.now() - started;
            self.sim.pass(self.plan.period.saturating_sub(passed));
        }
        self.look()?;
        self.told_truly(driver, application)?;
        self.oracle.check(self.sim.now())?;
        if self.stranger.1 && self.plan.extras.stranger != Stranger::None {
            self.oracle.check_stranger(self.sim.now())?;
        }
        let well = application.all_is_well(driver).is_ok();
        self.stage.set_well(Some(well));
        self.is_armed |= well;
        Ok(())
    }

    /// What the application does besides.
    fn habits<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
    ) -> Checked {
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
                self.rearm(driver, application)?;
            }
        }
        if often(habits.settings_one_in, &mut self.chance) {
            let what = application.change_setting(driver, &mut self.chance);
            self.stage.tell(self.sim.now(), what);
        }
        self.deeds(driver, application)?;
        if often(habits.index_one_in, &mut self.chance) {
            application.ask_for_index(driver, &mut self.chance, self.sim.now());
        }
        Ok(())
    }

    fn rearm<B: Host>(&mut self, driver: &mut Driver<B>, application: &mut Application) -> Checked {
        let was_down = driver.board_state() != BoardState::Running;
        self.look()?;
        if was_down {
            self.stage.set_well(Some(false));
            self.set_up_begins();
        }
        self.oracle.rearmed(None);
        let done = driver.rearm();
        if was_down && done.is_ok() {
            self.oracle.remotes_come();
        }
        application.rearmed(driver, was_down);
        self.look()?;
        self.oracle.set_up(false);
        if was_down {
            self.stage
                .tell(self.sim.now(), format!("re-armed: {done:?}"));
        }
        Ok(())
    }

    /// Something else answers from the middle of the first fault on, or the own board again.
    fn strangers(&mut self, comes: bool) {
        let (at, is_there) = self.stranger;
        if is_there != comes && (!comes || self.sim.now() >= at) {
            self.stranger.1 = comes;
            self.sim.exchange(self.plan.extras.stranger, !comes);
        }
    }

    /// The application is late or stands still, after its write, before it, or in an exchange.
    fn host_faults(&mut self, life: &Life, after_write: bool) {
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
            // In a read: after the write, the next exchange is one.
            if after_write && fault.dice & 2 != 0 {
                life.pause(time);
                continue;
            }
            // Somebody looks all the time, though not the application.
            for _ in 0..time / MILLI {
                self.sim.pass(MILLI);
            }
        }
    }

    /// Another program switches an LED of the board, of which no reply comes here.
    fn other_master(&mut self) {
        if let Sim::Network(network) = &self.sim
            && self.plan.extras.second_master
            && self.chance.one_in(6)
        {
            let packet = [0x81, 0xC2, 0x00, 0x02, self.chance.below(2) as u8, 0, 0, 0];
            let _ = network.borrow_mut().link.send(&packet);
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

    fn end_faults(&mut self) {
        let now = self.sim.now();
        self.stage.end_all(now);
        self.host.clear();
        self.strangers(false);
        if let Sim::Network(network) = &self.sim {
            let mut network = network.borrow_mut();
            network.heal();
            network.link.resets.clear();
        }
        self.sim.pass(MICRO);
        while self.sim.is_in_reset() {
            self.sim.pass(MILLI);
        }
    }

    fn heal<B: Host>(&mut self, driver: &mut Driver<B>) {
        driver.bus_mut().heal();
        self.end_faults();
        self.stage.tell(self.sim.now(), "all faults have ended");
    }

    /// With all faults over, the machine is armed again, and outputs follow.
    fn comes_back<B: Host>(&mut self, process: &mut Process<B>) -> Checked {
        let until = self.sim.now() + COMES_BACK_IN;
        let (mut cycles, mut well) = (0u64, 0);
        while well < 6 {
            self.cycle(process, false)?;
            let Process {
                driver,
                application,
                ..
            } = process;
            well += 1;
            if let Err(why) = application.all_is_well(driver) {
                well = 0;
                let now = self.sim.now();
                ensure(now < until, Promise::ComesBack, now, || {
                    format!("{} ms after all faults ended: {why}", COMES_BACK_IN / MILLI)
                })?;
            }
            application.switch_ports_on(driver);
            if self.plan.habits.restarts && cycles == 5 {
                application.restart_all(driver);
            }
            if cycles % 20 == 3 {
                self.rearm(driver, application)?;
            }
            cycles += 1;
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
}
