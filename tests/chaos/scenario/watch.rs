//! Detection of events in their time, and their effect on other remotes.

use mesa_hal::driver::{BoardState, Driver, Pace};

use super::super::application::Application;
use super::super::journal::{Event, What};
use super::super::network::Host;
use super::super::oracle::{Checked, PACKET, Promise, ensure};
use super::super::plan::{MILLI, Planned};
use super::Scenario;

/// Time for which a port transfers nothing while a remote is restarted (FACTS 5.7).
const ATTEMPT: u64 = 18 * MILLI;
/// The same while the remote answers only sometimes (docs/neighbours.md).
const LONG_ATTEMPT: u64 = 30 * MILLI;

/// Cycles without a reply after which a remote is offline, with some for a START.
const OFFLINE_AFTER: u32 = 100;

impl Scenario {
    /// Processes the events since the last call.
    pub(super) fn look(&mut self) -> Checked {
        let events = self.journal.take();
        if events.is_empty() {
            return Ok(());
        }
        let begun = self.stage.begun();
        let alone = begun.len() <= 1 && self.plan.faults.len() <= 1;
        events.iter().try_for_each(|event| {
            self.what_is_told.happened(event);
            self.releases(event.what);
            let is_before = self.is_before_set_up(event);
            self.steppers.happened(&event.what, is_before);
            if is_before {
                return Ok(());
            }
            self.expect_detection(event, alone);
            self.oracle.event(event, alone)
        })
    }

    /// Notes that all pins are released, or driven again. A copy of a packet can do both without a
    /// fault.
    fn releases(&mut self, what: What) {
        match what {
            What::Opened => self.has_open_pins = true,
            What::Closed => self.has_open_pins = false,
            _ => {}
        }
        match what {
            What::Closed => self.released.0 = true,
            What::Opened if self.oracle.is_setting_up() => self.released.1 |= self.released.0,
            What::Opened => self.released.0 = false,
            _ => {}
        }
    }

    /// True if pins were released, of a board that is not set up or was set up again; and if they
    /// were before the last set-up.
    pub(super) fn are_released<B: Host>(&mut self, driver: &Driver<B>) -> (bool, bool) {
        let (is_released, is_set_up) = &mut self.released;
        let is_set_up = std::mem::take(is_set_up);
        *is_released &= !is_set_up || driver.board_state() != BoardState::Running;
        (*is_released, is_set_up)
    }

    /// The set-up is written from here on. Earlier events of the board are irrelevant after it:
    /// they were detected, or there was no driver yet.
    pub(super) fn set_up_begins(&mut self) {
        self.watch = None;
        self.told = None;
        self.is_written = false;
        self.is_open = false;
        self.oracle.set_up(true);
    }

    /// The board runs. If its set-up was only renewed, no pin has changed, and there is no event.
    pub(super) fn is_set_up(&mut self) {
        self.is_open |= self.has_open_pins;
    }

    /// A driver was built. It has repeated the set-up until the board had it: events of the board
    /// before the last time are irrelevant.
    pub(super) fn set_up_ends(&mut self) {
        let opened = self.opened;
        // A remote that had a fault before it was started has reported it then.
        self.told = None;
        self.watch = self.watch.filter(|(at, ..)| opened <= at + PACKET);
        self.oracle.set_up(false);
    }

    /// True for a bite or a reset without effect, because the set-up is not written yet: it is
    /// written in one exchange, which drives the pins at its end. At its beginning it stops the
    /// watchdog, which bites if it runs (FACTS 12.1); and a reset in the middle takes a part of it.
    fn is_before_set_up(&mut self, event: &Event) -> bool {
        let (is_before, what) = match event.what {
            What::Written => {
                self.is_written = true;
                return false;
            }
            What::Opened => {
                self.is_open |= self.is_written;
                self.opened = event.at;
                // A driver sets up a board that does not run: earlier events were detected, or are
                // irrelevant after it.
                self.watch = self.watch.filter(|(at, ..)| *at >= event.at);
                return false;
            }
            What::Bite => (!self.is_open, "the watchdog bites"),
            // A long reset that begins with the set-up lets the end of it through.
            What::Reset => (false, "the FPGA is reset"),
            _ => return false,
        };
        self.stage.tell(event.at, what);
        is_before
    }

    pub(super) fn expect_detection(&mut self, event: &Event, alone: bool) {
        // A read that the board holds back can be older.
        let reads = if self.plan.pace == Pace::Board { 5 } else { 4 };
        match event.what {
            What::Bite => self.watch = self.watch.or(Some((event.at, reads, "a bite"))),
            What::Reset => self.watch = self.watch.or(Some((event.at, reads, "a reset"))),
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

    /// Checks that events were detected in their time.
    pub(super) fn detected<B: Host>(
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
        // During the restart of a neighbour the remote is not read, and its age shows that.
        let restart = *at + LONG_ATTEMPT + 5 * self.plan.period;
        if good && (state.age.cycles == 0 || now > restart) {
            *left -= 1;
        }
        let (left, at, remote) = (*left, *at, *remote);
        ensure(left > 0, Promise::Detected, now, || {
            format!("the fault of remote {remote} at {at} is not noticed")
        })
    }

    /// Checks a board that has bitten and is left alone: its lines are dead, so none of its remotes
    /// runs.
    pub(super) fn left_alone<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
        good: bool,
    ) -> Checked {
        let is_bitten = good && driver.board_state() == BoardState::WatchdogBitten;
        self.bitten = if is_bitten { self.bitten + 1 } else { 0 };
        let (now, cycles) = (self.sim.now(), self.bitten);
        let is_due = self.plan.later.leaves_bitten && cycles > OFFLINE_AFTER;
        let running = application.running(driver).next();
        ensure(running.is_none() || !is_due, Promise::Detected, now, || {
            format!("{running:?} runs {cycles} cycles after its board has bitten")
        })
    }

    /// With a remote absent for a minute, the others lose less than 0.6 % of their cycles.
    pub(super) fn lost_in_a_minute(&self) -> Checked {
        let Self {
            cycles,
            without_data,
            ..
        } = *self;
        let is_little = !self.plan.is_minute || without_data * 1000 < 6 * cycles;
        ensure(is_little, Promise::Neighbours, self.sim.now(), || {
            format!("no data in {without_data} of {cycles} cycles")
        })
    }

    /// While all faults are of one remote, the others lose nothing but the cycles of its restarts.
    pub(super) fn neighbours<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &Application,
    ) -> Checked {
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
            self.cycles += 1;
            self.without_data += u64::from(state.age.cycles > 0);
            let is_near = self.plan.place(other).0 == port;
            let attempt = match (is_near, self.plan.has_bad_wire()) {
                (true, true) => LONG_ATTEMPT,
                (true, false) => ATTEMPT,
                (false, _) => 0,
            };
            let longest = attempt + 4 * self.plan.period;
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
}
