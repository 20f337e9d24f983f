//! Recovery: re-arming of outputs, and restarts of remotes.

use super::{CycleError, Driver, Rearmed};
use crate::bus::{Clock, RegisterBus};
use crate::hal::{ArmingEvent, GroupId, PinError};
use crate::hostmot2::RemoteId;
use crate::sslbp::Channel;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Lets all outputs follow the application again, after any fault that made them safe.
    ///
    /// A board that has lost its set-up gets it back first, all of it in one exchange, provided
    /// that the same firmware answers; the board's evidence is then checked. Values set before this
    /// call are discarded, whether before the fault, during it or in the same cycle: outputs that
    /// were not armed start from their safe values and follow the values set from now on.
    ///
    /// After a bite or a reset the board's own outputs follow with the next good read, and remotes
    /// when they run again: this call arms them, and counts them as pending, unless a fault comes
    /// first. Values set until then are discarded as well. Other remotes that do not run yet are
    /// counted as waiting only; so are all groups if the board has lost its set-up again meanwhile.
    ///
    /// # Errors
    /// Those of the bus, and [`CycleError::OtherFirmware`]; nothing is armed then.
    ///
    /// # Real time
    /// As `write`, and nine more exchanges when the board has to be set up again, after the reply
    /// that is waited for where the board paces. No allocation.
    pub fn rearm(&mut self) -> Result<Rearmed, CycleError> {
        self.restore()?;
        let now = self.bus.now();
        Ok(self.cycle.rearm(now))
    }

    /// Gives a board that has lost its set-up all of it back, in one exchange, and arms nothing:
    /// its inputs are valid with the next good reads, remotes start again, and all outputs stay
    /// safe until they are re-armed. For a machine that shall show its inputs while an operator
    /// decides. No effect on a board that runs, and on one that does not answer as a `HostMot2`, as
    /// during a reset: call it again then.
    ///
    /// # Errors
    /// Those of the bus, and [`CycleError::OtherFirmware`].
    ///
    /// # Real time
    /// None if the board runs; else as [`rearm`](Self::rearm). No allocation.
    pub fn restore(&mut self) -> Result<(), CycleError> {
        if self.cycle.is_running() {
            return Ok(());
        }
        let now = self.bus.now();
        let set_up = self.cycle.begin_set_up(now);
        self.run(set_up)
    }

    /// Lets all outputs follow the application: groups that run at once, and every other group as
    /// soon as it runs, unless a new fault comes before. Values set until then are discarded.
    ///
    /// A board that has lost its set-up gets it back with one of the next writes, and again with
    /// each write until it succeeds. A group is counted as [pending](Rearmed::rearm_pending) until
    /// it is armed or its arming is cancelled:
    /// - by any fault of the board that is found after this call: a bite, a reset, a bus that is
    ///   down, another firmware ([`RearmCancelled`](super::EventKind::RearmCancelled));
    /// - for a remote, if it goes offline again, if it does not come up with the board, or after
    ///   its port was switched on, because of a fault of its own, or if an attempt to start it
    ///   finds another device, or a fault that it had not reported before
    ///   ([`RemoteRearmCancelled`](super::EventKind::RemoteRearmCancelled)). An attempt that fails
    ///   as before is no new fault: a remote that was offline at the call and is plugged in an hour
    ///   later is armed;
    /// - by [`restart`](Self::restart) of the remote, by switching its port off, and by
    ///   [`cancel_rearm`](Self::cancel_rearm).
    ///
    /// A remote that fails alone after it was armed needs another call, and so does a remote of a
    /// port that is switched off, which counts as waiting only.
    ///
    /// ```
    /// # use mesa_hal::{Clock, Driver, Settings};
    /// # use mesa_hal_sim::{devices, machines};
    /// # let mut driver = Driver::start(machines::i7i92_with_cards(), Settings::default())?;
    /// # let cycles = |driver: &mut Driver<mesa_hal_sim::SimFpga>, count| {
    /// #     for _ in 0..count {
    /// #         let _ = driver.read();
    /// #         let _ = driver.write();
    /// #         let period = driver.period();
    /// #         driver.bus_mut().wait(period);
    /// #     }
    /// # };
    /// # let cable = |driver: &mut Driver<mesa_hal_sim::SimFpga>, is_in: bool| {
    /// #     let remote = driver.bus_mut().remote_mut(0, 2).expect("a remote");
    /// #     let cable = devices::find_cable(remote).expect("a cable");
    /// #     if is_in { cable.replug() } else { cable.unplug() }
    /// # };
    /// # cycles(&mut driver, 10);
    /// # cable(&mut driver, false);
    /// # cycles(&mut driver, 100);
    /// // A card is unplugged, and the operator asks for everything already.
    /// let rearmed = driver.rearm_when_running();
    /// assert_eq!((rearmed.waiting, rearmed.rearm_pending), (1, 1));
    /// # cable(&mut driver, true);
    /// # cycles(&mut driver, 6_000);
    /// // It is plugged in, and is armed without another call.
    /// assert_eq!(driver.rearm_when_running().waiting, 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Real time
    /// No exchange; a few steps for each group. No allocation. The set-up of a board that has lost
    /// it takes eight more exchanges in the write that does it.
    pub fn rearm_when_running(&mut self) -> Rearmed {
        let now = self.bus.now();
        self.cycle.rearm_when_running(now)
    }

    /// Lets the outputs of one group follow the application: at once if it runs, and otherwise as
    /// soon as it does, as [`rearm_when_running`](Self::rearm_when_running). Returns true if the
    /// group is armed; [`GroupState::rearm_pending`](crate::hal::GroupState::rearm_pending)
    /// indicates later if it is still awaited.
    ///
    /// On a board that has lost its set-up the group is armed when the board has the set-up back,
    /// which another call asks for.
    ///
    /// # Errors
    /// [`PinError::PortOff`] for a remote of a port that is switched off;
    /// [`PinError::ForeignHandle`].
    ///
    /// # Real time
    /// A few steps for each remote. No allocation.
    pub fn rearm_group_when_running(&mut self, group: GroupId) -> Result<bool, PinError> {
        self.cycle.rearm_group_when_running(group)
    }

    /// Lets no group be armed without another call: withdraws
    /// [`rearm_when_running`](Self::rearm_when_running) and what is
    /// [pending](Rearmed::rearm_pending). Returns the number of groups that were to be armed.
    ///
    /// # Real time
    /// Constant time for each group. No allocation.
    pub fn cancel_rearm(&mut self) -> u32 {
        self.cycle.pins.change_all_arming(ArmingEvent::Cancel)
    }

    /// Restarts a remote in the next cycles, which clears the faults that it reports: a running
    /// remote at once, one that is offline not before its own watchdog must have bitten. Its
    /// outputs are safe until it is re-armed. Returns `false`, without any effect, if no remote
    /// takes part there.
    pub fn restart(&mut self, remote: impl Into<RemoteId>) -> bool {
        let RemoteId { port, channel } = remote.into();
        let now = self.bus.now();
        let port = self.cycle.parts.ports.get_mut(usize::from(port));
        let Some((port, channel)) = port.zip(Channel::new(channel)) else {
            return false;
        };
        let is_there = port.remote(channel).is_some();
        port.restart(channel.mask(), &mut self.cycle.pins, now);
        is_there
    }
}
