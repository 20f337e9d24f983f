//! The period of the cycle, where it is known only when the cycle begins.

use core::time::Duration;

use super::arrival::ArrivalClock;
use super::{Driver, DriverError, ExchangePacer, Pace};
use crate::bus::{Clock, RegisterBus};
use crate::modules::serial::SerialPort;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Changes the period of the cycle before the first [`write`](Self::write), at the host's pace:
    /// for a program that learns its period only when its cycle begins. With the period change what
    /// follows from it: the time of the board's watchdog and the frequency of the DPLL, unless the
    /// application has set them by [`Settings::watchdog`](super::Settings::watchdog) or by their
    /// pins; and the deadline of a reply. A DPLL whose prescale cannot follow the period is left
    /// alone.
    ///
    /// # Errors
    /// [`DriverError::PeriodInUse`] after the first write, or where the board paces the cycle.
    /// [`DriverError::BadPeriod`], [`DriverError::WatchdogTooShort`],
    /// [`DriverError::PeriodTooShort`] and [`DriverError::Register`], as at the start. The period
    /// then stays as it was, and everything is safe until it is re-armed: outputs must not follow a
    /// cycle whose period they do not have.
    pub fn set_period(&mut self, period: Duration) -> Result<(), DriverError> {
        if self.pacer.pace != Pace::Host || self.cycle.statistics.writes > 0 {
            return Err(DriverError::PeriodInUse);
        }
        let changed = self.change_period(period);
        if changed.is_err() {
            self.cycle.make_safe();
        }
        changed
    }

    fn change_period(&mut self, period: Duration) -> Result<(), DriverError> {
        check_range(period)?;
        let parts = &self.cycle.parts;
        let watchdog = parts.watchdog.time_at(period, &self.cycle.pins);
        DriverError::check_watchdog(None, watchdog, period)?;
        for port in &parts.ports {
            check_port(port, period)?;
        }
        if let Err(error) = self.change_parts(period) {
            // They have accepted this one before.
            let _ = self.change_parts(self.pacer.period);
            return Err(error);
        }
        self.pacer = ExchangePacer::new(Pace::Host, period);
        self.cycle
            .change_clock(ArrivalClock::new(Pace::Host, period));
        self.bus.set_cycle(period, None);
        Ok(())
    }

    fn change_parts(&mut self, period: Duration) -> Result<(), DriverError> {
        for part in self.cycle.parts.each() {
            part.set_period(period, &mut self.cycle.pins)?;
        }
        Ok(())
    }
}

/// Refuses a period out of the range in which the cycle can be kept.
pub(super) fn check_range(period: Duration) -> Result<(), DriverError> {
    let range = Duration::from_micros(1)..=Duration::from_millis(800);
    if range.contains(&period) {
        Ok(())
    } else {
        Err(DriverError::BadPeriod { period })
    }
}

/// Checks that the period is long enough for the transfers of a port, and short enough for the
/// watchdogs of its remotes.
pub(super) fn check_port(port: &SerialPort, period: Duration) -> Result<(), DriverError> {
    let number = port.layout().instance;
    let needed = port.expected_time.usual;
    if needed > period {
        return Err(DriverError::PeriodTooShort {
            port: number,
            needed,
            period,
        });
    }
    for remote in port.remotes() {
        if let Some(time) = remote.watchdog.time() {
            DriverError::check_watchdog(Some(remote.label), time, period)?;
        }
    }
    Ok(())
}
