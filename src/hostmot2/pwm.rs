//! PWM and PDM generators: analog outputs.

use super::io_port::WriteList;
use super::{Gtag, HostMot2, LocateError, ModuleError, RegisterBlock};
use crate::bus::RegisterBus;

/// The registers of all PWM generators.
///
/// Source: REGISTERS.md, "PWM"; FACTS 9.4, 9.5.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PwmGenerators {
    /// The duties, see [`PwmScale::encode`].
    pub value: RegisterBlock,
    /// The modes, see [`PwmMode`].
    pub mode: RegisterBlock,
    /// The PWM clock, one for all: clock*n/65536.
    pub master_rate: u16,
    /// The PDM clock, one for all: clock*n/65536. Each of its ticks is one step of 4096.
    pub pdm_rate: u16,
    /// The enable outputs: bit n is generator n, 1 = enabled, which drives the pin low. They do
    /// nothing else: the PWM goes on. FACTS 12.3.
    pub enables: u16,
    version: u8,
    clock_hz: u32,
}

impl PwmGenerators {
    const REGISTERS: u8 = 5;
    const MULTIPLE: u32 = 0x3;

    /// The PWM generators of a firmware.
    ///
    /// # Errors
    /// If the firmware has none, or none of version 0 or 1 (which dithers).
    pub fn locate(firmware: &HostMot2) -> Result<Self, LocateError> {
        let module = firmware.require(Gtag::PWM)?;
        module.expect(&[Gtag::PWM], Self::REGISTERS, Self::MULTIPLE)?;
        if module.version > 1 {
            return Err(LocateError::Module(ModuleError::UnknownVersion {
                gtag: module.gtag,
                version: module.version,
                oldest: 0,
                newest: 1,
            }));
        }
        Ok(Self {
            value: module.block(0)?,
            mode: module.block(1)?,
            master_rate: module.block(2)?.first(),
            pdm_rate: module.block(3)?.first(),
            enables: module.block(4)?.first(),
            version: module.version,
            clock_hz: module.clock_hz,
        })
    }

    /// Number of generators.
    pub const fn instances(&self) -> u8 {
        self.value.count()
    }

    /// The clock that the rates divide, in Hz.
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }

    /// Whether the fraction of the duty is used: module version 1.
    pub const fn can_dither(&self) -> bool {
        self.version >= 1
    }

    /// The PWM frequency that is nearest to `hz`, with the widest duty that still gives it.
    pub fn rate_for(&self, hz: f64, symmetrical: bool) -> PwmRate {
        PwmRate::new(self.clock_hz, hz, symmetrical)
    }

    /// Sets all generators up, in one exchange: they are at rest when it is over, without waiting
    /// for the end of a period. Instances beyond `configs` are left alone.
    ///
    /// # Real time
    /// For set-up: allocates.
    pub fn set_up<B: RegisterBus>(
        &self,
        bus: &mut B,
        rate: PwmRate,
        pdm: PdmRate,
        configs: &[PwmScale],
    ) -> Result<(), B::Error> {
        let mut list = WriteList::default();
        list.push(self.enables, 0);
        list.push(self.master_rate, rate.rate.into());
        list.push(self.pdm_rate, pdm.rate.into());
        // A value that is double buffered would wait for the end of a period.
        for (config, address) in configs.iter().zip(self.mode.addresses()) {
            list.push(address, config.mode().not_buffered().0);
        }
        for (config, address) in configs.iter().zip(self.value.addresses()) {
            list.push(address, config.encode(0.0).word);
        }
        for (config, address) in configs.iter().zip(self.mode.addresses()) {
            list.push(address, config.mode().0);
        }
        list.run(bus)
    }
}

/// How many bits a duty has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PwmWidth {
    /// 512 steps.
    Bits9,
    /// 1024 steps.
    Bits10,
    /// 2048 steps.
    Bits11,
    /// 4096 steps.
    Bits12,
}

impl PwmWidth {
    const WIDEST_FIRST: [Self; 4] = [Self::Bits12, Self::Bits11, Self::Bits10, Self::Bits9];

    /// The number of bits.
    pub const fn bits(self) -> u8 {
        9 + self as u8
    }

    /// The number of steps.
    pub const fn steps(self) -> u32 {
        1 << self.bits()
    }
}

/// The master rate register, and the width that goes with it.
///
/// PWMClock = clock*n/65536; PWM rate = PWMClock/2^bits, symmetrical /2^(bits+1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PwmRate {
    /// The register.
    pub rate: u16,
    /// Bits of the duty.
    pub width: PwmWidth,
    /// Counts up and down: half the rate, and the middle of the pulse does not move.
    pub symmetrical: bool,
}

impl PwmRate {
    /// The widest duty that gives `hz`; what the hardware can not do becomes the nearest that it
    /// can, values that are not finite the slowest.
    pub fn new(clock_hz: u32, hz: f64, symmetrical: bool) -> Self {
        let rate_of = |width: PwmWidth| {
            let steps = f64::from(width.steps()) * if symmetrical { 2.0 } else { 1.0 };
            libm::round(hz * steps * 65_536.0 / f64::from(clock_hz))
        };
        let width = PwmWidth::WIDEST_FIRST
            .into_iter()
            .find(|&width| rate_of(width) <= f64::from(u16::MAX))
            .unwrap_or(PwmWidth::Bits9);
        Self {
            rate: to_rate(rate_of(width)),
            width,
            symmetrical,
        }
    }

    /// The PWM frequency in Hz.
    pub fn hz(self, clock_hz: u32) -> f64 {
        let steps = f64::from(self.width.steps()) * if self.symmetrical { 2.0 } else { 1.0 };
        f64::from(clock_hz) * f64::from(self.rate) / 65_536.0 / steps
    }
}

/// The PDM rate register: clock*n/65536. PDM has always 12 bits, and takes 4096 ticks for all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PdmRate {
    /// The register.
    pub rate: u16,
}

impl PdmRate {
    /// The rate at which the PDM clock ticks `hz` times a second, or the nearest that the hardware
    /// can do. It is LinuxCNC's `pdm_frequency`.
    pub fn new(clock_hz: u32, hz: f64) -> Self {
        let rate = libm::round(hz * 65_536.0 / f64::from(clock_hz));
        Self {
            rate: to_rate(rate),
        }
    }

    /// The PDM clock in Hz.
    pub fn hz(self, clock_hz: u32) -> f64 {
        f64::from(clock_hz) * f64::from(self.rate) / 65_536.0
    }
}

/// At least 1, since 0 would stop the outputs where they are. `NaN` becomes 1 as well.
fn to_rate(rate: f64) -> u16 {
    (rate.clamp(0.0, f64::from(u16::MAX)) as u16).max(1)
}

/// What the output pins of a generator do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PwmOutput {
    /// PWM on the first pin, direction on the second.
    #[default]
    PwmDir,
    /// Direction on the first pin, PWM on the second.
    DirPwm,
    /// PWM on the first pin for positive, on the second for negative values.
    UpDown,
    /// Pulse density on the first pin, direction on the second; 12 bits.
    PdmDir,
}

/// The mode register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PwmMode(pub u32);

impl PwmMode {
    const SYMMETRICAL: u32 = 1 << 2;
    const DOUBLE_BUFFERED: u32 = 1 << 5;
    const DITHER: u32 = 1 << 6;

    /// Builds the mode. Values are always double buffered: a change waits for the end of a period.
    pub const fn new(width: PwmWidth, symmetrical: bool, output: PwmOutput, dither: bool) -> Self {
        let mut word = width as u32 | (output as u32) << 3 | Self::DOUBLE_BUFFERED;
        if symmetrical {
            word |= Self::SYMMETRICAL;
        }
        if dither {
            word |= Self::DITHER;
        }
        Self(word)
    }

    /// The same, but values take effect at once.
    #[must_use]
    pub const fn not_buffered(self) -> Self {
        Self(self.0 & !Self::DOUBLE_BUFFERED)
    }

    /// Bits of the duty.
    pub const fn width(self) -> PwmWidth {
        match self.0 & 3 {
            0 => PwmWidth::Bits9,
            1 => PwmWidth::Bits10,
            2 => PwmWidth::Bits11,
            _ => PwmWidth::Bits12,
        }
    }

    /// What the output pins do.
    pub const fn output(self) -> PwmOutput {
        match (self.0 >> 3) & 3 {
            0 => PwmOutput::PwmDir,
            1 => PwmOutput::DirPwm,
            2 => PwmOutput::UpDown,
            _ => PwmOutput::PdmDir,
        }
    }

    /// Whether it counts up and down.
    pub const fn is_symmetrical(self) -> bool {
        self.0 & Self::SYMMETRICAL != 0
    }

    /// Whether the fraction of the duty is used.
    pub const fn has_dither(self) -> bool {
        self.0 & Self::DITHER != 0
    }
}

/// From engineering values to duties.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PwmScale {
    /// The value at full duty; in offset mode also, negated, the one at none.
    /// 0 and values that are not finite keep the output at rest.
    pub scale: f64,
    /// Bits of the duty, of [`PwmRate::width`]. PDM has 12 whatever is said here.
    pub width: PwmWidth,
    /// Counts up and down.
    pub symmetrical: bool,
    /// What the output pins do.
    pub output: PwmOutput,
    /// Offset mode: 0 is half scale, and direction is not used. What the 7I97 needs.
    pub offset: bool,
    /// Use the fraction of the duty too: only module version 1 can.
    pub dither: bool,
}

/// A duty, and what became of the value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PwmValue {
    /// The register: bits 27..16 duty, 15..0 fraction, bit 31 direction.
    pub word: u32,
    /// The value was beyond the scale and became the nearest end.
    pub clamped: bool,
    /// The value was not finite and became 0.
    pub not_finite: bool,
}

impl PwmScale {
    /// Volts on the analog outputs of a 7I97: +-10 V, offset mode. `dither` as
    /// [`PwmGenerators::can_dither`] says.
    /// Manual: 7I97, "SUGGESTED PWM SETUP".
    pub const fn volts_7i97(rate: PwmRate, dither: bool) -> Self {
        Self {
            scale: 10.0,
            width: rate.width,
            symmetrical: rate.symmetrical,
            output: PwmOutput::PwmDir,
            offset: true,
            dither,
        }
    }

    /// The mode register.
    pub const fn mode(&self) -> PwmMode {
        PwmMode::new(
            self.effective_width(),
            self.symmetrical,
            self.output,
            self.dither,
        )
    }

    /// The register for a value. Values that are not finite become 0 (half scale in offset mode),
    /// values beyond the scale its nearest end: never a wrap-around.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn encode(&self, value: f64) -> PwmValue {
        let not_finite = !value.is_finite();
        let relative = if not_finite || !self.scale.is_finite() || self.scale == 0.0 {
            0.0
        } else {
            value / self.scale
        };
        let clamped = !(-1.0..=1.0).contains(&relative);
        let relative = relative.clamp(-1.0, 1.0);
        let steps = f64::from(self.effective_width().steps());
        let (duty, negative) = if self.offset {
            (relative * steps / 2.0 + steps / 2.0, false)
        } else {
            (relative.abs() * (steps - 1.0), relative < 0.0)
        };
        PwmValue {
            word: self.fixed_point(duty, steps) | u32::from(negative) << 31,
            clamped,
            not_finite,
        }
    }

    /// The value that a register stands for.
    pub fn decode(&self, word: u32) -> f64 {
        let steps = f64::from(self.effective_width().steps());
        let duty = f64::from(word & 0x0FFF_FFFF) / 65_536.0;
        if self.offset {
            (duty - steps / 2.0) / (steps / 2.0) * self.scale
        } else {
            let sign = if word >> 31 == 1 { -1.0 } else { 1.0 };
            sign * duty / (steps - 1.0) * self.scale
        }
    }

    const fn effective_width(&self) -> PwmWidth {
        match self.output {
            PwmOutput::PdmDir => PwmWidth::Bits12,
            _ => self.width,
        }
    }

    /// Duty with 16 bits of fraction if it dithers, whole steps else; at most full scale.
    fn fixed_point(&self, duty: f64, steps: f64) -> u32 {
        let largest = steps - 1.0;
        if self.dither {
            libm::round(duty.min(largest) * 65_536.0) as u32
        } else {
            (libm::round(duty).min(largest) as u32) << 16
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CLOCK: u32 = 200_000_000;

    fn volts(dither: bool) -> PwmScale {
        PwmScale::volts_7i97(PwmRate::new(CLOCK, 48_000.0, false), dither)
    }

    #[test]
    fn the_rates_of_the_7i97_manual_are_reached_with_the_widest_duty() {
        let slow = PwmRate::new(CLOCK, 48_000.0, false);
        assert_eq!((slow.width, slow.rate), (PwmWidth::Bits12, 64_425));
        let fast = PwmRate::new(CLOCK, 96_000.0, false);
        assert_eq!((fast.width, fast.rate), (PwmWidth::Bits11, 64_425));
        assert!((fast.hz(CLOCK) - 96_000.0).abs() < 1.0);
        let symmetrical = PwmRate::new(CLOCK, 48_000.0, true);
        assert_eq!(symmetrical.width, PwmWidth::Bits11);
        assert!((symmetrical.hz(CLOCK) - 48_000.0).abs() < 1.0);
        // One step of 4096 at each tick, as LinuxCNC counts.
        let pdm = PdmRate::new(CLOCK, 6_000_000.0);
        assert_eq!(pdm.rate, 1_966);
        assert!((pdm.hz(CLOCK) - 6_000_000.0).abs() < 2_000.0);
    }

    #[test]
    fn rates_out_of_reach_become_the_nearest() {
        assert_eq!(
            PwmRate::new(CLOCK, 1e9, false),
            PwmRate {
                rate: u16::MAX,
                width: PwmWidth::Bits9,
                symmetrical: false
            }
        );
        assert_eq!(PwmRate::new(CLOCK, -5.0, false).rate, 1);
        assert_eq!(PwmRate::new(CLOCK, f64::NAN, false).rate, 1);
        assert_eq!(PdmRate::new(CLOCK, f64::INFINITY).rate, u16::MAX);
    }

    #[test]
    fn modes_are_laid_out_as_the_register_list_says() {
        assert_eq!(volts(false).mode(), PwmMode(0x23));
        let mode = PwmMode::new(PwmWidth::Bits9, true, PwmOutput::UpDown, true);
        assert_eq!(mode, PwmMode(0x74));
        assert_eq!(mode.output(), PwmOutput::UpDown);
        assert!(mode.is_symmetrical() && mode.has_dither());
        let pdm = PwmScale {
            output: PwmOutput::PdmDir,
            width: PwmWidth::Bits9,
            ..volts(false)
        };
        assert_eq!(pdm.mode(), PwmMode(0x3B));
    }

    #[test]
    fn offset_mode_has_zero_at_half_scale_and_never_wraps() {
        let word = |value| volts(false).encode(value).word;
        assert_eq!(word(0.0), 0x0800_0000);
        assert_eq!(word(5.0), 0x0C00_0000);
        assert_eq!(word(10.0), 0x0FFF_0000);
        assert_eq!(word(-10.0), 0);
        assert_eq!(
            volts(false).encode(1e300),
            PwmValue {
                word: 0x0FFF_0000,
                clamped: true,
                not_finite: false
            }
        );
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(
                volts(false).encode(value),
                PwmValue {
                    word: 0x0800_0000,
                    clamped: false,
                    not_finite: true
                }
            );
        }
    }

    #[test]
    fn sign_and_magnitude_use_bit_31() {
        let scale = PwmScale {
            offset: false,
            ..volts(false)
        };
        assert_eq!(scale.encode(10.0).word, 0x0FFF_0000);
        assert_eq!(scale.encode(-10.0).word, 0x8FFF_0000);
        assert_eq!(scale.encode(0.0).word, 0);
        let useless = PwmScale {
            scale: 0.0,
            ..scale
        };
        assert_eq!(useless.encode(3.0).word, 0);
    }

    proptest! {
        #[test]
        fn values_come_back_within_half_a_step(
            value in -10.0f64..=10.0,
            offset: bool,
            dither: bool,
            width in prop::sample::select(&PwmWidth::WIDEST_FIRST),
        ) {
            let scale = PwmScale { width, offset, ..volts(dither) };
            let steps = f64::from(width.steps());
            let step = if offset { 20.0 / steps } else { 10.0 / (steps - 1.0) };
            // The upper end of offset mode is one step below full scale.
            let value = if offset { value.min(10.0 - step) } else { value };
            let step = if dither { step / 65_536.0 } else { step };
            let encoded = scale.encode(value);
            prop_assert!((scale.decode(encoded.word) - value).abs() <= step * 0.500_001);
            prop_assert!(!encoded.clamped && !encoded.not_finite);
        }

        #[test]
        fn any_value_gives_a_duty_within_the_width(value: f64, offset: bool, dither: bool) {
            let scale = PwmScale { offset, width: PwmWidth::Bits10, ..volts(dither) };
            let word = scale.encode(value).word;
            prop_assert!((word & 0x7FFF_FFFF) >> 16 < 1024);
        }
    }
}
