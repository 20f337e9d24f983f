//! Layouts of the encoder registers.
//!
//! The count register contains the count modulo 65536, and in its high half the time stamp of the
//! last count change. The control register contains the mode in its low half ([`bits`]), and the
//! latched count in its high half.

/// Delay of the input samples after the edge of the multiplexer: bits 31..28 of the rate register,
/// in periods of the clock. Rounded to the nearest, at most 15 periods.
///
/// Source: LinuxCNC, hostmot2 driver, `muxed-skew`.
pub(super) fn mux_skew(clock_hz: u32, ns: u32) -> u32 {
    let parts = u64::from(ns).saturating_mul(clock_hz.into());
    let periods = parts.saturating_add(500_000_000) / 1_000_000_000;
    (periods.min(15) as u32) << 28
}

/// Word of the latch source: 0 the DPLL's reference, 1 to 4 one of its timers; anything else none,
/// so that counts are those of the time of the read.
///
/// Source: LinuxCNC, hostmot2 driver, `encoder.timer-number`.
pub(super) const fn latch_timer(timer: i32) -> u32 {
    const LATCH: u32 = 1 << 15;
    match timer {
        0..=4 => (timer as u32) << 12 | LATCH,
        _ => 0,
    }
}

/// The latched count, modulo 65536.
pub(super) const fn latched(control: u32) -> u16 {
    (control >> 16) as u16
}

/// The bits of the control register.
pub(super) mod bits {
    /// Both inputs changed at once: counts may be wrong. Stays until a 1 is written.
    pub const QUADRATURE_ERROR: u32 = 1 << 15;
    /// Latch the count on the probe input.
    pub const LATCH_ON_PROBE: u32 = 1 << 13;
    /// The probe input is active high; else low.
    pub const PROBE_POLARITY: u32 = 1 << 12;
    /// Filter: 15 samples, else 3, which costs four fifths of the greatest count rate.
    pub const FILTER: u32 = 1 << 11;
    /// Counter mode: up/down (step and direction), else quadrature.
    pub const UP_DOWN: u32 = 1 << 10;
    /// Only take an index while the index mask is active.
    pub const USE_INDEX_MASK: u32 = 1 << 9;
    /// The index mask is active low; else high.
    pub const INDEX_MASK_POLARITY: u32 = 1 << 8;
    /// Latch or clear once; the enable bit reads back 0 afterwards.
    pub const JUST_ONCE: u32 = 1 << 6;
    /// Clear the count on index.
    pub const CLEAR_ON_INDEX: u32 = 1 << 5;
    /// Latch the count on index.
    pub const LATCH_ON_INDEX: u32 = 1 << 4;
    /// The index is active high; else low.
    pub const INDEX_POLARITY: u32 = 1 << 3;
    /// Level of the index input.
    pub const INDEX: u32 = 1 << 2;
    /// Level of the B input.
    pub const B: u32 = 1 << 1;
    /// Level of the A input.
    pub const A: u32 = 1;
    /// The bits of the mode that every firmware reads back.
    pub const MODE: u32 = FILTER | UP_DOWN | USE_INDEX_MASK | INDEX_MASK_POLARITY | INDEX_POLARITY;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skew_is_the_nearest_number_of_clocks_in_the_top_bits() {
        let clock = 100_000_000;
        for (ns, word) in [
            (0, 0),
            (4, 0),
            (5, 0x1000_0000),
            (50, 0x5000_0000),
            (150, 0xF000_0000),
            (u32::MAX, 0xF000_0000),
        ] {
            assert_eq!(mux_skew(clock, ns), word, "{ns} ns");
        }
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
            assert_eq!(latch_timer(timer), word, "{timer}");
        }
    }
}
