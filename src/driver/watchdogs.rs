//! Test of the remotes' own watchdogs.

use alloc::vec::Vec;

use super::{Driver, DriverError};
use crate::bus::{Clock, RegisterBus};
use crate::modules::serial::SerialPort;

/// Number of queries for the remotes' reports: a transfer may be lost.
const TRIES: u32 = 6;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Leaves all running remotes without process data for longer than the nominal time of their
    /// [watchdogs](super::RemoteWatchdog), with all outputs off, and checks that they report a
    /// bite. A remote that answers and reports none counts as [off](super::RemoteWatchdog::Off)
    /// from now on; a remote that was left for much longer than its own time, because of another
    /// remote or because the host was late, is known to bite within the longer time.
    ///
    /// The parameter `NVWatchDogTimeout` contains the time that a remote uses from its next
    /// power-up on. The time in use until then cannot be read, so that a parameter written since
    /// the last power-up may read as 50 ms while no watchdog is in use. Watchdogs that are off or
    /// [slow](super::RemoteWatchdog::is_slow) by their parameter stay so, and are not waited for.
    /// The same holds for those of a port that is switched off, which transfers nothing.
    ///
    /// The effects on the machine are those of
    /// [`write_remote_parameter`](Self::write_remote_parameter): everything becomes safe, remotes
    /// whose watchdogs have bitten are started again in the next cycles, and everything waits for
    /// [`rearm`](Self::rearm). Continue with the cycle at once.
    ///
    /// # Errors
    /// Those of the bus, [`DriverError::NotRunning`] and [`DriverError::NotConfirmed`]; then
    /// nothing is known of any watchdog. [`DriverError::NotHeard`] names a remote that did not
    /// answer after the silence: nothing new is known of its watchdog, and all others are tested.
    ///
    /// # Real time
    /// Not for the cycle: 60 ms where all watchdogs are as delivered, 1.4 s at most.
    pub fn prove_watchdogs(&mut self) -> Result<(), DriverError> {
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
        let asked: Vec<_> = asked.collect();
        let usual = self.cycle.parts.watchdog.timeout();
        self.feed_for(super::parameters::UNFED)?;
        self.bus.sleep(silence);
        self.feed_for(usual)?;
        let ports = self.cycle.parts.ports.iter().zip(asked);
        let asked: Vec<_> = ports.map(|(port, asked)| port.query(asked)).collect();
        self.last_transfer()?;
        let took = self.bus.now().since(begin);
        for _ in 1..TRIES {
            self.last_transfer()?;
        }
        self.cycle.make_safe();
        let now = self.bus.now();
        let mut not_heard = None;
        for (port, asked) in self.cycle.parts.ports.iter_mut().zip(&asked) {
            let channel = port.judge_watchdogs(asked, took, &mut self.cycle.pins, now);
            let remote = channel.and_then(|channel| port.remote(channel));
            not_heard = not_heard.or(remote.map(|remote| remote.label));
        }
        if !self.cycle.is_running() {
            return Err(DriverError::NotRunning {
                state: self.cycle.state(),
            });
        }
        not_heard.map_or(Ok(()), |remote| Err(DriverError::NotHeard { remote }))
    }
}
