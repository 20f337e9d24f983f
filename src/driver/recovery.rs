//! Recovery: re-arming of outputs, and restarts of remotes.

use super::{CycleError, Driver, Rearmed};
use crate::bus::{Clock, RegisterBus};
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
    /// when they run again: this call arms them, and counts them as coming, unless a fault comes
    /// first. Values set until then are discarded as well. Other remotes that do not run yet are
    /// counted as waiting only; so are all groups if the board has lost its set-up again meanwhile.
    ///
    /// # Errors
    /// Those of the bus, and [`CycleError::OtherFirmware`]; nothing is armed then.
    ///
    /// # Real time
    /// As `write`, and nine more exchanges when the board has to be set up again, after the reply
    /// that is waited for where the board paces. No allocation.
    pub fn rearm(&mut self) -> Result<Rearmed, CycleError<B::Error>> {
        if !self.cycle.is_running() {
            self.write_set_up()?;
        }
        let now = self.bus.now();
        Ok(self.cycle.rearm(now))
    }

    /// Restarts a remote in the next cycles, which clears the faults that it reports: a running remote
    /// at once, one that is offline not before its own watchdog must have bitten. Its outputs are
    /// safe until it is re-armed. Returns `false`, without any effect, if no remote takes part there.
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
