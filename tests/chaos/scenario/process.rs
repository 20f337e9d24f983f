//! Processes: building the driver, and the ways to end.

use std::time::Duration;

use mesa_hal::driver::{
    Driver, FaultPolicy, GpioConfig, NotReached, Presence, RemoteConfig, SerialConfig, Settings,
};
use mesa_hal_sim::FaultKind;
use std::collections::BTreeMap;

use super::super::application::Application;
use super::super::machine::unit_number;
use super::super::network::{Host, Life};
use super::super::oracle::{Checked, Failure, Promise, ensure};
use super::super::plan::{LONGEST_WATCHDOG, MILLI, Moment, WRITTEN_WATCHDOG};
use super::{Process, Scenario};

/// Faults of a remote that goes on answering.
const REPORTED: [FaultKind; 4] = [
    FaultKind::RemoteLowVoltage,
    FaultKind::RemoteHighVoltage,
    FaultKind::RemoteOverTemperature,
    FaultKind::RemoteNoEnable,
];

impl Scenario {
    /// A new process builds its driver. With a fault the build may fail, but then everything is
    /// off; without a fault it must succeed.
    pub(super) fn start<B: Host>(
        &mut self,
        connect: &impl Fn(Life) -> Result<B, String>,
    ) -> Result<Process<B>, Failure> {
        self.stage.set_well(None);
        self.told = None;
        self.requested.fill(None);
        for attempt in 0..2 {
            let at = self.sim.now();
            // Earlier events that made an attempt fail were reported by that failure.
            self.look()?;
            self.set_up_begins();
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
                Ok(mut process) => {
                    self.set_up_ends();
                    let found = process.application.remotes();
                    ensure(
                        found == self.plan.remotes() || troubled,
                        Promise::Works,
                        now,
                        || format!("{:?}", process.driver.missing()),
                    )?;
                    // A remote with a fault that it reports answers: it is offline, not missing.
                    let begun = self.stage.begun();
                    let mut kinds = begun.iter().map(|begun| begun.planned.kind);
                    let answer =
                        kinds.all(|kind| kind.fault_bit().is_some() && REPORTED.contains(&kind));
                    ensure(
                        found == self.plan.remotes() || had_bus_fault || !answer,
                        Promise::Works,
                        now,
                        || format!("with a reported fault: {:?}", process.driver.missing()),
                    )?;
                    let why = "before anything was commanded";
                    self.oracle.check_board_off(now, why)?;
                    let out_of_reach = self.out_of_reach();
                    for remote in 0..self.plan.remotes() {
                        if !out_of_reach.contains(&remote) {
                            self.oracle.check_remote_off(remote, now, why)?;
                        }
                    }
                    // A new process starts armed, with everything off.
                    self.oracle.rearmed(None);
                    self.is_armed = false;
                    self.is_refused_a_period(&mut process.driver)?;
                    self.what_is_told.begin(&process.driver);
                    self.doubts.begin(&process.driver);
                    self.stage.tell(now, format!("built, {found} remotes"));
                    return Ok(process);
                }
                Err(error) => {
                    self.oracle.set_up(false);
                    self.stage.tell(now, format!("not built: {error}"));
                    ensure(troubled && attempt == 0, Promise::Works, now, || error)?;
                    let why = "after the driver was not built";
                    if self.plan.is_without_watchdog() {
                        self.oracle.check_board_off(now, why)?;
                    } else {
                        self.oracle.check_all_off(now, why)?;
                    }
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

    pub(super) fn build<B: Host>(
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
        let driver = Driver::start(bus, self.configured());
        let driver = driver.map_err(|error| error.to_string())?;
        let application = Application::new(&driver, &self.plan, &self.gpio);
        Ok(Process {
            application: application.map_err(|error| error.to_string())?,
            driver,
            life,
        })
    }

    pub(super) fn configured(&self) -> Settings {
        let plan = &self.plan;
        let mut policy = FaultPolicy::default();
        if !plan.is_minute {
            policy.first_backoff = Duration::from_millis(20);
            policy.longest_backoff = Duration::from_millis(300);
        }
        policy.stale_after = plan.extras.stale_after;
        let mut settings = Settings {
            period: Duration::from_nanos(plan.period),
            watchdog: Some(Duration::from_nanos(plan.watchdog)),
            pace: plan.pace,
            fault_policy: policy,
            bus_error_limit: plan.extras.bus_error_limit,
            ..Settings::default()
        };
        let mut numbers = 0..;
        for (port, cards) in plan.ports.iter().enumerate() {
            let mut channels = BTreeMap::new();
            for (channel, card) in cards.iter().enumerate() {
                let mode = if card.is_field() { plan.field_mode } else { 0 };
                let unit = unit_number(*card, numbers.next().unwrap_or_default());
                let remote = RemoteConfig {
                    mode,
                    unit_number: Some(unit),
                    presence: [Presence::Any, Presence::Optional, Presence::Required]
                        [usize::from(plan.extras.presence)],
                    kind: card.table(),
                };
                channels.insert(channel as u8, remote);
            }
            let config = SerialConfig { channels };
            settings.serial_ports.insert(port as u8, config);
        }
        for &pin in &self.gpio.outputs {
            let config = GpioConfig {
                output: true,
                ..GpioConfig::default()
            };
            settings.gpio.push((pin as u16, config));
        }
        settings
    }

    pub(super) fn kill_is_due(&self) -> bool {
        let now = self.sim.now();
        let mut host = self.host.iter();
        host.any(|(at, fault)| fault.kind == FaultKind::HostKilled && *at <= now)
    }

    /// The process is killed, and started again after a while.
    pub(super) fn killed<B: Host>(
        &mut self,
        process: Process<B>,
        connect: &impl Fn(Life) -> Result<B, String>,
    ) -> Result<Process<B>, Failure> {
        self.host
            .retain(|(_, fault)| fault.kind != FaultKind::HostKilled);
        self.leave(process, 2)?;
        self.start(connect)
    }

    /// Ends the process: 0 in order, 1 by dropping the driver, otherwise killed.
    pub(super) fn leave<B: Host>(&mut self, process: Process<B>, how: u64) -> Checked {
        let Process {
            driver,
            application,
            life,
        } = process;
        let now = self.sim.now();
        let was_well = application.all_is_well(&driver).is_ok();
        let mut left = None;
        if how >= 2 {
            life.kill(now);
            self.stage.tell(now, "the process is killed");
            drop(driver);
            self.oracle.no_commands(now);
        } else {
            if how == 0 {
                let are_off = self.idles(&driver, &application, was_well)?;
                let (_, stopped) = driver.shutdown();
                let not_reached = stopped.err().map(|error| error.not_reached);
                let not_reached = not_reached.unwrap_or_default();
                ensure(
                    not_reached.is_empty() || !are_off,
                    Promise::Told,
                    self.sim.now(),
                    || format!("{not_reached:?}, but all watchdogs have bitten long ago"),
                )?;
                left = Some(not_reached);
            } else {
                drop(driver);
            }
            self.oracle.no_commands(now);
            self.has_stopped(&application, left.as_deref(), was_well)?;
        }
        self.all_goes_off(&application, left.as_deref())
    }

    /// Leaves a sound machine alone before it is stopped, for longer than the times of its
    /// watchdogs. Returns true if its outputs are known to be off by then.
    fn idles<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
        was_well: bool,
    ) -> Result<bool, Failure> {
        let is_known = !self.plan.is_without_watchdog()
            && application.assumed_watchdogs(driver).is_empty()
            && application.watchdogs(driver).all(|(_, has)| has);
        if !self.plan.later.idles_before_stop || !was_well || !is_known {
            return Ok(false);
        }
        let until = self.sim.now() + LONGEST_WATCHDOG + self.oracle.off_after() + 50 * MILLI;
        while self.sim.now() < until {
            self.sim.pass(MILLI);
            self.look()?;
            self.oracle.check(self.sim.now())?;
        }
        Ok(true)
    }

    /// The driver was stopped in order: everything is off except the remotes that it reports as not
    /// reached.
    pub(super) fn has_stopped(
        &mut self,
        application: &Application,
        left: Option<&[NotReached]>,
        was_well: bool,
    ) -> Checked {
        let now = self.sim.now();
        self.sim.pass(MILLI);
        self.look()?;
        let begun = self.stage.begun();
        let is_quiet = begun.iter().all(|b| b.ended.is_some_and(|end| end < now));
        // A remote with a fault only goes off by its own watchdog.
        let is_noticed = self.watch.is_none();
        let now = self.sim.now();
        if is_quiet && was_well && is_noticed {
            self.oracle
                .check_all_off(now, "after the driver was shut down")?;
        }
        self.only_these_are_on(application, left)
    }

    /// Remotes without a watchdog that a fault of their own keeps from the new driver: nothing
    /// switches off what a killed process has left on.
    fn out_of_reach(&self) -> Vec<usize> {
        let begun = self.stage.begun();
        let present = begun.iter().filter(|begun| begun.ended.is_none());
        let without = present.filter(|_| self.plan.is_without_watchdog());
        without.map(|begun| begun.planned.target).collect()
    }

    /// Checks that every remote that is still on was reported as possibly on.
    fn only_these_are_on(&self, application: &Application, left: Option<&[NotReached]>) -> Checked {
        let Some(left) = left else { return Ok(()) };
        let said = left.iter().filter_map(|one| application.number(one.remote));
        let said: Vec<usize> = said.collect();
        let now = self.sim.now();
        // Here cards are exchanged in no time: the report of the other card, a bite as after each
        // power-up, is taken for that of the own one, whose watchdog has not bitten yet. After an
        // exchange by hand it has.
        let begun = self.stage.begun();
        let is_swapped = |remote: usize| {
            let mut begun = begun.iter().map(|begun| begun.planned);
            begun.any(|fault| fault.kind == FaultKind::WireSwapped && fault.target == remote)
        };
        // A remote that has not started was named at the start.
        let mut driven = application.numbers();
        let silent = driven.find(|remote| {
            self.oracle.is_on(*remote) && !said.contains(remote) && !is_swapped(*remote)
        });
        ensure(silent.is_none(), Promise::Told, now, || {
            format!("remote {silent:?} is on after the stop, which names only {left:?}")
        })
    }

    /// The process has ended, and outputs that it left on are switched off by the watchdogs, where
    /// there are some.
    pub(super) fn all_goes_off(
        &mut self,
        application: &Application,
        left: Option<&[NotReached]>,
    ) -> Checked {
        let watchdog = self.plan.extras.remote_watchdog;
        for _ in 0..20 + watchdog.max(WRITTEN_WATCHDOG.into()) / 5 {
            self.sim.pass(5 * MILLI);
            self.look()?;
            self.oracle.check(self.sim.now())?;
        }
        self.steppers_stand()?;
        let why = "after the process ended and all watchdogs have bitten";
        if self.plan.is_without_watchdog() {
            self.only_these_are_on(application, left)?;
            return self.oracle.check_board_off(self.sim.now(), why);
        }
        self.oracle.check_all_off(self.sim.now(), why)
    }
}
