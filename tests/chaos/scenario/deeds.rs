//! What an application calls besides reading and writing, in the middle of its cycles.

use std::time::Duration;

use mesa_hal::driver::{BoardState, Driver};

use super::super::application::Application;
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{MICRO, WRITTEN_WATCHDOG};
use super::Scenario;

impl Scenario {
    /// Does something that is rare, now and then.
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
                let done = driver.prove_watchdogs();
                application.notice(driver);
                self.stage
                    .tell(begun, format!("proves the watchdogs: {done:?}"));
                self.stopped_for(driver, begun)?;
            }
            2 => {
                let name = "nvwatchdogtimeout";
                let place = (port as u8, channel as u8);
                let value = WRITTEN_WATCHDOG;
                let done = driver.write_remote_parameter(place.0, place.1, name, value);
                application.notice(driver);
                self.stage
                    .tell(begun, format!("writes {name} of remote {which}: {done:?}"));
                self.stopped_for(driver, begun)?;
            }
            3 => self.clears_by_pin(driver),
            4 => {
                let run = application.switch_port(driver, port);
                self.stage.tell(begun, format!("port {port} run: {run}"));
            }
            _ => self.waits = true,
        }
        Ok(())
    }

    /// A call that stops the machine has returned: everything has safe values.
    fn stopped_for<B: Host>(&mut self, driver: &Driver<B>, begun: u64) -> Checked {
        let now = self.sim.now();
        self.what_is_told.recount(driver);
        // Nobody has written for so long.
        self.watch = None;
        self.told = None;
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

    /// Clears what made everything safe, as a panel of LinuxCNC does: by pin, and not by a call. The
    /// set-up is written with the next write, and nothing is armed by that.
    fn clears_by_pin<B: Host>(&mut self, driver: &mut Driver<B>) {
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
    }

    /// After a write: waits for the transfers that it started, and asks for the next read ahead.
    pub(super) fn waits_for_transfers<B: Host>(&mut self, driver: &mut Driver<B>) {
        if std::mem::take(&mut self.waits) {
            let limit = Duration::from_nanos(self.plan.period / 4);
            let _ = driver.wait_transfers(limit);
        }
    }
}
