//! Modules that are nothing but outputs: solid state relays (SSR) and OutM.

use super::{Gtag, HostMot2, LocateError, RegisterBlock};
use crate::bus::RegisterBus;

/// The registers of the solid state relay outputs.
///
/// The relays are driven with a frequency; without it they are off whatever the data says.
///
/// Source: REGISTERS.md, "SSR".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ssr {
    /// Address of the outputs: bit n is output n, 1 = on.
    pub data: u16,
    /// Address of the rate register, see [`SsrRate`].
    pub rate: u16,
    clock_hz: u32,
}

impl Ssr {
    /// The drive frequency that the relays are made for.
    pub const DRIVE_HZ: u32 = 1_000_000;

    /// The SSR outputs, instance `instance`.
    pub fn locate(firmware: &HostMot2, instance: u8) -> Result<Self, LocateError> {
        let module = firmware.require(Gtag::SSR)?;
        module.expect_gtag_and_instance(Gtag::SSR, instance)?;
        Ok(Self {
            data: instance_of(module.block(0)?, instance),
            rate: instance_of(module.block(1)?, instance),
            clock_hz: module.clock_hz,
        })
    }

    /// The rate register for [`Self::DRIVE_HZ`].
    pub fn drive(&self) -> SsrRate {
        SsrRate::enabled(self.clock_hz, Self::DRIVE_HZ)
    }

    /// The rate register for a drive frequency.
    pub fn rate_for(&self, hz: u32) -> SsrRate {
        SsrRate::enabled(self.clock_hz, hz)
    }

    /// Switches all outputs off, then turns the drive on. To be called after the I/O ports were
    /// set up, so that the pins are driven by the module by then.
    pub fn start<B: RegisterBus>(&self, bus: &mut B) -> Result<(), B::Error> {
        use crate::bus::Access;
        bus.exchange(
            &[
                Access::write(self.data, 0, 1),
                Access::write(self.rate, 1, 1),
            ],
            &mut [0, self.drive().0],
        )
    }
}

/// The rate register of SSR: 11..0 divisor, 12 enable. Drive frequency clock/(n+2)/2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SsrRate(pub u32);

impl SsrRate {
    const ENABLE: u32 = 1 << 12;
    const LARGEST: u32 = 0xFFF;

    /// The value for a drive frequency, which is at most the one that was asked for if the divisor
    /// has room.
    pub const fn enabled(clock_hz: u32, drive_hz: u32) -> Self {
        let wanted = if drive_hz == 0 {
            1
        } else {
            drive_hz as u64 * 2
        };
        let divisor = (clock_hz as u64).div_ceil(wanted).saturating_sub(2);
        let divisor = if divisor > Self::LARGEST as u64 {
            Self::LARGEST
        } else {
            divisor as u32
        };
        Self(divisor | Self::ENABLE)
    }

    /// Whether the relays are driven.
    pub const fn is_enabled(self) -> bool {
        self.0 & Self::ENABLE != 0
    }

    /// The drive frequency in Hz.
    pub const fn drive_hz(self, clock_hz: u32) -> u32 {
        clock_hz / ((self.0 & Self::LARGEST) + 2) / 2
    }
}

/// The register of plain outputs.
///
/// Source: REGISTERS.md, "OutM".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutM {
    /// Address of the outputs: bit n is output n, 1 = on.
    pub data: u16,
}

impl OutM {
    /// The plain outputs, instance `instance`.
    pub fn locate(firmware: &HostMot2, instance: u8) -> Result<Self, LocateError> {
        let module = firmware.require(Gtag::OUT_M)?;
        module.expect_gtag_and_instance(Gtag::OUT_M, instance)?;
        Ok(Self {
            data: instance_of(module.block(0)?, instance),
        })
    }
}

/// The address for an instance that is known to exist; a register outside of the multiple-register
/// mask is the same for all.
pub(super) fn instance_of(block: RegisterBlock, instance: u8) -> u16 {
    block.address(instance).unwrap_or(block.first())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_megahertz_at_100_mhz_is_divisor_48() {
        let rate = SsrRate::enabled(100_000_000, Ssr::DRIVE_HZ);
        assert_eq!(rate, SsrRate(0x1030));
        assert!(rate.is_enabled());
        assert_eq!(rate.drive_hz(100_000_000), 1_000_000);
    }

    #[test]
    fn the_divisor_is_kept_within_its_bits() {
        assert_eq!(SsrRate::enabled(100_000_000, 0), SsrRate(0x1FFF));
        assert_eq!(SsrRate::enabled(1, u32::MAX), SsrRate(0x1000));
    }

    proptest! {
        #[test]
        fn relays_are_never_driven_faster_than_asked_for(clock in 1_000_000u32.., hz in 20_000u32..) {
            let rate = SsrRate::enabled(clock, hz);
            prop_assert!(rate.is_enabled() && rate.0 < 0x2000);
            let slowest_is_faster = rate.0 & 0xFFF == 0xFFF;
            prop_assert!(rate.drive_hz(clock) <= hz || slowest_is_faster);
        }
    }
}
