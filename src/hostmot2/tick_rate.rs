//! Rates that the gateware divides from a clock.

/// A rate register: ticks at clock/(n+2).
///
/// Source: FACTS 13.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TickRate(pub u32);

impl TickRate {
    /// Multiplexer rate for which the 7I77 is designed: ClockLow/8.
    /// Manual: 7I77, "MAXIMUM ENCODER COUNT RATE".
    pub const MUX_7I77: Self = Self(6);

    /// Multiplexer rate for which the 7I97 is designed: ClockLow/16.
    /// Manual: 7I97, "MAXIMUM ENCODER COUNT RATE".
    pub const MUX_7I97: Self = Self(14);

    /// The slowest rate: clock/4097. The register has 12 bits.
    pub const SLOWEST: Self = Self(0xFFF);

    /// The value for a rate, rounded down to an available one; at least clock/4097, at most
    /// clock/2.
    pub fn for_hz(clock_hz: u32, hz: u32) -> Self {
        let n = clock_hz.div_ceil(hz.max(1)).saturating_sub(2);
        Self(n.min(Self::SLOWEST.0))
    }

    /// The rate in Hz.
    pub fn hz(self, clock_hz: u32) -> f64 {
        f64::from(clock_hz) / (f64::from(self.0) + 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn multiplexer_rates_of_the_manuals_are_clock_8_and_clock_16() {
        let clock = 100_000_000;
        assert!((TickRate::MUX_7I77.hz(clock) - 12.5e6).abs() < 1e-6);
        assert!((TickRate::MUX_7I97.hz(clock) - 6.25e6).abs() < 1e-6);
        assert_eq!(TickRate::for_hz(clock, 12_500_000), TickRate::MUX_7I77);
        assert_eq!(TickRate::for_hz(clock, 6_250_000), TickRate::MUX_7I97);
        assert_eq!(TickRate::for_hz(clock, 1_000_000).0, 98);
        assert_eq!(TickRate::for_hz(clock, 0).0, 0xFFF);
        assert_eq!(TickRate::for_hz(clock, u32::MAX).0, 0);
        assert_eq!(TickRate::for_hz(clock, 10_000_000), TickRate(8));
    }

    proptest! {
        #[test]
        fn rate_is_the_fastest_that_is_not_above_what_was_asked_for(clock in 1_000_000u32.., hz: u32) {
            let rate = TickRate::for_hz(clock, hz);
            let wanted = f64::from(hz);
            if rate.0 < TickRate::SLOWEST.0 && wanted <= f64::from(clock) / 2.0 {
                prop_assert!(rate.hz(clock) <= wanted);
            }
            if let Some(faster) = rate.0.checked_sub(1) && rate.0 < TickRate::SLOWEST.0 {
                prop_assert!(TickRate(faster).hz(clock) > wanted);
            }
        }
    }
}
