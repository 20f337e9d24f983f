//! Calls of an application other than reading and writing, during its cycles.

use std::time::Duration;

use mesa_hal::driver::{BoardState, Driver};
use mesa_hal_sim::devices::find;

use super::super::application::Application;
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{MICRO, More, Planned, WRITTEN_WATCHDOG};
use super::{Process, Scenario};
use crate::common::chance::Chance;

/// Cycles after which a port that is switched off has stopped its remotes.
const OFF_AFTER: u64 = 40;
/// Cycles of a round of requests.
const ROUND: u32 = 400;
/// A value that is requested first where another one follows.
const FIRST_REQUEST: u32 = WRITTEN_WATCHDOG - 5;
const NAME: &str = "nvwatchdogtimeout";

impl Scenario {
    /// Occasionally makes a rare call.
    pub(super) fn deeds<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
    ) -> Checked {
        let extras = self.plan.extras;
        if extras.deeds_one_in == 0 || !self.chance.one_in(extras.deeds_one_in) {
            return Ok(());
        }
        let which = self.chance.below(self.plan.remotes() as u64) as usize;
        let (port, channel) = self.plan.place(which);
        let begun = self.sim.now();
        match self.chance.below(6) {
            0 => {
                self.stage
                    .tell(begun, format!("restarts its remote {which}"));
                application.restart_one(driver, which);
            }
            1 => {
                self.proves_watchdogs(driver, application)?;
            }
            2 => {
                let name = "nvwatchdogtimeout";
                let remote = (port as u8, channel as u8);
                let value = WRITTEN_WATCHDOG;
                let done = driver.write_remote_parameter(remote, name, value);
                application.notice(driver);
                self.stage
                    .tell(begun, format!("writes {name} of remote {which}: {done:?}"));
                self.stopped_for((driver, application), begun)?;
            }
            3 => self.clears_by_pin(driver),
            4 => {
                self.switches(driver, application, port);
            }
            _ => self.waits = true,
        }
        Ok(())
    }

    /// Makes the calls that were added later, from a random stream of their own.
    pub(super) fn more_deeds<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
    ) -> Checked {
        let More {
            clears,
            switches_one_in,
            proves_one_in,
            tunes_one_in,
            ..
        } = self.plan.more;
        let now = self.sim.now();
        let often = |every: u64, side: &mut Chance| every > 0 && side.one_in(every);
        if clears && driver.board_state() != BoardState::Running && self.side.one_in(4) {
            self.clears_by_pin(driver);
        }
        if often(switches_one_in, &mut self.side) {
            let port = self.side.below(self.plan.ports.len() as u64) as usize;
            self.switches(driver, application, port);
        }
        if often(proves_one_in, &mut self.side) {
            self.proves_watchdogs(driver, application)?;
        }
        if self.plan.later.asks_twice {
            self.asks_again(driver, application);
        }
        if often(10 * tunes_one_in, &mut self.side) {
            let takes = application.takes_nonsense(driver);
            ensure(takes.is_none(), Promise::Works, now, || {
                format!("{takes:?} takes what is no number")
            })?;
        }
        Ok(())
    }

    /// Switches a port. Where that changes nothing that the oracle does not know, parameters are
    /// written while it starts again.
    fn switches<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
        port: usize,
    ) {
        let run = application.switch_port(driver, port);
        let extras = self.plan.extras;
        let is_known =
            extras.deeds_one_in > 0 || extras.remote_watchdog == u64::from(WRITTEN_WATCHDOG);
        // After the fault of a wire, a remote has to get what was requested before.
        let asks = !self.plan.later.asks_twice || self.in_write.is_some();
        if !run && is_known && asks {
            let first = if self.plan.later.asks_twice {
                FIRST_REQUEST
            } else {
                WRITTEN_WATCHDOG
            };
            self.requests(driver, port, first);
        }
        let now = self.sim.now();
        if run && self.is_first_request(port) {
            self.wire_fails_in(port);
        }
        self.stage.tell(now, format!("port {port} run: {run}"));
    }

    fn requests<B: Host>(&mut self, driver: &mut Driver<B>, port: usize, millis: u32) {
        let are_taken = Application::request_watchdogs(driver, port, millis);
        if let Some(requested) = self.requested.get_mut(port) {
            *requested = are_taken.then_some(millis);
        }
    }

    /// True if the last request for the remotes of a port is one that another one follows.
    fn is_first_request(&self, port: usize) -> bool {
        self.requested.get(port) == Some(&Some(FIRST_REQUEST))
    }

    /// Lets a wire of a port fail in the time in which its remotes get their parameters.
    fn wire_fails_in(&mut self, port: usize) {
        let remotes = (0..self.plan.remotes()).filter(|n| self.plan.place(*n).0 == port);
        let remotes: Vec<_> = remotes.collect();
        let Some(fault) = self.in_write.take() else {
            return;
        };
        let target = remotes[fault.target % remotes.len()];
        self.schedule(Planned { target, ..fault }, self.sim.now() + fault.after);
    }

    /// Occasionally requests another value than the last one, mostly while that is being written.
    fn asks_again<B: Host>(&mut self, driver: &mut Driver<B>, application: &Application) {
        for port in 0..self.requested.len() {
            let one_in = if application.is_port_off(driver, port) {
                160
            } else {
                20
            };
            if self.is_first_request(port) && self.side.one_in(one_in) {
                self.requests(driver, port, WRITTEN_WATCHDOG);
                let now = self.sim.now();
                self.stage.tell(now, format!("port {port}: requests again"));
            }
        }
    }

    /// Restarts all ports: each remote then has the value that was requested last.
    pub(super) fn parameters_are_written<B: Host>(&mut self, process: &mut Process<B>) -> Checked {
        if self.requested.iter().all(Option::is_none) {
            return Ok(());
        }
        let ports = self.requested.len();
        for port in 0..ports {
            process.application.switch_port(&mut process.driver, port);
        }
        for _ in 0..OFF_AFTER + self.oracle.off_after() / self.plan.period {
            self.cycle(process, false)?;
        }
        self.comes_back(process)?;
        let now = self.sim.now();
        for remote in 0..self.plan.remotes() {
            let (port, channel) = self.plan.place(remote);
            let Some(requested) = self.requested.get(port).copied().flatten() else {
                continue;
            };
            let kept = self.sim.on(|fpga| {
                let device = fpga.remote(port, channel).and_then(find)?;
                let mut parameters = device.parameters().into_iter();
                parameters.find_map(|(name, value)| (name == NAME).then_some(value))
            });
            ensure(kept == Some(requested.into()), Promise::Told, now, || {
                format!("remote {remote} keeps {kept:?}, and {requested} was requested last")
            })?;
        }
        Ok(())
    }

    /// Goes on with requests, and with one fault of a wire after the other: each time all remotes
    /// have the values that were requested last.
    pub(super) fn asks_in_rounds<B: Host>(&mut self, process: &mut Process<B>) -> Checked {
        while let Some(fault) = self.in_writes.pop() {
            self.in_write = Some(fault);
            for _ in 0..ROUND {
                self.cycle(process, true)?;
            }
            self.heal(&mut process.driver);
            self.comes_back(process)?;
            self.parameters_are_written(process)?;
        }
        Ok(())
    }

    /// Leaves remotes without data, to determine which of them have a watchdog.
    fn proves_watchdogs<B: Host>(
        &mut self,
        driver: &mut Driver<B>,
        application: &mut Application,
    ) -> Checked {
        let begun = self.sim.now();
        let was_well = application.all_is_well(driver).is_ok();
        let assumed = application.assumed_watchdogs(driver);
        self.proved_by_usual_time.extend(assumed);
        let done = driver.prove_watchdogs();
        application.notice(driver);
        self.stage
            .tell(begun, format!("proves the watchdogs: {done:?}"));
        self.stopped_for((driver, application), begun)?;
        let now = self.sim.now();
        let mut faults = self.stage.begun().into_iter();
        let is_quiet = faults.all(|fault| fault.ended.is_some_and(|ended| ended < begun));
        let is_quiet = is_quiet && self.host.is_empty() && was_well && done.is_ok();
        // A time written during operation is in use from the next power-up on.
        self.proved_in_trouble |= !is_quiet;
        if self.proved_in_trouble || self.plan.extras.deeds_one_in > 0 {
            return Ok(());
        }
        let expected = !self.plan.is_without_watchdog();
        let wrong = application.watchdogs(driver);
        let wrong = wrong.filter(|(remote, _)| !self.proved_by_usual_time.contains(remote));
        let wrong: Vec<_> = wrong.filter(|(_, has)| *has != expected).collect();
        ensure(wrong.is_empty(), Promise::Told, now, || {
            format!("remotes and whether they have a watchdog: {wrong:?}")
        })
    }

    /// Checks a port that is switched off: none of its remotes is armed, and after some cycles none
    /// of them transfers or has an output on.
    pub(super) fn ports_are_off<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
    ) -> Checked {
        let now = self.sim.now();
        if driver.board_state() != BoardState::Running {
            self.off.fill(0);
            return Ok(());
        }
        let is_quiet = self.stage.begun().is_empty();
        // A remote that was being restarted is switched off by its own watchdog.
        let by_watchdog = self.oracle.off_after() / self.plan.period;
        let off_after = by_watchdog + OFF_AFTER;
        for (port, cycles) in self.off.iter_mut().enumerate() {
            *cycles = if application.is_port_off(driver, port) {
                *cycles + 1
            } else {
                0
            };
            for remote in (0..self.plan.remotes()).filter(|n| self.plan.place(*n).0 == port) {
                let Some(state) = application.remote_state(driver, remote) else {
                    continue;
                };
                let is_off = !state.armed;
                ensure(is_off || *cycles == 0, Promise::Safe, now, || {
                    format!("remote {remote} is armed, though its port is switched off")
                })?;
                let is_on = self.oracle.is_on(remote)
                    || application.running(driver).any(|(n, _)| n == remote);
                ensure(
                    !is_on || *cycles < off_after || !is_quiet,
                    Promise::Safe,
                    now,
                    || {
                        format!(
                            "remote {remote} is on or runs {cycles} cycles after its port is off"
                        )
                    },
                )?;
            }
        }
        Ok(())
    }

    /// A call that stops the machine has returned: everything has safe values.
    fn stopped_for<B: Host>(
        &mut self,
        (driver, application): (&Driver<B>, &mut Application),
        begun: u64,
    ) -> Checked {
        let now = self.sim.now();
        application.was_read();
        self.validity.was_read();
        self.what_is_told.recount(driver);
        self.doubts.was_read();
        // Nothing has been written for longer than the watch.
        self.watch = None;
        self.told = None;
        // The call may have set up a board that was cleared by pin.
        self.comes_by_pin(driver, begun);
        self.look()?;
        if driver.board_state() != BoardState::Running {
            return Ok(());
        }
        let pins = driver.pins();
        let armed: Vec<_> = pins
            .groups()
            .filter_map(|group| Some((group, pins.group_state(group)?)))
            // Groups of remotes that were never there have no outputs.
            .filter(|(_, state)| state.armed && state.age.cycles < u64::MAX)
            .filter(|_| now > begun + 1_000 * MICRO)
            .collect();
        // The driver's own group is never disarmed, and has no outputs that are.
        ensure(armed.len() <= 1, Promise::Safe, now, || {
            format!("armed after a call that stops the machine: {armed:?}")
        })
    }

    /// Clears the safe state by pin, as a panel of LinuxCNC does, not by a call. The set-up is
    /// written with the next write, and nothing is armed by that.
    pub(super) fn clears_by_pin<B: Host>(&mut self, driver: &mut Driver<B>) {
        let (name, state) = (driver.name().to_owned(), driver.board_state());
        let pins = driver.pins_mut();
        match state {
            BoardState::Running => return,
            BoardState::WatchdogBitten => {
                if let Ok(pin) = pins.inout(&format!("{name}.watchdog.has_bit")) {
                    pins.set(pin, false);
                }
            }
            _ => {
                if let Ok(param) = pins.parameter(&format!("{name}.io_error")) {
                    let _ = pins.set_param(param, false);
                }
            }
        }
        self.stage
            .tell(self.sim.now(), format!("clears {state:?} by pin"));
        self.stage.set_well(Some(false));
        self.set_up_begins();
        self.is_clearing = true;
    }

    /// After a write: waits for the transfers that it started, and requests the next read ahead.
    pub(super) fn waits_for_transfers<B: Host>(&mut self, driver: &mut Driver<B>) {
        if std::mem::take(&mut self.waits) {
            let limit = Duration::from_nanos(self.plan.period / 4);
            let _ = driver.wait_transfers(limit);
        }
    }
}
