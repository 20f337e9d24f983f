//! How everything becomes safe, and comes back.

use super::{BoardState, CycleError, Driver, Rearmed};
use crate::bus::RegisterBus;
use crate::sslbp::Channel;

impl<B: RegisterBus> Driver<B> {
    /// Lets all outputs follow the application again, after whatever made them safe.
    ///
    /// A board that has lost its set-up gets it back first. What was set before this call is
    /// forgotten, be it before the fault, while it lasted or in the same cycle: outputs that were
    /// not armed start from their safe values and follow what is set from now on. Remotes that do
    /// not run yet are counted as waiting.
    ///
    /// # Errors
    /// Those of the bus; then nothing is armed.
    ///
    /// # Real time
    /// As `write`; one more exchange for each 64 registers when the board has to be set up again.
    /// No allocation.
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
        let armed = self.pins.rearm_all();
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

    /// Writes the set-up that the board has lost. Its watchdog runs again from the next write on.
    pub(super) fn write_set_up(&mut self) -> Result<(), B::Error> {
        let now = self.bus.now();
        self.restore.run(&mut self.bus)?;
        // What was asked for before says nothing of the board as it is now.
        self.pacer.forget_posted();
        self.is_restored = true;
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

    /// A read failed as a whole; how many in a row.
    pub(super) fn read_failed(&mut self) -> u32 {
        self.statistics.read_errors += 1;
        self.read_failures = self.read_failures.saturating_add(1);
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
