//! HM2DPLL: samples encoders and serial inputs in step with the host's thread, or paces the host.
//!
//! Source: FACTS 13.8, 9.5, 12.4.

use alloc::format;
use core::time::Duration;

use super::limit::Limit;
use super::registrar::DrivenModule;
use super::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::advice;
use crate::bus::{Instant, Phase, ReadSlot, Setting, Stage};
use crate::events::CorrectedValue;
use crate::hal::{Input, Output, PinError, PinMaker, PinStore};
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor};
use crate::settings::{Defaults, Pace};
use crate::tally::Tally;

/// Frequency in kHz that stands for that of the period, as in LinuxCNC.
const OF_PERIOD: f64 = -1.0;
/// Frequency in kHz of a loop whose prescale cannot follow the period: that of a usual one.
const ALONE_KHZ: f64 = 1.0;

/// The pins of the phase-locked loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct DpllPins {
    /// Times at which the four timers rise, in microseconds from the read; negative is before it.
    pub timer_us: [Output<f64>; 4],
    /// The loop's frequency in kHz. Negative is that of the period, and the initial value with
    /// [`Defaults::LinuxCnc`](crate::driver::Defaults).
    pub base_freq_khz: Output<f64>,
    /// Lateness of the last read for the loop, in microseconds; negative is early. 0 where the
    /// board paces the cycle, since the loop then runs free.
    pub phase_error_us: Input<f64>,
    /// Time constant of the loop's filter.
    pub time_const: Output<u32>,
    /// The greatest phase error that counts, see [`DpllConfig::phase_limit`]; 0 lets the loop run
    /// free.
    pub plimit: Output<u32>,
    /// Width of the loop's accumulator, in bits.
    pub ddsize: Input<u32>,
    /// Divisor of the loop's clock.
    pub prescale: Input<u32>,
}

/// The phase-locked loop: times the board by the reads, or the reads by the board.
#[derive(Debug)]
pub struct Dpll {
    /// The handles of the pins.
    pub pins: DpllPins,
    clock_hz: u32,
    dds_bits: u8,
    config: DpllConfig,
    words: [u32; 5],
    /// The frequency that follows from the period, in kHz.
    usual_khz: f64,
    /// In the order of the words.
    settings: [Setting; 5],
    /// The last values of `time-const` and `plimit` that are not allowed.
    reported: [Option<i64>; 2],
    /// The last frequency that the loop cannot have, in Hz.
    refused_hz: Option<i64>,
    /// The registers for following the host; `None` where the board paces, and the loop runs free.
    /// Any access of the first register marks the thread's read and latches the phase, which the
    /// register returns as the phase error. A write of the second sets the phase.
    following: Option<(ReadSlot, Setting)>,
    start: PhaseStart,
}

impl Dpll {
    /// Registers the loop of a firmware, if the firmware has one and the settings allow it.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        let Some(DrivenModule { descriptor, .. }) = r.driven(&[Gtag::HM2DPLL]).first().copied()
        else {
            return Ok(());
        };
        let module = descriptor;
        let dds_bits = r.peek(module.register(3, 0)?)? as u8;
        let clock_hz = module.clock_hz;
        let is_following = r.settings.pace == Pace::Host;
        let of_period = 1e-3 / r.settings.period.as_secs_f64();
        let khz = if is_following && !can_follow(of_period, clock_hz, dds_bits) {
            ALONE_KHZ
        } else {
            of_period
        };
        let initial_khz = match r.settings.defaults {
            Defaults::LinuxCnc => OF_PERIOD,
            Defaults::Board => khz,
        };
        let pins = DpllPins::new(r.maker("dpll."), initial_khz)?;
        let config = pins.config(r.pins, khz);
        let words = config.words(clock_hz, dds_bits);
        let words = words.map_err(|divisors| unusable_rate(khz, clock_hz, dds_bits, divisors))?;
        let [base_rate, control_0, control_1, timers_12, timers_34] = words;
        r.pins.publish(pins.ddsize, dds_bits.into());
        r.pins.publish(pins.prescale, control_0 >> 24);
        let mut setting = |register, word| {
            let address = module.register(register, 0)?;
            Ok::<_, RegisterError>(r.image.setting(Stage::Configure, address, word))
        };
        let settings = [
            setting(0, base_rate)?,
            setting(2, control_0)?,
            setting(3, control_1)?,
            setting(4, timers_12)?,
            setting(5, timers_34)?,
        ];
        let (phase, sync) = (module.register(1, 0)?, module.register(6, 0)?);
        // First, because the loop follows the time of this access.
        let following =
            is_following.then(|| (r.image.read(Phase::First, sync), r.image.on_demand(phase)));
        r.add(Self {
            pins,
            clock_hz,
            dds_bits,
            config,
            words,
            usual_khz: khz,
            settings,
            reported: [None; 2],
            refused_hz: None,
            following,
            start: PhaseStart::default(),
        });
        Ok(())
    }
}

/// True if the registers have room for a loop of this frequency.
fn can_follow(khz: f64, clock_hz: u32, dds_bits: u8) -> bool {
    let config = DpllConfig {
        hz: khz * 1e3,
        phase_limit: 0,
        time_constant: 0,
        timers_us: [0.0; 4],
    };
    config.words(clock_hz, dds_bits).is_ok()
}

fn unusable_rate(
    khz: f64,
    clock_hz: u32,
    dds_bits: u8,
    (prescale, base_rate): (f64, f64),
) -> RegisterError {
    RegisterError::Setting {
        what: "rate that the DPLL follows",
        found: format!(
            "{khz} kHz, which with a clock of {clock_hz} Hz and a DDS of {dds_bits} bits needs prescale \
             {prescale} and base rate {base_rate}"
        ),
        expected: "1 to 63 bits, prescale 1 to 255 and base rate 1 to 2^32-1".into(),
        advice: advice::LEAVE_DPLL,
    }
}

/// Checks the layout, in any version.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    module.check_layout(7, 0)
}

impl Dpll {
    /// Frequency of the loop in kHz: that of the period, unless the application has set another
    /// one, or the prescale cannot follow the period (a 7I97 has it from 10.4 ms on), so that the
    /// loop is left alone. The timers then rise without a relation to the reads.
    pub fn khz(&self) -> f64 {
        self.config.hz * 1e-3
    }
}

impl Dpll {
    /// Reports values that the registers do not hold: the largest ones are used.
    fn check_limits(&mut self, cycle: &mut WriteCycle<'_>) {
        let [of_time, of_limit] = &mut self.reported;
        let limit = |setting, highest: u32| Limit {
            setting,
            number: 0,
            lowest: 0,
            highest: highest.into(),
            instead: None,
        };
        let (time, phase) = (self.pins.time_const, self.pins.plimit);
        limit(CorrectedValue::DpllTimeConst, u16::MAX.into()).pin(cycle, time, of_time);
        limit(CorrectedValue::DpllPhaseLimit, 0xFF_FFFF).pin(cycle, phase, of_limit);
    }

    /// Reports a frequency that the loop cannot have, once.
    fn refuse_frequency(&mut self, cycle: &WriteCycle<'_>, hz: f64) {
        let asked = hz as i64;
        if self.refused_hz.replace(asked) == Some(asked) {
            return;
        }
        // Prescale 255, and a phase step of less than a turn.
        let turns = libm::ldexp(
            f64::from(self.clock_hz),
            i32::from(self.dds_bits).saturating_neg(),
        );
        let slowest = libm::ldexp(turns, 30 - 8);
        let limit = Limit {
            setting: CorrectedValue::DpllFrequency,
            number: 0,
            lowest: (slowest as i64).saturating_add(1),
            highest: libm::ldexp(turns, 32) as i64,
            instead: None,
        };
        limit.report(cycle, asked, self.config.hz as i64);
    }
}

impl Module for Dpll {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        if let Some((sync, _)) = self.following {
            let word = cycle.words.word(sync);
            let error = phase_error_us(word, self.config.hz);
            cycle.pins.publish(self.pins.phase_error_us, error);
            self.start.read(word);
        }
    }

    /// A frequency that the loop cannot reach is counted as refused, and the previous one stays.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        let [_, control_0, ..] = self.settings;
        // Control 0 is written again, so that the loop discards the error that it has accumulated
        // meanwhile.
        if let Some((_, phase)) = self.following
            && let Some(word) = self.start.write()
        {
            cycle.words.set(phase, word);
            cycle.words.repeat(phase);
            cycle.words.repeat(control_0);
        }
        if !cycle.changed {
            return;
        }
        self.check_limits(cycle);
        let config = self.pins.config(cycle.pins, self.usual_khz);
        if config == self.config {
            return;
        }
        let Ok(words) = config.words(self.clock_hz, self.dds_bits) else {
            self.refuse_frequency(cycle, config.hz);
            let pin = self.pins.base_freq_khz;
            return cycle.pins.count_out_of_range(pin);
        };
        self.refused_hz = None;
        let rate = |[base_rate, control_0, ..]: [u32; 5]| (base_rate, control_0 >> 24);
        if rate(words) != rate(self.words) {
            self.start = PhaseStart::default();
        }
        let (_, prescale) = rate(words);
        cycle.pins.publish(self.pins.prescale, prescale);
        (self.config, self.words) = (config, words);
        for (setting, word) in self.settings.into_iter().zip(words) {
            cycle.words.set(setting, word);
        }
    }

    /// A loop that cannot follow the period stays as it is.
    fn set_period(&mut self, period: Duration, pins: &mut PinStore) -> Result<(), RegisterError> {
        let khz = 1e-3 / period.as_secs_f64();
        let set = pins.commanded(self.pins.base_freq_khz);
        if set >= 0.0 && set.to_bits() != self.usual_khz.to_bits() {
            // By the application.
            return Ok(());
        }
        if can_follow(khz, self.clock_hz, self.dds_bits) {
            // The next write changes the registers.
            pins.set(self.pins.base_freq_khz, khz);
            self.usual_khz = khz;
        }
        Ok(())
    }

    /// Sets the phase anew, since the loop runs at another phase.
    fn restored(&mut self, _: &mut PinStore, _: Instant) {
        self.start = PhaseStart::default();
    }
}

impl DpllPins {
    fn new(mut make: PinMaker<'_>, khz: f64) -> Result<Self, PinError> {
        let mut timer_us = [Output::default(); 4];
        for (number, timer) in (1..).zip(&mut timer_us) {
            *timer = make.switch(format!("{number:02}.timer-us"), 100.0)?;
        }
        Ok(Self {
            timer_us,
            base_freq_khz: make.switch("base-freq-khz", khz)?,
            phase_error_us: make.input("phase-error-us")?,
            time_const: make.switch("time-const", 2000)?,
            plimit: make.switch("plimit", 0x0040_0000)?,
            ddsize: make.input("ddsize")?,
            prescale: make.input("prescale")?,
        })
    }

    fn config(&self, pins: &mut PinStore, usual_khz: f64) -> DpllConfig {
        let set = pins.fetch(self.base_freq_khz);
        let khz = if set < 0.0 { usual_khz } else { set };
        DpllConfig {
            hz: khz * 1e3,
            phase_limit: pins.fetch(self.plimit),
            time_constant: u16::try_from(pins.fetch(self.time_const)).unwrap_or(u16::MAX),
            timers_us: self.timer_us.map(|timer| pins.fetch(timer)),
        }
    }
}

/// Settings for following the thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DpllConfig {
    /// Rate of the thread in Hz.
    pub hz: f64,
    /// The greatest phase error that counts, in 2^-24 of a period: at most 0x7F_FFFF, half a
    /// period.
    pub phase_limit: u32,
    /// Steps of the accumulator between two steps of the filter; a period has about 4200 of them. A
    /// greater value makes the loop slower.
    pub time_constant: u16,
    /// Times at which the timers rise, in us from the thread's read; negative is before it.
    pub timers_us: [f64; 4],
}

impl DpllConfig {
    /// Returns the words of the registers for a loop with this clock and a DDS of `dds_bits`:
    /// - base rate, the phase step: Hz * 2^dds * prescale / clock;
    /// - control 0: prescale, the clocks of a phase step, 2^30*clock / (2^dds * Hz) and at least 1,
    ///   and phase limit. A write makes the loop discard its error, filter and integrator;
    /// - control 1: time constant; the low byte reads the size of the DDS;
    /// - timers 2 and 1, timers 4 and 3.
    ///
    /// All are truncated as in LinuxCNC, the timers toward zero.
    ///
    /// # Errors
    /// The prescale and base rate that would be needed: one of them is out of range, or the size of
    /// the DDS is unknown.
    pub fn words(&self, clock_hz: u32, dds_bits: u8) -> Result<[u32; 5], (f64, f64)> {
        let (hz, clock) = (self.hz, f64::from(clock_hz));
        let turn = libm::ldexp(1.0, i32::from(dds_bits)) * hz;
        let prescale = libm::floor(libm::ldexp(clock, 30) / turn).max(1.0);
        let base_rate = libm::floor(turn * prescale / clock);
        let fits = hz > 0.0
            && (1..=63).contains(&dds_bits)
            && (1.0..=255.0).contains(&prescale)
            && (1.0..=f64::from(u32::MAX)).contains(&base_rate);
        if !fits {
            return Err((prescale, base_rate));
        }
        let [one, two, three, four] = self.timers_us.map(|us| u32::from(timer_of(us, hz)));
        Ok([
            base_rate as u32,
            (prescale as u32) << 24 | self.phase_limit.min(0xFF_FFFF),
            u32::from(self.time_constant) << 16,
            two << 16 | one,
            four << 16 | three,
        ])
    }
}

/// Returns a timer as a fraction of the period in 1/65536. The register holds the time **before**
/// the read at which the timer rises, so that its sign is the opposite one: -100 us of 1 ms are
/// 0x1999 (FACTS 12.4). The value is truncated toward zero, as in LinuxCNC, so that both signs have
/// the same size. Whole periods are dropped; NaN becomes 0.
fn timer_of(us: f64, hz: f64) -> u16 {
    let fraction = libm::trunc(-us * hz * 65_536.0 / 1e6);
    let within = fraction - 65_536.0 * libm::floor(fraction / 65_536.0);
    if within.is_nan() { 0 } else { within as u16 }
}

/// The phase error in us from the word of the sync register, for a thread of `hz`: a signed
/// fraction of the period in 1/2^32, positive if the thread reads late.
fn phase_error_us(word: u32, hz: f64) -> f64 {
    f64::from(word as i32) / 4_294_967_296.0 / hz * 1e6
}

/// Number of periods in which the phase is set, as in LinuxCNC: the first periods of a machine are
/// irregular.
const PERIODS: u32 = 100;

/// Sets the phase of the loop with each write, such that the next read finds it at 0.
///
/// Left to itself, the loop takes seconds to get there, and rings (FACTS 12.4). LinuxCNC writes 0,
/// which makes the read early by the time from a read to its write. The next read shows that time,
/// and its mean is written from then on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct PhaseStart {
    writes: u32,
    /// The phase to write, in 2^-32 of a period.
    phase: i32,
    /// Reads that followed a write.
    reads: i32,
    is_written: bool,
}

impl PhaseStart {
    /// Takes the phase of the loop at a read, and corrects the phase to write if the read followed
    /// a write.
    fn read(&mut self, phase: u32) {
        if core::mem::take(&mut self.is_written) && self.writes < PERIODS {
            self.reads = self.reads.saturating_add(1);
            let step = (phase as i32).checked_div(self.reads).unwrap_or(0);
            self.phase = self.phase.wrapping_sub(step);
        }
    }

    /// The phase that this write sets; `None` after the first [`PERIODS`].
    fn write(&mut self) -> Option<u32> {
        if self.writes == PERIODS {
            return None;
        }
        self.writes.tally(1);
        self.is_written = true;
        Some(self.phase as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CLOCK: u32 = 100_000_000;

    /// 1 kHz, with LinuxCNC's limit; all timers 100 us before the read.
    const CONFIG: DpllConfig = DpllConfig {
        hz: 1_000.0,
        phase_limit: 0x40_0000,
        time_constant: 0xA000,
        timers_us: [-100.0; 4],
    };

    fn words(dds_bits: u8, config: &DpllConfig) -> Result<[u32; 5], (f64, f64)> {
        config.words(CLOCK, dds_bits)
    }

    /// The rate that the loop has with a DDS of 42 bits.
    fn hz([base_rate, control_0, ..]: [u32; 5]) -> f64 {
        let turn = libm::ldexp(f64::from(control_0 >> 24), 42);
        f64::from(base_rate) * f64::from(CLOCK) / turn
    }

    #[test]
    fn thread_of_1_khz_at_100_mhz_with_42_bits() {
        // 2^30*1e8/(2^42*1e3) = 24.4; 1e3*2^42*24/1e8 = 1055531162.66.
        let words = words(42, &CONFIG).unwrap();
        assert_eq!(
            words[..3],
            [1_055_531_162, 24 << 24 | 0x40_0000, 0xA000_0000]
        );
        // 100 us before, of 1 ms: 6553.6.
        assert_eq!(words[3], 0x1999_1999);
        assert!((hz(words) - 1_000.0).abs() < 1e-5);
    }

    #[test]
    fn each_timer_has_its_half_word() {
        let config = DpllConfig {
            timers_us: [-100.0, 100.0, 250.0, f64::NAN],
            ..CONFIG
        };
        let words = words(42, &config).unwrap();
        assert_eq!(words[3..], [0xE667_1999, 0x0000_C000]);
        let timer = |us: f64| timer_of(us, 1_000.0);
        let halves = [timer(0.0), timer(-500.0), timer(500.0)];
        assert_eq!(halves, [0, 0x8000, 0x8000]);
        assert_eq!([timer(-1e9), timer(f64::INFINITY)], [0, 0]);
    }

    #[test]
    fn timers_of_both_signs_are_truncated_toward_zero() {
        // -us * hz * 65536 / 1e6, by hand.
        for (us, hz, word) in [
            (-100.0, 1_000.0, 6_553),   // 6553.6
            (100.0, 1_000.0, 0xE667),   // -6553.6
            (-50.0, 1_000.0, 3_276),    // 3276.8
            (50.0, 1_000.0, 0xF334),    // -3276.8
            (-350.0, 1_000.0, 22_937),  // 22937.6
            (400.0, 1_000.0, 0x999A),   // -26214.4
            (-600.0, 1_000.0, 39_321),  // 39321.6
            (-100.0, 2_000.0, 13_107),  // 13107.2
            (100.0, 2_000.0, 0xCCCD),   // -13107.2
            (-0.01, 1_000.0, 0),        // 0.65
            (0.01, 1_000.0, 0),         // -0.65
            (1_100.0, 1_000.0, 0xE667), // -72089.6, a period and the same
        ] {
            assert_eq!(timer_of(us, hz), word, "{us} us at {hz} Hz");
        }
    }

    #[test]
    fn phase_errors_are_signed_fractions_of_the_period() {
        assert!((phase_error_us(0x4000_0000, 1_000.0) - 250.0).abs() < 1e-9);
        assert!((phase_error_us(0xFFFF_FFFF, 1_000.0) + 1e3 / 4_294_967_296.0).abs() < 1e-9);
    }

    #[test]
    fn settings_beyond_the_hardware_are_refused() {
        for dds_bits in [0, 64] {
            assert!(words(dds_bits, &CONFIG).is_err(), "{dds_bits}");
        }
        for hz in [1.0, 0.0, -1.0, f64::NAN, f64::INFINITY] {
            let words = words(42, &DpllConfig { hz, ..CONFIG });
            assert!(words.is_err(), "{hz}");
        }
    }

    #[test]
    fn phase_of_the_write_is_such_that_the_read_is_at_0() {
        let mut start = PhaseStart::default();
        // Any phase, before it was set for the first time.
        start.read(0x1234_5678);
        assert_eq!(start.write(), Some(0), "as LinuxCNC does");
        // A tenth of a period after the read, with some variation.
        let tenth = u32::MAX / 10;
        for n in 1..PERIODS {
            let delay = tenth + n % 2 * 2_000;
            let written = start.phase as u32;
            start.read(written.wrapping_sub(delay));
            let next = start.write().expect("100 periods");
            assert!(next.abs_diff(tenth) <= 2_000, "{n}: {next}");
        }
        let mean = tenth + 1_000;
        assert!((start.phase as u32).abs_diff(mean) < 50, "the mean");
        assert_eq!(start.write(), None);
    }

    proptest! {
        #[test]
        fn rate_is_met_to_a_millionth(rate in 100.0f64..20_000.0) {
            if let Ok(words) = words(42, &DpllConfig { hz: rate, ..CONFIG }) {
                prop_assert!((hz(words) / rate - 1.0).abs() < 1e-6);
            } else {
                prop_assert!(rate < 200.0);
            }
        }
    }
}
