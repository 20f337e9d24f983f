//! Layouts of the encoder registers.

/// A rate register: ticks at clock/(n+2). With bit 15 set, ticks at the clock itself (time stamps
/// only).
///
/// Source: FACTS 13.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TickRate(pub u32);

impl TickRate {
    /// Multiplexer rate that the 7I77 is made for: ClockLow/8.
    /// Manual: 7I77, "MAXIMUM ENCODER COUNT RATE".
    pub const MUX_7I77: Self = Self(6);

    /// Multiplexer rate that the 7I97 is made for: ClockLow/16.
    /// Manual: 7I97, "MAXIMUM ENCODER COUNT RATE".
    pub const MUX_7I97: Self = Self(14);

    /// The usual rate of time stamps: a microsecond each, 65 ms until they wrap.
    pub const TIMESTAMP_HZ: u32 = 1_000_000;

    /// Fine time stamps, for periods of 1 ms and less: they wrap after 6.5 ms.
    pub const FINE_TIMESTAMP_HZ: u32 = 10_000_000;

    const UNDIVIDED: u32 = 1 << 15;
    const LARGEST: u32 = 0xFFF;

    /// The value for a rate, rounded down to what there is; at least clock/4097, at most clock/2.
    pub const fn for_hz(clock_hz: u32, hz: u32) -> Self {
        let divisor = clock_hz.div_ceil(if hz == 0 { 1 } else { hz });
        let n = divisor.saturating_sub(2);
        Self(if n > Self::LARGEST { Self::LARGEST } else { n })
    }

    /// The rate in Hz.
    pub fn hz(self, clock_hz: u32) -> f64 {
        let divisor = if self.0 & Self::UNDIVIDED != 0 {
            1
        } else {
            (self.0 & (Self::UNDIVIDED - 1)) + 2
        };
        f64::from(clock_hz) / f64::from(divisor)
    }

    /// How often a second an encoder is sampled at this rate of the multiplexer or the filters. Of
    /// the two on a set of multiplexed pins, each is looked at in every other tick.
    pub fn sample_rate(self, clock_hz: u32, is_muxed: bool) -> f64 {
        self.hz(clock_hz) / if is_muxed { 2.0 } else { 1.0 }
    }

    /// The most counts in a second that are followed: each level of A and B lasts for two counts, and
    /// has to last for as many samples as the filter is long. For multiplexed encoders that is
    /// clock / (3 (n + 2)), or clock / (15 (n + 2)) with the long filter. Beyond it counts are garbage,
    /// and no error tells (FACTS 12.6).
    pub fn max_count_rate(self, clock_hz: u32, is_muxed: bool, long_filter: bool) -> f64 {
        2.0 * self.sample_rate(clock_hz, is_muxed) / if long_filter { 15.0 } else { 3.0 }
    }
}

/// How long after the edge of the multiplexer the inputs are sampled: bits 31..28 of the rate
/// register, in periods of the clock.
///
/// Source: LinuxCNC, hostmot2 driver, `muxed-skew`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MuxSkew(pub u32);

impl MuxSkew {
    const LARGEST: u64 = 15;

    /// The nearest to a time, at most 15 periods.
    pub const fn for_ns(clock_hz: u32, ns: u32) -> Self {
        let periods = (ns as u64 * clock_hz as u64 + 500_000_000) / 1_000_000_000;
        let periods = if periods > Self::LARGEST {
            Self::LARGEST
        } else {
            periods
        };
        Self((periods as u32) << 28)
    }
}

/// Which timer of the DPLL latches the counts.
///
/// Source: LinuxCNC, hostmot2 driver, `encoder.timer-number`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct LatchTimer(pub u32);

impl LatchTimer {
    const LATCH: u32 = 1 << 15;

    /// 0 is the DPLL's reference, 1 to 4 are its timers; anything else: counts are those of the
    /// moment they are read in.
    pub const fn new(timer: i32) -> Self {
        match timer {
            0..=4 => Self((timer as u32) << 12 | Self::LATCH),
            _ => Self(0),
        }
    }
}

/// The count register as read: the count, and the time of its last change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CountWord(pub u32);

impl CountWord {
    /// The count modulo 65536.
    pub const fn count(self) -> u16 {
        self.0 as u16
    }

    /// The time stamp counter when the count changed last.
    pub const fn timestamp(self) -> u16 {
        (self.0 >> 16) as u16
    }
}

/// The control register: mode in the low half, latched count in the high half.
///
/// Bits that have no meaning here are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ControlWord(pub u32);

impl ControlWord {
    /// Both inputs changed at once: counts may be wrong. Stays until a 1 is written.
    pub const QUADRATURE_ERROR: u32 = 1 << 15;
    /// Latch the count on the probe input.
    pub const LATCH_ON_PROBE: u32 = 1 << 13;
    /// Polarity of the probe input.
    pub const PROBE_POLARITY: u32 = 1 << 12;
    /// Filter: 15 clocks, else 3.
    pub const FILTER: u32 = 1 << 11;
    /// Counter mode: up/down, else quadrature.
    pub const UP_DOWN: u32 = 1 << 10;
    /// Only take an index while the index mask is active.
    pub const USE_INDEX_MASK: u32 = 1 << 9;
    /// Polarity of the index mask.
    pub const INDEX_MASK_POLARITY: u32 = 1 << 8;
    /// Only take an index at one state of A and B.
    pub const GATE_INDEX: u32 = 1 << 7;
    /// Latch or clear once; the enable bit reads back 0 when it has happened.
    pub const JUST_ONCE: u32 = 1 << 6;
    /// Clear the count on index.
    pub const CLEAR_ON_INDEX: u32 = 1 << 5;
    /// Latch the count on index.
    pub const LATCH_ON_INDEX: u32 = 1 << 4;
    /// Polarity of the index.
    pub const INDEX_POLARITY: u32 = 1 << 3;
    /// The index input now.
    pub const INDEX: u32 = 1 << 2;
    /// The B input now.
    pub const B: u32 = 1 << 1;
    /// The A input now.
    pub const A: u32 = 1;

    /// Whether any of the bits is set.
    pub const fn has(self, bits: u32) -> bool {
        self.0 & bits != 0
    }

    /// The count that was latched, modulo 65536.
    pub const fn latched(self) -> u16 {
        (self.0 >> 16) as u16
    }
}

/// How an encoder counts.
#[allow(
    clippy::struct_excessive_bools,
    reason = "independent properties, one register bit each"
)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderConfig {
    /// Counts for one unit of position; never 0: 0 and values that are not finite count as 1.
    pub scale: f64,
    /// Up/down (step and direction), else quadrature.
    pub up_down: bool,
    /// Filter inputs for 15 samples instead of 3, which costs four fifths of the greatest count
    /// rate: [`TickRate::max_count_rate`].
    pub filter: bool,
    /// The index is active high; else low.
    pub index_high: bool,
    /// Only take an index while the index mask is active.
    pub index_mask: bool,
    /// The index mask is active low, else high.
    pub index_mask_invert: bool,
    /// Only take an index at one state of A and B.
    pub gate_index: bool,
    /// The probe input is active high; else low.
    pub probe_high: bool,
    /// Velocity is 0 when no count came for so long, in seconds.
    pub idle_time: f64,
}

impl Default for EncoderConfig {
    /// Quadrature, long filter, index and probe active high, scale 1, idle after 0.5 s.
    fn default() -> Self {
        Self {
            scale: 1.0,
            up_down: false,
            filter: true,
            index_high: true,
            index_mask: false,
            index_mask_invert: false,
            gate_index: false,
            probe_high: true,
            idle_time: 0.5,
        }
    }
}

impl EncoderConfig {
    /// The control word, without any latch or clear.
    pub fn control(&self) -> ControlWord {
        let word = [
            (self.up_down, ControlWord::UP_DOWN),
            (self.filter, ControlWord::FILTER),
            (self.index_high, ControlWord::INDEX_POLARITY),
            (self.index_mask, ControlWord::USE_INDEX_MASK),
            (self.index_mask_invert, ControlWord::INDEX_MASK_POLARITY),
            (self.gate_index, ControlWord::GATE_INDEX),
            (self.probe_high, ControlWord::PROBE_POLARITY),
        ]
        .into_iter()
        .filter_map(|(on, bit)| on.then_some(bit))
        .fold(0, |word, bit| word | bit);
        ControlWord(word)
    }

    /// Counts for one unit of position, never 0 and always finite.
    pub fn usable_scale(&self) -> f64 {
        if self.scale.is_finite() && self.scale != 0.0 {
            self.scale
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_are_laid_out_as_the_register_list_says() {
        let count = CountWord(0x1234_FFFE);
        assert_eq!((count.count(), count.timestamp()), (0xFFFE, 0x1234));
        let control = ControlWord(0xABCD_8045);
        assert_eq!(control.latched(), 0xABCD);
        assert!(control.has(ControlWord::QUADRATURE_ERROR));
        assert!(control.has(ControlWord::JUST_ONCE));
        assert!(!control.has(ControlWord::B));
        assert_eq!(EncoderConfig::default().control().0, 0x1808);
        let all = EncoderConfig {
            up_down: true,
            index_mask: true,
            index_mask_invert: true,
            gate_index: true,
            ..EncoderConfig::default()
        };
        assert_eq!(all.control().0, 0x1F88);
    }

    #[test]
    fn the_multiplexer_rates_of_the_manuals_are_clock_8_and_clock_16() {
        let clock = 100_000_000;
        assert!((TickRate::MUX_7I77.hz(clock) - 12.5e6).abs() < 1e-6);
        assert!((TickRate::MUX_7I97.sample_rate(clock, true) - 3.125e6).abs() < 1e-6);
        assert_eq!(TickRate::for_hz(clock, 12_500_000), TickRate::MUX_7I77);
        assert_eq!(TickRate::for_hz(clock, 6_250_000), TickRate::MUX_7I97);
        assert_eq!(TickRate::for_hz(clock, TickRate::TIMESTAMP_HZ).0, 98);
        assert_eq!(TickRate::for_hz(clock, 0).0, 0xFFF);
        assert_eq!(TickRate::for_hz(clock, u32::MAX).0, 0);
        assert!((TickRate(0x8000).hz(clock) - 1e8).abs() < 1e-6);
        let fine = TickRate::for_hz(clock, TickRate::FINE_TIMESTAMP_HZ);
        assert_eq!(fine, TickRate(8));
    }

    #[test]
    fn a_skew_is_the_nearest_number_of_clocks_in_the_top_bits() {
        let clock = 100_000_000;
        for (ns, word) in [
            (0, 0),
            (4, 0),
            (5, 0x1000_0000),
            (50, 0x5000_0000),
            (150, 0xF000_0000),
            (u32::MAX, 0xF000_0000),
        ] {
            assert_eq!(MuxSkew::for_ns(clock, ns), MuxSkew(word), "{ns} ns");
        }
        let both = TickRate(TickRate::MUX_7I97.0 | MuxSkew::for_ns(clock, 150).0);
        assert!((both.hz(clock) - 6.25e6).abs() < 1e-6, "the rate stays");
    }

    #[test]
    fn counts_are_latched_by_the_reference_or_one_of_four_timers() {
        for (timer, word) in [
            (-1, 0),
            (0, 0x8000),
            (1, 0x9000),
            (4, 0xC000),
            (5, 0),
            (i32::MIN, 0),
        ] {
            assert_eq!(LatchTimer::new(timer), LatchTimer(word), "{timer}");
        }
    }

    proptest! {
        #[test]
        fn a_rate_is_the_fastest_that_is_not_above_what_was_asked_for(clock in 1_000_000u32.., hz: u32) {
            let rate = TickRate::for_hz(clock, hz);
            let wanted = f64::from(hz);
            if rate.0 < TickRate::LARGEST && wanted <= f64::from(clock) / 2.0 {
                prop_assert!(rate.hz(clock) <= wanted);
            }
            if let Some(faster) = rate.0.checked_sub(1) && rate.0 < TickRate::LARGEST {
                prop_assert!(TickRate(faster).hz(clock) > wanted);
            }
        }
    }
}
