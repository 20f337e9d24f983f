//! The registers of the watchdog.

use core::time::Duration;

use crate::bus::{BusError, RegisterBus};
use crate::hostmot2::{Gtag, HostMot2, HostMot2Error};

/// The registers of the watchdog.
///
/// A bite clears the direction and open-drain registers: all I/O become inputs with pull-ups, and
/// stay so until the ports are set up again. The other registers of the ports are unchanged.
///
/// The watchdog also bites when it is [disabled](Self::DISABLED) while it runs, and when it is
/// restarted before it was ever given a time. After a bite both are harmless.
///
/// Source: FACTS 13.2, 12.1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchdogRegisters {
    /// Address of the time register. The watchdog bites (value + 2) clocks after the time was
    /// written or the watchdog was restarted; bit 31 disables it. Reads the rest of the time:
    /// 0x8000_0000 after a reset, 0xFFFF_FFFF after a bite.
    pub time: u16,
    /// Address of the status register, see [`HAS_BIT`](Self::HAS_BIT): writing 0 clears a bite.
    pub status: u16,
    /// Address of the restart register, see [`PET`](Self::PET).
    pub reset: u16,
    /// Clock of the time register.
    pub clock_hz: u32,
}

impl WatchdogRegisters {
    /// The word that restarts the watchdog.
    pub const PET: u32 = 0x5A00_0000;
    /// The bit of the status that a bite sets.
    pub const HAS_BIT: u32 = 1;
    /// The time that disables the watchdog.
    pub const DISABLED: u32 = 0xFFFF_FFFF;
    /// The time that makes it bite after three clocks.
    pub const AT_ONCE: u32 = 1;
    /// The longest time: 21 s at 100 MHz.
    pub const LONGEST: u32 = Self::DISABLE - 1;

    const DISABLE: u32 = 1 << 31;
    /// Clocks from a write to the bite, less the value.
    const EXTRA: u32 = 2;

    /// Registers of the watchdog of a firmware.
    ///
    /// # Errors
    /// The firmware has no watchdog, or one of unknown layout.
    pub fn locate(firmware: &HostMot2) -> Result<Self, HostMot2Error> {
        let module = firmware.require(Gtag::WATCHDOG)?;
        module.check_layout(3, 0)?;
        Ok(Self {
            time: module.register(0, 0)?,
            status: module.register(1, 0)?,
            reset: module.register(2, 0)?,
            clock_hz: module.clock_hz,
        })
    }

    /// The word for a time, rounded down, at least two clocks; times that do not fit become the
    /// longest possible, never "disabled".
    pub fn time_for(&self, timeout: Duration) -> u32 {
        // 96 and 32 bits: cannot overflow.
        let clocks = timeout.as_nanos().saturating_mul(self.clock_hz.into()) / 1_000_000_000;
        let value = clocks.saturating_sub(Self::EXTRA.into());
        value.min(Self::LONGEST.into()) as u32
    }

    /// The time of a word; `None` if it disables the watchdog.
    pub fn timeout_of(&self, time: u32) -> Option<Duration> {
        if !Self::runs(time) {
            return None;
        }
        let periods = u64::from(time).saturating_add(Self::EXTRA.into());
        let nanos = periods.saturating_mul(1_000_000_000);
        Some(Duration::from_nanos(
            nanos.checked_div(self.clock_hz.into())?,
        ))
    }

    /// True if the watchdog is in the state after the first set-up, before the cycle: disabled, and
    /// without a bite. A reset leaves another time.
    ///
    /// # Errors
    /// Those of the bus.
    pub(crate) fn are_at_first<B: RegisterBus>(&self, bus: &mut B) -> Result<bool, BusError> {
        let status = bus.read(self.status)?;
        Ok(bus.read(self.time)? == Self::DISABLED && status & Self::HAS_BIT == 0)
    }

    /// True if a watchdog with this word in its time register runs: it is neither disabled, nor
    /// bitten, nor in the state after a reset.
    pub const fn runs(time: u32) -> bool {
        time & Self::DISABLE == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::SHORTEST_USUAL_WATCHDOG;
    use proptest::prelude::*;

    const fn at(clock_hz: u32) -> WatchdogRegisters {
        WatchdogRegisters {
            time: 0,
            status: 0,
            reset: 0,
            clock_hz,
        }
    }

    #[test]
    fn five_milliseconds_at_100_mhz_are_499998() {
        let registers = at(100_000_000);
        let time = registers.time_for(SHORTEST_USUAL_WATCHDOG);
        assert_eq!(time, 499_998);
        assert_eq!(registers.timeout_of(time), Some(Duration::from_millis(5)));
    }

    #[test]
    fn no_time_however_long_disables_the_watchdog() {
        for timeout in [Duration::from_secs(22), Duration::MAX] {
            assert_eq!(at(u32::MAX).time_for(timeout), 0x7FFF_FFFF);
        }
        assert_eq!(at(1).time_for(Duration::ZERO), 0);
        let disabled = WatchdogRegisters::DISABLED;
        assert_eq!(at(100_000_000).timeout_of(disabled), None);
    }

    proptest! {
        #[test]
        fn times_come_back_within_one_clock(micros in 1u64..20_000_000, mhz in 1u32..100) {
            let registers = at(mhz * 1_000_000);
            let timeout = Duration::from_micros(micros);
            let back = registers.timeout_of(registers.time_for(timeout)).unwrap();
            prop_assert!(back <= timeout);
            prop_assert!(timeout.saturating_sub(back).as_nanos() <= u128::from(1_000 / mhz + 1));
        }
    }
}
