//! How everything becomes safe, and comes back.

use super::{CycleError, Driver, Rearmed};
use crate::bus::{Clock, RegisterBus};
use crate::hostmot2::RemoteId;
use crate::sslbp::Channel;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Lets all outputs follow the application again, after whatever made them safe.
    ///
    /// A board that has lost its set-up gets it back first, all of it in one exchange, and is asked
    /// whether it has it; if it is the same firmware that answers. What was set before this call is
    /// forgotten, be it before the fault, while it lasted or in the same cycle: outputs that were not
    /// armed start from their safe values and follow what is set from now on.
    ///
    /// After a bite or a reset the board's own outputs follow with the next good read, and remotes
    /// when they run again: they are counted as coming, and armed by this call, unless a fault comes
    /// before. What is set until then is forgotten as well. Other remotes that do not run yet are
    /// counted as waiting only; so is everything, if the board has lost its set-up again meanwhile.
    ///
    /// # Errors
    /// Those of the bus, and [`CycleError::OtherFirmware`]; then nothing is armed.
    ///
    /// # Real time
    /// As `write`, and eight more exchanges when the board has to be set up again, after the reply that
    /// is waited for where the board paces. No allocation.
    pub fn rearm(&mut self) -> Result<Rearmed, CycleError<B::Error>> {
        if !self.cycle.is_running() {
            self.write_set_up()?;
        }
        let now = self.bus.now();
        Ok(self.cycle.rearm(now))
    }

    /// Restarts a remote in the next cycles, which clears the
    /// faults it reports: at once, but for one that is offline not before its own watchdog must have
    /// bitten. Its outputs are safe until it is re-armed. `false`, and nothing is done, if none takes
    /// part there.
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
