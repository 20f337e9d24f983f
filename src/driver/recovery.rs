//! How everything becomes safe, and comes back.

use super::board::BoardCheck;
use super::evidence::Finding;
use super::{BoardState, CycleError, Driver, Rearmed};
use crate::bus::{Clock, RegisterBus, Tier};
use crate::sslbp::Channel;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Lets all outputs follow the application again, after whatever made them safe.
    ///
    /// A board that has lost its set-up gets it back first, all of it in one exchange, and is asked
    /// whether it has it. What was set before this call is forgotten, be it before the fault, while
    /// it lasted or in the same cycle: outputs that were not armed start from their safe values and
    /// follow what is set from now on. Remotes that do not run yet are counted as waiting; so is
    /// everything, if the board has lost its set-up again meanwhile.
    ///
    /// # Errors
    /// Those of the bus; then nothing is armed.
    ///
    /// # Real time
    /// As `write`, and three more exchanges when the board has to be set up again, after the reply that
    /// is waited for where the board paces. No allocation.
    pub fn rearm(&mut self) -> Result<Rearmed, CycleError<B::Error>> {
        if self.is_shut_down {
            return Err(CycleError::ShutDown);
        }
        if !self.board.is_running() {
            self.write_set_up().map_err(|source| CycleError::Write {
                source,
                consecutive: self.write_failures.saturating_add(1),
            })?;
        }
        let mut armed = 0;
        if self.board.is_running() {
            armed = self.pins.rearm_all();
        }
        let waiting = self
            .pins
            .groups()
            .filter_map(|group| self.pins.group_state(group))
            .filter(|state| !state.armed)
            .count();
        Ok(Rearmed { armed, waiting })
    }

    /// Restarts a remote in the next cycles, which clears the faults it reports: at once, but for
    /// one that was set aside not before its own watchdog must have bitten. Its outputs are safe
    /// until it is re-armed.
    pub fn restart(&mut self, port: u8, channel: Channel) {
        let now = self.bus.now();
        if let Some(port) = self.ports.get_mut(usize::from(port)) {
            port.restart(channel, &mut self.pins, now);
        }
    }

    /// Writes the set-up that the board has lost. If the board shows that it has it, it runs, and so
    /// does its watchdog; else everything stays as it is.
    pub(super) fn write_set_up(&mut self) -> Result<(), B::Error> {
        let now = self.bus.now();
        // What was asked for before says nothing of the board as it is now.
        self.forget_posted();
        // An FPGA without its configuration could have it again in the middle of the exchange, and
        // take the end of the set-up, which drives the pins, without its beginning.
        let reply = self
            .image
            .exchange_status(&mut self.bus, &self.lists.image)?;
        self.heard(reply);
        if let BoardCheck::NotThere(_) = self.board.check(&self.image) {
            return Ok(());
        }
        for (port, directions) in self.set_up.directions().enumerate() {
            if let Some(expected) = self.board.evidence.port_mut(port) {
                expected.outputs = directions;
            }
        }
        let is_set_up = match self.set_up.run(&mut self.bus, &self.lists.set_up) {
            Ok((reply, words)) => {
                self.news = self.news.and(reply);
                Ok(self.board.evidence.is_set_up(words))
            }
            Err(error) => Err(error),
        };
        if !matches!(is_set_up, Ok(true)) {
            // It may be set up, and nobody feeds it.
            let _ = self.set_up.quiesce(&mut self.bus, &self.lists.set_up);
            return is_set_up.map(|_| ());
        }
        self.image.forget_requests();
        self.look_closely = true;
        for module in &mut self.modules {
            module.restarted();
        }
        for port in &mut self.ports {
            port.restart_all(&mut self.pins, now);
        }
        self.board.restored();
        self.read_failures = 0;
        self.write_failures = 0;
        Ok(())
    }

    /// Changes what drives the pins, where the application wants another pin driven. That could
    /// drive what the rest of the set-up protects, so the board shows before and after it that it
    /// is set up. What did not arrive is tried again with the next write.
    pub(super) fn open_gates(&mut self) -> Result<(), B::Error> {
        if !self.board.is_running() || self.set_up.changed().is_none() {
            return Ok(());
        }
        self.forget_posted();
        self.look_closely = true;
        self.look()?;
        while self.board.is_running() {
            let Some((port, sure, after)) = self.set_up.changed() else {
                break;
            };
            if let Some(expected) = self.board.evidence.port_mut(port) {
                expected.outputs = sure;
            }
            let feed = self.board.evidence.has_time();
            self.set_up
                .open_gate(&mut self.bus, &self.lists.set_up, port, feed)?;
            if feed {
                let now = self.bus.now();
                self.board.evidence.fed(now);
            }
            self.look()?;
            if !self.board.evidence.shows(&self.image, port, after) {
                break;
            }
            if let Some(expected) = self.board.evidence.port_mut(port) {
                expected.outputs = after;
            }
            self.set_up.gate_is_open(port);
        }
        Ok(())
    }

    /// Reads all evidence alone, and makes everything safe if the board is not set up any more.
    fn look(&mut self) -> Result<(), B::Error> {
        let reply = self
            .image
            .exchange_evidence(&mut self.bus, &self.lists.image)?;
        self.heard(reply);
        let now = self.bus.now();
        let finding = self
            .board
            .evidence
            .examine(&self.image, Tier::Evidence, now, true);
        self.found(finding);
        Ok(())
    }

    /// Makes everything safe if the board is not set up any more.
    pub(super) fn found(&mut self, finding: Finding) {
        match finding {
            Finding::Sound => {}
            Finding::Bitten => self.fail(BoardState::WatchdogBitten),
            Finding::Reset => self.fail(BoardState::Reset),
        }
    }

    /// Makes all pins inputs, in each cycle in which the board is known not to be set up: whatever
    /// comes late drives them for no longer.
    pub(super) fn keep_quiet(&mut self) {
        let is_lost = matches!(
            self.board.state(),
            BoardState::WatchdogBitten | BoardState::Reset
        );
        if is_lost {
            // What fails here fails in the write that follows, which says so.
            let _ = self.set_up.quiesce(&mut self.bus, &self.lists.set_up);
        }
    }

    /// A read failed as a whole; how many in a row.
    pub(super) fn read_failed(&mut self) -> u32 {
        self.statistics.read_errors += 1;
        self.read_failures = self.read_failures.saturating_add(1);
        self.look_closely = true;
        for port in &mut self.ports {
            port.not_read(&mut self.pins);
        }
        if self.board.count_exchange(&mut self.pins, true) {
            self.fail(BoardState::BusDown);
        }
        self.board.publish(&mut self.pins, &self.statistics);
        self.read_failures
    }

    /// The board leaves the running state; everything is safe from now on.
    pub(super) fn fail(&mut self, state: BoardState) {
        if self.board.fail(state) {
            let count = match state {
                BoardState::WatchdogBitten => &mut self.statistics.watchdog_bites,
                BoardState::Reset => &mut self.statistics.resets,
                BoardState::BusDown | BoardState::Running => &mut self.statistics.bus_down,
            };
            *count += 1;
        }
        self.make_safe();
    }

    /// All inputs are not valid, all outputs safe until re-armed.
    pub(super) fn make_safe(&mut self) {
        self.pins.fault(self.group);
        for port in &mut self.ports {
            port.make_safe(&mut self.pins);
        }
    }
}
