//! Filtered inputs with MPG counters: InMux (multiplexed) and InM (a pin each).

use super::outputs::instance_of;
use super::{Gtag, HostMot2, LocateError};
use crate::bus::{Access, RegisterBus};

/// The registers of one InMux or InM module. The layouts are the same.
///
/// Source: REGISTERS.md, "InMux / InM"; FACTS 9.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InMux {
    /// [`InMuxControl`].
    pub control: u16,
    /// Filter choice: bit n is input n, 1 = long filter.
    pub filter: u16,
    /// Filtered inputs, bit n is input n.
    pub filtered: u16,
    /// Inputs as they are, bit n is input n.
    pub raw: u16,
    /// Read: [`MpgWord`]. Written: [`MpgModes`].
    pub mpg: u16,
    clock_hz: u32,
}

/// How the inputs are scanned and filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InMuxConfig {
    /// Whole scans per second.
    pub scan_hz: f64,
    /// Scans that an input must be steady for, short filter: 0 to 63.
    pub short_filter: u8,
    /// Scans that an input must be steady for, long filter: 0 to 1023.
    pub long_filter: u16,
    /// The inputs with the long filter: bit n is input n.
    pub long_inputs: u32,
    /// Invert all inputs: what their opto-isolators, which invert, need for 1 to mean current.
    pub invert: bool,
    /// The counters that count every edge (4X), else one per cycle (1X).
    pub mpg_4x: [bool; 4],
}

impl Default for InMuxConfig {
    /// Inverted, as the opto-isolators of all existing boards need it; 20 kHz scans, filters of 5 and 500 scans (0.25 ms and 25 ms), all short, MPGs 1X.
    fn default() -> Self {
        Self {
            scan_hz: 20_000.0,
            short_filter: 5,
            long_filter: 500,
            long_inputs: 0,
            invert: true,
            mpg_4x: [false; 4],
        }
    }
}

impl InMux {
    /// InMux ([`Gtag::IN_MUX`]) or InM ([`Gtag::IN_M`]), instance `instance`.
    pub fn locate(firmware: &HostMot2, gtag: Gtag, instance: u8) -> Result<Self, LocateError> {
        let module = firmware.require(gtag)?;
        let expected = match gtag {
            Gtag::IN_M => Gtag::IN_M,
            _ => Gtag::IN_MUX,
        };
        module.expect_gtag_and_instance(expected, instance)?;
        let register = |register| {
            module
                .block(register)
                .map(|block| instance_of(block, instance))
        };
        Ok(Self {
            control: register(0)?,
            filter: register(1)?,
            filtered: register(2)?,
            raw: register(3)?,
            mpg: register(4)?,
            clock_hz: module.clock_hz,
        })
    }

    /// Sets the module up: one exchange to learn how many inputs it scans, one to write. Gives the
    /// control word that was written, to ask it for the true scan rate.
    pub fn set_up<B: RegisterBus>(
        &self,
        bus: &mut B,
        config: &InMuxConfig,
    ) -> Result<InMuxControl, B::Error> {
        let last = InMuxControl(bus.read(self.control)?).last_input();
        let control = InMuxControl::new(self.clock_hz, last, config);
        bus.exchange(
            &[
                Access::write(self.control, 0, 1),
                Access::write(self.filter, 1, 1),
                Access::write(self.mpg, 2, 1),
            ],
            &mut [
                control.0,
                config.long_inputs,
                MpgModes::new(config.mpg_4x).0,
            ],
        )?;
        Ok(control)
    }

    /// The clock that scan rates divide, in Hz.
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }
}

/// The control register: 4..0 last input number (read only), 5 invert, 15..6 rate divisor,
/// 21..16 short filter, 31..22 long filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct InMuxControl(pub u32);

impl InMuxControl {
    const INVERT: u32 = 1 << 5;
    const LARGEST_DIVISOR: f64 = 1023.0;

    /// The word for a configuration; rates and filters that do not fit become the nearest.
    pub fn new(clock_hz: u32, last_input: u8, config: &InMuxConfig) -> Self {
        let channel_hz = config.scan_hz * (f64::from(last_input & 0x1F) + 1.0);
        let divisor = libm::round(f64::from(clock_hz) / 4.0 / channel_hz) - 1.0;
        // What is not a number becomes 0, the fastest.
        let divisor = divisor.clamp(0.0, Self::LARGEST_DIVISOR) as u32;
        let invert = if config.invert { Self::INVERT } else { 0 };
        Self(
            u32::from(last_input & 0x1F)
                | invert
                | divisor << 6
                | u32::from(config.short_filter.min(63)) << 16
                | u32::from(config.long_filter.min(1023)) << 22,
        )
    }

    /// The number of the last input that is scanned.
    pub const fn last_input(self) -> u8 {
        (self.0 & 0x1F) as u8
    }

    /// Whether all inputs are inverted.
    pub const fn is_inverted(self) -> bool {
        self.0 & Self::INVERT != 0
    }

    /// The rate divisor.
    pub const fn divisor(self) -> u16 {
        (self.0 >> 6) as u16 & 0x3FF
    }

    /// The short filter in scans.
    pub const fn short_filter(self) -> u8 {
        (self.0 >> 16) as u8 & 0x3F
    }

    /// The long filter in scans.
    pub const fn long_filter(self) -> u16 {
        (self.0 >> 22) as u16
    }

    /// Whole scans per second.
    pub fn scan_hz(self, clock_hz: u32) -> f64 {
        f64::from(clock_hz)
            / 4.0
            / (f64::from(self.divisor()) + 1.0)
            / (f64::from(self.last_input()) + 1.0)
    }
}

/// What is written to the MPG register: bit 0 of each byte, 0 = 1X, 1 = 4X.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MpgModes(pub u32);

impl MpgModes {
    /// The word for four counters.
    pub fn new(four_x: [bool; 4]) -> Self {
        Self(u32::from_le_bytes(four_x.map(u8::from)))
    }
}

/// What is read from the MPG register: four counters of 8 bits. Counter k is on inputs 2k (A) and
/// 2k+1 (B).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MpgWord(pub u32);

impl MpgWord {
    /// The counters modulo 256.
    pub const fn counts(self) -> [u8; 4] {
        self.0.to_le_bytes()
    }
}

/// MPG counts of 64 bits from counters of 8. A counter must not move 128 counts or more between
/// two reads.
///
/// # Real time
/// Constant time, no allocation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MpgCounters {
    last: Option<[u8; 4]>,
    counts: [i64; 4],
}

impl MpgCounters {
    /// Takes what a cycle read, and gives the counts since the first call.
    pub fn read(&mut self, word: MpgWord) -> [i64; 4] {
        let now = word.counts();
        let last = self.last.replace(now).unwrap_or(now);
        for ((count, now), last) in self.counts.iter_mut().zip(now).zip(last) {
            *count = count.wrapping_add(i64::from(now.wrapping_sub(last) as i8));
        }
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_default_scans_sixteen_inputs_at_20_khz() {
        let control = InMuxControl::new(100_000_000, 15, &InMuxConfig::default());
        // 25 MHz / 16 / 20 kHz = 78.1: divisor 77.
        assert_eq!(control.0, 15 | 1 << 5 | 77 << 6 | 5 << 16 | 500 << 22);
        assert!((control.scan_hz(100_000_000) - 20_032.05).abs() < 0.01);
        assert_eq!((control.short_filter(), control.long_filter()), (5, 500));
        assert!(control.is_inverted());
    }

    #[test]
    fn rates_and_filters_that_do_not_fit_become_the_nearest() {
        let config = InMuxConfig {
            scan_hz: f64::NAN,
            short_filter: 255,
            long_filter: 60_000,
            invert: true,
            ..InMuxConfig::default()
        };
        assert_eq!(InMuxControl::new(100_000_000, 0, &config).0, 0xFFFF_0020);
        let slow = InMuxConfig {
            scan_hz: 0.0,
            ..config
        };
        assert_eq!(InMuxControl::new(100_000_000, 0, &slow).divisor(), 1023);
    }

    #[test]
    fn each_mpg_has_its_byte() {
        assert_eq!(MpgModes::new([true, false, false, true]).0, 0x0100_0001);
        assert_eq!(MpgWord(0xFF03_0201).counts(), [1, 2, 3, 0xFF]);
    }

    proptest! {
        #[test]
        fn mpg_counts_follow_wide_counters(
            start: u32,
            steps in prop::collection::vec(prop::array::uniform4(-127i64..=127), 1..300),
        ) {
            let mut wide = MpgWord(start).counts().map(i64::from);
            let first = wide;
            let mut counters = MpgCounters::default();
            prop_assert_eq!(counters.read(MpgWord(start)), [0; 4]);
            for step in steps {
                for (wide, step) in wide.iter_mut().zip(step) {
                    *wide += step;
                }
                let word = MpgWord(u32::from_le_bytes(wide.map(|count| count as u8)));
                let counts = counters.read(word);
                for ((count, wide), first) in counts.into_iter().zip(wide).zip(first) {
                    prop_assert_eq!(count, wide - first);
                }
            }
        }
    }
}
