//! Whether the remotes' own watchdogs bite.

use super::{Driver, DriverError};
use crate::bus::{Clock, RegisterBus};
use crate::modules::serial::SerialPort;

/// How often the remotes are asked what they report: a transfer may be lost.
const TRIES: u32 = 3;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Lets all remotes that run go without process data for longer than their
    /// [watchdogs](super::RemoteWatchdog) are said to take, with all outputs off, and looks whether
    /// they report that these have bitten. One that does not counts as
    /// [off](super::RemoteWatchdog::Off) from now on; one that was left alone for much longer than its
    /// own time, because of another's or because the host was late, is known to bite within that.
    ///
    /// The parameter `NVWatchDogTimeout` says what a remote uses from its next power-up on. What it
    /// uses until then it does not tell, so that one which was written since may be read as 50 ms
    /// while none is in use. Those that are off or [slow](super::RemoteWatchdog::is_slow) by their
    /// parameter stay what they are, and are not waited for. So do those of a port that is
    /// switched off, which transfers nothing.
    ///
    /// It costs the machine what [`write_remote_parameter`](Self::write_remote_parameter) does:
    /// everything becomes safe, remotes whose watchdogs have bitten are started again in the next
    /// cycles, and everything waits for [`rearm`](Self::rearm). Go on with the cycle at once.
    ///
    /// # Errors
    /// Those of the bus, [`DriverError::NotRunning`] and [`DriverError::NotConfirmed`]; then nothing is
    /// known of any watchdog.
    ///
    /// # Real time
    /// Not for the cycle: 60 ms where all watchdogs are as delivered, 1.4 s at most.
    pub fn prove_watchdogs(&mut self) -> Result<(), DriverError<B::Error>> {
        let silences = self
            .cycle
            .parts
            .ports
            .iter()
            .filter_map(SerialPort::silence);
        let Some(silence) = silences.max() else {
            return Ok(());
        };
        let begin = self.bus.now();
        self.all_off()?;
        let asked = self.cycle.parts.ports.iter().map(SerialPort::running);
        let asked: alloc::vec::Vec<_> = asked.collect();
        let usual = self.cycle.parts.watchdog.timeout();
        self.feed_for(super::parameters::UNFED)?;
        self.bus.sleep(silence);
        self.feed_for(usual)?;
        self.last_transfer()?;
        let took = self.bus.now().since(begin);
        for _ in 1..TRIES {
            self.last_transfer()?;
        }
        self.cycle.make_safe();
        let now = self.bus.now();
        for (port, asked) in self.cycle.parts.ports.iter_mut().zip(asked) {
            port.judge_watchdogs(asked, took, &mut self.cycle.pins, now);
        }
        if self.cycle.is_running() {
            Ok(())
        } else {
            Err(DriverError::NotRunning {
                state: self.cycle.state(),
            })
        }
    }
}
