//! HM2DPLL: samples encoders and serial inputs in step with the host's thread.

use super::{Gtag, HostMot2, LocateError};
use crate::bus::{Access, RegisterBus};
use thiserror::Error;

/// The registers of the DPLL.
///
/// Source: REGISTERS.md, "DPLL (HM2DPLL)"; FACTS 9.5.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dpll {
    /// Phase step per clock.
    pub base_rate: u16,
    /// The phase as it is now; a write sets it.
    pub phase: u16,
    /// Control 0: prescale and phase limit; reads prescale and the present correction. A write makes
    /// the loop forget its error, filter and integrator.
    pub control_0: u16,
    /// Control 1: time constant; its low byte reads the DDS size.
    pub control_1: u16,
    /// Timers 2 and 1.
    pub timers_12: u16,
    /// Timers 4 and 3.
    pub timers_34: u16,
    /// Any access marks the thread's read and latches the phase, which it reads: the phase error.
    pub sync: u16,
    clock_hz: u32,
}

/// How the DPLL follows the thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DpllConfig {
    /// Rate of the thread in Hz.
    pub hz: f64,
    /// The greatest phase error that counts, in 2^-24 of a period: at most 0x7F_FFFF, half a period.
    pub phase_limit: u32,
    /// Steps of the accumulator from one step of the filter to the next, about 4200 of which make
    /// a period. The greater, the slower.
    pub time_constant: u16,
    /// When the timers rise, in us from the thread's read; before it is negative.
    pub timers_us: [f64; 4],
}

impl Default for DpllConfig {
    /// 1 kHz, with limit and time constant as integrators know them; all timers 100 us before
    /// the read.
    fn default() -> Self {
        Self {
            hz: 1_000.0,
            phase_limit: 0x40_0000,
            time_constant: 0xA000,
            timers_us: [-100.0; 4],
        }
    }
}

/// The register values of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DpllSetup {
    /// Phase step per clock.
    pub base_rate: u32,
    /// Clocks per phase step.
    pub prescale: u8,
    /// Control 0.
    pub control_0: u32,
    /// Control 1.
    pub control_1: u32,
    /// Timers 2 and 1.
    pub timers_12: u32,
    /// Timers 4 and 3.
    pub timers_34: u32,
}

/// Why a configuration can not be had.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DpllError<E: core::error::Error + 'static> {
    /// The bus failed.
    #[error("setting the DPLL up failed")]
    Bus(#[source] E),
    /// The rate of the thread is out of reach.
    #[error(
        "the DPLL can not follow {hz} Hz: with a clock of {clock_hz} Hz and {dds_bits} bits, \
         prescale {prescale} (1 to 255) and base rate {base_rate} (1 to 2^32-1) would be needed; \
         choose another thread period"
    )]
    Rate {
        /// What was asked for.
        hz: f64,
        /// The clock.
        clock_hz: u32,
        /// Size of the DDS.
        dds_bits: u8,
        /// The prescale that would be needed.
        prescale: f64,
        /// The base rate that would be needed.
        base_rate: f64,
    },
    /// The size of the DDS makes no sense.
    #[error(
        "the DPLL reports a DDS of {found} bits, expected 1 to 63: this firmware's DPLL is not \
         known, go on without it"
    )]
    DdsSize {
        /// What was read.
        found: u8,
    },
}

impl Dpll {
    /// The DPLL of a firmware.
    pub fn locate(firmware: &HostMot2) -> Result<Self, LocateError> {
        let module = firmware.require(Gtag::HM2DPLL)?;
        module.expect(&[Gtag::HM2DPLL], 7, 0)?;
        let register = |register| module.block(register).map(|block| block.first());
        Ok(Self {
            base_rate: register(0)?,
            phase: register(1)?,
            control_0: register(2)?,
            control_1: register(3)?,
            timers_12: register(4)?,
            timers_34: register(5)?,
            sync: register(6)?,
            clock_hz: module.clock_hz,
        })
    }

    /// The clock that the loop divides, in Hz.
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }

    /// Asks for the size of the DDS, computes the setup and writes it: two exchanges.
    pub fn set_up<B: RegisterBus>(
        &self,
        bus: &mut B,
        config: &DpllConfig,
    ) -> Result<DpllSetup, DpllError<B::Error>> {
        let dds_bits = bus.read(self.control_1).map_err(DpllError::Bus)? as u8;
        let setup = DpllSetup::new(self.clock_hz, dds_bits, config)?;
        bus.exchange(
            &[
                Access::write(self.base_rate, 0, 1),
                Access::write(self.control_0, 1, 1),
                Access::write(self.control_1, 2, 1),
                Access::write(self.timers_12, 3, 1),
                Access::write(self.timers_34, 4, 1),
            ],
            &mut [
                setup.base_rate,
                setup.control_0,
                setup.control_1,
                setup.timers_12,
                setup.timers_34,
            ],
        )
        .map_err(DpllError::Bus)?;
        Ok(setup)
    }
}

impl DpllSetup {
    /// The words for a loop with this clock and a DDS of `dds_bits`:
    /// prescale = 2^30*clock / (2^dds * Hz), at least 1; base rate = Hz * 2^dds * prescale / clock,
    /// both cut off as LinuxCNC does.
    ///
    /// # Errors
    /// [`DpllError::Rate`], [`DpllError::DdsSize`].
    pub fn new<E: core::error::Error + 'static>(
        clock_hz: u32,
        dds_bits: u8,
        config: &DpllConfig,
    ) -> Result<Self, DpllError<E>> {
        if !(1..=63).contains(&dds_bits) {
            return Err(DpllError::DdsSize { found: dds_bits });
        }
        let clock = f64::from(clock_hz);
        let turn = libm::ldexp(1.0, i32::from(dds_bits)) * config.hz;
        let prescale = libm::floor(libm::ldexp(clock, 30) / turn).max(1.0);
        let base_rate = libm::floor(turn * prescale / clock);
        let fits = config.hz > 0.0
            && (1.0..=255.0).contains(&prescale)
            && (1.0..=f64::from(u32::MAX)).contains(&base_rate);
        if !fits {
            return Err(DpllError::Rate {
                hz: config.hz,
                clock_hz,
                dds_bits,
                prescale,
                base_rate,
            });
        }
        let [one, two, three, four] = config
            .timers_us
            .map(|us| u32::from(timer_of(us, config.hz)));
        Ok(Self {
            base_rate: base_rate as u32,
            prescale: prescale as u8,
            control_0: (prescale as u32) << 24 | config.phase_limit.min(0xFF_FFFF),
            control_1: u32::from(config.time_constant) << 16,
            timers_12: two << 16 | one,
            timers_34: four << 16 | three,
        })
    }

    /// The rate that the setup has, in Hz, with a DDS of `dds_bits`.
    pub fn hz(&self, clock_hz: u32, dds_bits: u8) -> f64 {
        let turn = libm::ldexp(f64::from(self.prescale), i32::from(dds_bits));
        f64::from(self.base_rate) * f64::from(clock_hz) / turn
    }
}

/// A timer as a fraction of the period in 1/65536. The register says how long **before** the read
/// the timer rises, so that its sign is the other one: -100 us of 1 ms are 0x1999 (FACTS 12.4).
/// Whole periods are left out; what is not a number becomes 0.
fn timer_of(us: f64, hz: f64) -> u16 {
    let fraction = libm::floor(-us * hz * 65_536.0 / 1e6);
    let within = fraction - 65_536.0 * libm::floor(fraction / 65_536.0);
    if within.is_nan() { 0 } else { within as u16 }
}

/// The phase error in us that the sync register says, for a thread of `hz`: a signed fraction of
/// the period in 1/2^32, positive if the thread reads late.
pub fn phase_error_us(word: u32, hz: f64) -> f64 {
    f64::from(word as i32) / 4_294_967_296.0 / hz * 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::convert::Infallible;
    use proptest::prelude::*;

    const CLOCK: u32 = 100_000_000;

    fn setup(dds: u8, config: &DpllConfig) -> Result<DpllSetup, DpllError<Infallible>> {
        DpllSetup::new(CLOCK, dds, config)
    }

    #[test]
    fn a_thread_of_1_khz_at_100_mhz_with_42_bits() {
        // 2^30*1e8/(2^42*1e3) = 24.4; 1e3*2^42*24/1e8 = 1055531162.66.
        let words = setup(42, &DpllConfig::default()).unwrap();
        assert_eq!((words.prescale, words.base_rate), (24, 1_055_531_162));
        assert_eq!(words.control_0, 0x1840_0000);
        assert_eq!(words.control_1, 0xA000_0000);
        // 100 us before, of 1 ms: 6553.6.
        assert_eq!(words.timers_12, 0x1999_1999);
        assert!((words.hz(CLOCK, 42) - 1_000.0).abs() < 1e-5);
    }

    #[test]
    fn each_timer_has_its_half_word() {
        let config = DpllConfig {
            timers_us: [-100.0, 100.0, 250.0, f64::NAN],
            ..DpllConfig::default()
        };
        let words = setup(42, &config).unwrap();
        assert_eq!(words.timers_12, 0xE666_1999);
        assert_eq!(words.timers_34, 0x0000_C000);
        let timer = |us: f64| timer_of(us, 1_000.0);
        assert_eq!(
            [timer(0.0), timer(-500.0), timer(500.0)],
            [0, 0x8000, 0x8000]
        );
        assert_eq!([timer(-600.0), timer(400.0)], [0x9999, 0x9999]);
        assert_eq!([timer(-1e9), timer(f64::INFINITY)], [0, 0]);
    }

    #[test]
    fn phase_errors_are_signed_fractions_of_the_period() {
        assert!((phase_error_us(0x4000_0000, 1_000.0) - 250.0).abs() < 1e-9);
        assert!((phase_error_us(0xFFFF_FFFF, 1_000.0) + 1e3 / 4_294_967_296.0).abs() < 1e-9);
    }

    #[test]
    fn what_the_hardware_can_not_do_is_an_error() {
        let slow = DpllConfig {
            hz: 1.0,
            ..DpllConfig::default()
        };
        assert!(matches!(setup(42, &slow), Err(DpllError::Rate { .. })));
        assert_eq!(
            setup(0, &DpllConfig::default()),
            Err(DpllError::DdsSize { found: 0 })
        );
        for hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let config = DpllConfig {
                hz,
                ..DpllConfig::default()
            };
            assert!(setup(42, &config).is_err(), "{hz}");
        }
    }

    proptest! {
        #[test]
        fn the_rate_is_met_to_a_millionth(hz in 100.0f64..20_000.0) {
            let config = DpllConfig { hz, ..DpllConfig::default() };
            if let Ok(words) = setup(42, &config) {
                prop_assert!((words.hz(CLOCK, 42) / hz - 1.0).abs() < 1e-6);
            } else {
                prop_assert!(hz < 200.0);
            }
        }
    }
}
