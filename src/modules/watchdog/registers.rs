//! The registers of the watchdog.

use core::time::Duration;

use crate::hostmot2::{Gtag, HostMot2, HostMot2Error};

/// The registers of the watchdog.
///
/// A bite clears the direction and open-drain registers: all I/O become inputs with pull-ups, and
/// stay so until the ports are set up again. The other registers of the ports stay as they are.
///
/// The watchdog also bites when it is [disabled](WatchdogTime::DISABLED) while it runs, and when it is
/// restarted before it was ever given a time. After a bite both are harmless.
///
/// Source: FACTS 13.2, 12.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WatchdogRegisters {
    /// Address of the time register, see [`WatchdogTime`].
    pub time: u16,
    /// Address of the status register, see [`WatchdogStatus`]: 0 forgets a bite.
    pub status: u16,
    /// Address of the register that [`PET`](Self::PET) is written to.
    pub reset: u16,
    clock_hz: u32,
}

impl WatchdogRegisters {
    /// The word that restarts the watchdog.
    pub const PET: u32 = 0x5A00_0000;

    /// The time that integrators know as the usual one.
    pub const DEFAULT_TIMEOUT: Duration = Duration::from_millis(5);

    /// The watchdog of a firmware.
    ///
    /// # Errors
    /// The firmware has none, or one that is not known.
    pub fn locate(firmware: &HostMot2) -> Result<Self, HostMot2Error> {
        let module = firmware.require(Gtag::WATCHDOG)?;
        module.expect(3, 0)?;
        Ok(Self {
            time: module.register(0, 0)?,
            status: module.register(1, 0)?,
            reset: module.register(2, 0)?,
            clock_hz: module.clock_hz,
        })
    }

    /// The register value for a time.
    pub fn time_for(&self, timeout: Duration) -> WatchdogTime {
        WatchdogTime::new(timeout, self.clock_hz)
    }

    /// The time that a register value stands for; `None` if it disables the watchdog.
    pub fn timeout_of(&self, time: WatchdogTime) -> Option<Duration> {
        time.timeout(self.clock_hz)
    }
}

/// The time register: bites (value + 2) clocks after it was written, or the watchdog was restarted;
/// bit 31 disables. It reads what is left: 0x8000_0000 after a reset, 0xFFFF_FFFF after a bite.
///
/// Source: FACTS 12.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WatchdogTime(pub u32);

impl WatchdogTime {
    /// Never bites.
    pub const DISABLED: Self = Self(0xFFFF_FFFF);
    /// Bites after three clocks.
    pub const AT_ONCE: Self = Self(1);
    /// The longest time: 21 s at 100 MHz.
    pub const LONGEST: Self = Self(Self::DISABLE - 1);

    const DISABLE: u32 = 1 << 31;
    /// Clocks from a write to the bite, less the value.
    const EXTRA: u32 = 2;

    /// The value for a time at a clock, rounded down, at least two clocks; times that do not fit
    /// become the longest there is (21 s at 100 MHz), never "disabled".
    pub const fn new(timeout: Duration, clock_hz: u32) -> Self {
        // 96 and 32 bits: can not overflow.
        let clocks = timeout.as_nanos().saturating_mul(clock_hz as u128) / 1_000_000_000;
        let value = clocks.saturating_sub(Self::EXTRA as u128);
        if value > Self::LONGEST.0 as u128 {
            Self::LONGEST
        } else {
            Self(value as u32)
        }
    }

    /// The time until it bites; `None` if it never does.
    pub const fn timeout(self, clock_hz: u32) -> Option<Duration> {
        if !self.runs() || clock_hz == 0 {
            return None;
        }
        let nanos = (self.0 as u64 + Self::EXTRA as u64) * 1_000_000_000 / clock_hz as u64;
        Some(Duration::from_nanos(nanos))
    }

    /// Whether the watchdog runs with this time, or has it left: it is neither disabled, nor bitten,
    /// nor as after a reset.
    pub const fn runs(self) -> bool {
        self.0 & Self::DISABLE == 0
    }
}

bitflags::bitflags! {
    /// The status register.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub struct WatchdogStatus: u32 {
        /// It has bitten.
        const HAS_BIT = 1;
        const _ = !0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn five_milliseconds_at_100_mhz_are_499998() {
        let time = WatchdogTime::new(WatchdogRegisters::DEFAULT_TIMEOUT, 100_000_000);
        assert_eq!(time, WatchdogTime(499_998));
        assert_eq!(time.timeout(100_000_000), Some(Duration::from_millis(5)));
    }

    #[test]
    fn no_time_however_long_disables_the_watchdog() {
        for timeout in [Duration::from_secs(22), Duration::MAX] {
            assert_eq!(
                WatchdogTime::new(timeout, u32::MAX),
                WatchdogTime(0x7FFF_FFFF)
            );
        }
        assert_eq!(WatchdogTime::new(Duration::ZERO, 1), WatchdogTime(0));
        assert_eq!(WatchdogTime::DISABLED.timeout(100_000_000), None);
    }

    proptest! {
        #[test]
        fn times_come_back_within_one_clock(micros in 1u64..20_000_000, mhz in 1u32..100) {
            let clock = mhz * 1_000_000;
            let timeout = Duration::from_micros(micros);
            let back = WatchdogTime::new(timeout, clock).timeout(clock).unwrap();
            prop_assert!(back <= timeout);
            prop_assert!(timeout.saturating_sub(back).as_nanos() <= u128::from(1_000 / mhz + 1));
        }
    }
}
