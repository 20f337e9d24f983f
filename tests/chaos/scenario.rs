//! One scenario from power-up to the end.

mod acts;
mod deeds;
mod doubts;
mod faults;
mod lock;
mod process;
mod runs;
mod steppers;
mod told;
mod validity;
mod watch;

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::driver::{BoardState, CycleReport, Driver, Pace};
use mesa_hal::transport::Faulty;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal_sim::{BoardConfig, FaultPlace, SimBoard};

use super::application::Application;
use super::journal::Journal;
use super::machine::{Gpio, machine};
use super::network::{ChaosLink, Direct, Host, Life, Network, Sim};
use super::oracle::{Checked, Failure, Oracle, Promise, ensure};
use super::plan::{Board, MILLI, Plan, Planned, Stranger};
use super::stage::{Player, Stage};
use crate::common::chance::Chance;
use acts::Acts;
use doubts::Doubts;
use lock::Lock;
use steppers::StepperWatch;
use told::{Others, Told};
use validity::Validity;

/// A machine must have recovered within this time.
const COMES_BACK_IN: u64 = 3_000 * MILLI;

/// Runs a plan. Its events are on the stage.
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
        has_open_pins: false,
        opened: 0,
        released: (false, false),
        told: None,
        is_armed: false,
        cycles: 0,
        without_data: 0,
        validity: Validity::default(),
        steppers: StepperWatch::default(),
        what_is_told: Told::default(),
        doubts: Doubts::default(),
        acts: Acts::default(),
        waits: false,
        stranger: (u64::MAX, false),
        side: Chance(super::plan::scrambled(plan.seed ^ 0x0DD5)),
        others: Others::default(),
        lock: Lock::default(),
        jitters_from: u64::MAX,
        sampled_before: 0,
        is_clearing: false,
        proved_in_trouble: false,
        proved_by_usual_time: BTreeSet::new(),
        came_by_pin: false,
        off: vec![0; plan.ports.len()],
        bitten: 0,
        requested: vec![None; plan.ports.len()],
        in_write: None,
        in_writes: Vec::new(),
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
    /// Faults that the application itself causes, or injects into its bus.
    host: Vec<(u64, Planned)>,
    /// The board was found bitten or reset: the time, the number of good reads that may miss it,
    /// and the name of the event.
    watch: Option<(u64, u32, &'static str)>,
    /// Duration of the last good read.
    took: u64,
    /// The set-up is written according to the simulator: since the driver began to build, or to
    /// restore the board, a register was written, and then a pin was driven.
    is_written: bool,
    is_open: bool,
    /// Pins are driven now.
    has_open_pins: bool,
    /// Time at which the first pin was driven after none was.
    opened: u64,
    /// All pins were released since the last set-up; and before the set-up that was written since
    /// the last read.
    released: (bool, bool),
    /// A remote has reported a fault: its number, the time, its earlier faults, and the number of
    /// good reads that may miss it.
    told: Option<(usize, u64, u64, u32)>,
    /// Everything has been armed once.
    is_armed: bool,
    /// Cycles of remotes without faults of their own, and those without new data.
    cycles: u64,
    without_data: u64,
    validity: Validity,
    steppers: StepperWatch,
    what_is_told: Told,
    doubts: Doubts,
    acts: Acts,
    /// The next write is followed by a wait for its transfers.
    waits: bool,
    /// Time at which the board is replaced, and true while it is.
    stranger: (u64, bool),
    /// A separate random stream for later additions, so that earlier plans stay unchanged.
    side: Chance,
    others: Others,
    lock: Lock,
    /// Reads are late from this time on, each by a different delay.
    jitters_from: u64,
    /// Longest time before a read at which the encoders may have been latched.
    sampled_before: u64,
    /// The safe state was cleared by pin, and the set-up follows with one of the next writes.
    is_clearing: bool,
    /// Watchdogs were tested while a fault was present: one that did not answer counts as off
    /// since.
    proved_in_trouble: bool,
    /// Remotes whose watchdogs were tested although the driver had not read their times.
    proved_by_usual_time: BTreeSet<usize>,
    /// The board came back by pin, and nothing was re-armed since: the next re-arming is for the
    /// remotes that come with it.
    came_by_pin: bool,
    /// Cycles since each port was switched off.
    off: Vec<u64>,
    /// Consecutive good reads of a board that has bitten.
    bitten: u32,
    /// The value of a parameter that was requested last of the remotes of each port.
    requested: Vec<Option<u32>>,
    /// The fault of a wire to come while parameters are written, so long after the start of a port:
    /// no other parameter is requested after it. And those of the next rounds.
    in_write: Option<Planned>,
    in_writes: Vec<Planned>,
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
            if self.plan.later.asks_twice && fault.kind.place() == FaultPlace::Wire {
                self.in_writes.push(fault);
            } else if !fault.in_build {
                self.schedule(fault, start + fault.after);
                self.stranger.0 = self.stranger.0.min(start + fault.after + fault.lasts / 2);
            }
        }
        self.in_write = self.in_writes.pop();
        let end = start + self.plan.run;
        let middle = start + self.plan.run / 2;
        if self.plan.more.jitter > 0 {
            self.jitters_from = middle;
        }
        while self.sim.now() < end {
            if self.plan.more.runs && self.sim.now() >= middle {
                self.plan.more.runs = false;
                self.runs(process, end)?;
                process = self.start(&connect)?;
                continue;
            }
            self.cycle(&mut process, true)?;
            if self.kill_is_due() {
                process = self.killed(process, &connect)?;
            }
        }
        self.lost_in_a_minute()?;
        self.others_are_told()?;
        self.heal(&mut process.driver);
        if process.application.remotes() < self.plan.remotes() {
            // Some remotes were absent when the driver was built.
            self.leave(process, 0)?;
            process = self.start(&connect)?;
        }
        self.comes_back(&mut process)?;
        self.steppers_arrive(&mut process)?;
        if self.plan.later.asks_twice {
            self.parameters_are_written(&mut process)?;
            self.asks_in_rounds(&mut process)?;
        }
        let leaves = self.plan.habits.leaves;
        self.leave(process, leaves)
    }

    /// One period of the application.
    fn cycle<B: Host>(&mut self, process: &mut Process<B>, is_wild: bool) -> Checked {
        let Process {
            driver,
            application,
            life,
        } = process;
        let begun = self.sim.now();
        self.before_read(driver, is_wild);
        let started = self.sim.now();
        if self.plan.extras.reads_ahead && is_wild {
            driver.request_read();
            self.sim.pass(self.plan.period / 10);
        }
        if is_wild && self.plan.later.follows {
            driver.follow();
        }
        let report = driver.read().ok();
        self.after_read((driver, application, life), (report, started), is_wild)?;
        let written = driver.write();
        self.what_is_told.written(written.is_ok());
        application.notice(driver);
        if is_wild {
            self.waits_for_transfers(driver);
            self.host_faults(life, true);
        }
        if self.plan.pace == Pace::Host {
            let passed = self.sim.now() - begun;
            self.sim.pass(self.plan.period.saturating_sub(passed));
        }
        self.look()?;
        self.told_truly(driver, application)?;
        self.ports_are_off(driver, application)?;
        self.acts_cover(driver, application)?;
        self.stands_now(driver, application)
    }

    /// Events of the machine before it is read.
    fn before_read<B: Host>(&mut self, driver: &mut Driver<B>, is_wild: bool) {
        let now = self.sim.now();
        self.bus_faults(driver, now);
        // Data that depend on a write that may have preceded the read are not taken while the other
        // program stays.
        if is_wild || !self.plan.more.master_stays {
            self.other_master();
        }
        if is_wild {
            self.strangers(true);
            if now >= self.jitters_from {
                let most = self.plan.period * self.plan.more.jitter / 100;
                self.sim.pass(self.side.below(most));
            }
        }
    }

    /// Evaluates a read, and sets the outputs of the next write.
    fn after_read<B: Host>(
        &mut self,
        (driver, application, life): (&mut Driver<B>, &mut Application, &Life),
        (report, started): (Option<CycleReport>, u64),
        is_wild: bool,
    ) -> Checked {
        let good = report.is_some();
        self.what_is_told.read(good);
        self.hears_others(report.map_or(0, |report| report.foreign_packets))?;
        // The age of the board's own values counts from the end of the read that returned them,
        // which is not this one if this one failed.
        if good {
            self.took = match self.plan.pace {
                Pace::Host => self.sim.now() - started,
                Pace::Board => deadline(&self.plan),
            };
        }
        self.locks(report, started, is_wild)?;
        application.notice(driver);
        self.look()?;
        let age = (self.took, self.sampled_before);
        let released = self.are_released(driver);
        application.check_inputs(driver, &self.stage, age, released)?;
        self.losses_are_told(driver, good)?;
        self.validity(driver, application, good)?;
        self.detected(driver, application, good)?;
        self.left_alone(driver, application, good)?;
        self.steppers(driver, application, good)?;
        self.neighbours(driver, application)?;
        if is_wild {
            self.habits(driver, application)?;
            self.more_deeds(driver, application)?;
            self.acts_early(driver, application)?;
        }
        let idle_one_in = self.plan.habits.idle_one_in;
        let set_anew = !is_wild || !self.chance.one_in(idle_one_in);
        if is_wild {
            self.host_faults(life, false);
        }
        application.command(driver, &mut self.chance, (is_wild, set_anew));
        application.announce(driver, &mut self.oracle, self.sim.now());
        self.doubts.asks(driver);
        Ok(())
    }

    /// Notes that the board, cleared by pin, has been set up, at `at` or later. Until the bus
    /// works, the set-up is tried with each write.
    fn comes_by_pin<B: Host>(&mut self, driver: &Driver<B>, at: u64) {
        let runs = driver.board_state() == BoardState::Running;
        if self.is_clearing && runs {
            self.is_clearing = false;
            self.is_set_up();
            self.oracle.set_up(false);
            self.came_by_pin = true;
            self.oracle.remotes_are_asked(at);
        }
        self.came_by_pin &= runs;
    }

    /// Checks the current outputs of the machine.
    fn stands_now<B: Host>(&mut self, driver: &Driver<B>, application: &Application) -> Checked {
        self.comes_by_pin(driver, self.sim.now());
        self.oracle.check(self.sim.now())?;
        if self.stranger.1 && self.plan.extras.stranger != Stranger::None {
            self.oracle.check_stranger(self.sim.now())?;
        }
        let well = application.all_is_well(driver).is_ok();
        self.stage.set_well(Some(well));
        self.is_armed |= well;
        Ok(())
    }

    /// Further actions of the application.
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
        self.is_clearing = false;
        let has_come = std::mem::take(&mut self.came_by_pin);
        if (was_down || has_come) && done.is_ok() {
            self.oracle.remotes_come();
        }
        application.rearmed(driver, was_down);
        self.look()?;
        if was_down && done.is_ok() {
            // A copy of an older packet can drive pins just before the set-up arrives.
            self.oracle.forget_before(self.opened);
            self.is_set_up();
        }
        self.oracle.set_up(false);
        if was_down {
            self.stage
                .tell(self.sim.now(), format!("re-armed: {done:?}"));
        }
        Ok(())
    }

    /// Re-arms what runs. A board that has lost its set-up gets it with one of the next writes.
    fn rearm_when_running<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
    ) -> Checked {
        let was_down = driver.board_state() != BoardState::Running;
        self.look()?;
        if was_down {
            self.stage.set_well(Some(false));
            self.set_up_begins();
            self.is_clearing = true;
        }
        self.oracle.rearmed(None);
        let done = driver.rearm_when_running();
        application.rearmed(driver, was_down);
        for remote in application.coming(driver) {
            self.oracle.comes(remote);
        }
        if was_down {
            let now = self.sim.now();
            let what = format!("to be re-armed when it runs: {done:?}");
            self.stage.tell(now, what);
        }
        Ok(())
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
            // Valid inputs may be as old as the application permits: the outputs need not have
            // followed.
            let is_well = application.all_is_well(driver);
            if let Err(why) = is_well.and_then(|()| application.all_have_news(driver)) {
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
            let clears = self.plan.more.clears && cycles < 12;
            if clears {
                self.clears_by_pin(driver);
            } else if (cycles % 20 == 3 || cycles == 12) && !self.has_acted() {
                let state = driver.board_state();
                let runs = !self.plan.more.clears || state == BoardState::Running;
                let now = self.sim.now();
                ensure(runs || cycles != 12, Promise::ComesBack, now, || {
                    format!("the board is {state:?} after it was cleared by pin")
                })?;
                if self.plan.later.when_running {
                    self.rearm_when_running(driver, application)?;
                } else {
                    self.rearm(driver, application)?;
                }
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
            // The last write is on its way. A whole period, so that the DPLL finds the next read at
            // the phase of before.
            self.sim.pass(self.plan.period);
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
        )?;
        let led = application.expected_led();
        // The other program sets the LED as well.
        let led = led.filter(|_| !self.plan.extras.second_master);
        ensure(
            led.is_none_or(|led| led == self.sim.is_lit()),
            Promise::ComesBack,
            now,
            || format!("the LED is not as it was set: {led:?}"),
        )
    }
}
