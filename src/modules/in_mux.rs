//! Filtered inputs with MPG counters: InMux (multiplexed) and InM (one pin each).
//!
//! Source: FACTS 13.6.

use alloc::format;
use alloc::vec::Vec;
use core::time::Duration;

use super::limit::Limit;
use super::registrar::DrivenModule;
use super::{ListenCycle, Module, ReadCycle, RegisterError, Registrar, WriteCycle, bits_of};
use crate::bus::{Instant, Phase, ReadSlot, Setting, Stage};
use crate::events::CorrectedValue;
use crate::hal::{DigitalIn, Input, Output, Param, PinError, PinStore};
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor, ModuleInstance};

/// The pins of one input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct InMuxInput {
    /// The filtered level.
    pub filtered: DigitalIn,
    /// The level without filter.
    pub raw: DigitalIn,
    /// Uses the long filter instead of the short one.
    pub slow: Output<bool>,
}

/// The pins of one instance: `hm2_7i97.0.inmux.00.input-00` and so on.
///
/// After a set-up of the board, at start and again after a bite or a reset, inputs are invalid
/// until they have been scanned (raw), or scanned as often as their filter takes (filtered, and the
/// MPG counts on them): 0.5 ms with the short filter, 26 ms with the long one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct InMuxPins {
    /// Scan rate of all inputs, in Hz.
    pub scan_rate: Param<u32>,
    /// The long filter, in scans: 1 to 1023.
    pub slow_scans: Param<u32>,
    /// The short filter, in scans: 1 to 63.
    pub fast_scans: Param<u32>,
    /// The MPG counts all four edges of a cycle, instead of one.
    pub mpg_4x: [Param<bool>; 4],
    /// Number of inputs.
    pub scan_width: Param<u32>,
    /// The inputs.
    pub inputs: Vec<InMuxInput>,
    /// The counts of the MPGs; MPG k is on inputs 2k and 2k+1.
    pub mpg_counts: [Input<i32>; 4],
    /// Keeps the counts at 0.
    pub mpg_resets: [Output<bool>; 4],
}

/// One instance of InMux or InM, which have the same layout.
#[derive(Debug)]
pub struct InMux {
    /// InMux or InM.
    pub gtag: Gtag,
    /// The handles of the pins.
    pub pins: InMuxPins,
    /// The number of the instance.
    instance: u8,
    clock_hz: u32,
    /// The last words that were written:
    /// - control;
    /// - the inputs with the long filter: bit n is input n;
    /// - bit 0 of each byte: counter k counts every edge (4X), else one per cycle (1X).
    words: [u32; 3],
    mpgs: [Mpg; 4],
    /// The last published levels.
    shown: Option<Levels>,
    /// The module was set up, and its scans and filters still contain levels from before.
    is_settling: bool,
    /// The time of the first read after that set-up.
    since: Option<Instant>,
    settings: [Setting; 3],
    filtered: ReadSlot,
    raw: ReadSlot,
    /// Four counters of 8 bits. Counter k is on inputs 2k (A) and 2k+1 (B).
    mpg: ReadSlot,
}

/// The levels of all inputs, or the set of inputs without a valid level: bit n is input n.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Levels {
    filtered: u32,
    raw: u32,
}

/// Checks the layout, in any version. A single instance needs no multiple registers.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    const OF_EACH: u32 = 0x1F;
    let found = module.multiple_registers & OF_EACH;
    module.check_layout(5, if module.instances > 1 { OF_EACH } else { found })
}

/// Scans until the raw levels belong to the present set-up: the one in progress, a whole one, and
/// the one in which its levels are taken over.
const RAW_SCANS: u32 = 3;

impl InMux {
    /// All instances of both kinds.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        for module in r.each_driven(&[Gtag::IN_MUX, Gtag::IN_M], Self::new)? {
            r.add(module);
        }
        Ok(())
    }

    fn new(
        r: &mut Registrar<'_>,
        module: &DrivenModule,
        instance: u8,
    ) -> Result<Self, RegisterError> {
        let DrivenModule { descriptor, .. } = module;
        let (gtag, clock_hz) = (descriptor.gtag, descriptor.clock_hz);
        let of = module.instance(instance);
        r.use_io(gtag, of.instance)?;
        let register = |register| descriptor.register(register, instance);
        let [control, mpg] = [register(0)?, register(4)?];
        let inputs = ((r.peek(control)? & LAST_INPUT) as u16).saturating_add(1);
        let pins = InMuxPins::new(r, of, inputs)?;
        let words = pins.words(r.pins, clock_hz);
        let [control_word, slow, modes] = words;
        let settings = [(control, control_word), (register(1)?, slow), (mpg, modes)];
        let settings =
            settings.map(|(address, word)| r.image.setting(Stage::Configure, address, word));
        Ok(Self {
            gtag,
            pins,
            instance: of.instance,
            clock_hz,
            words,
            mpgs: [Mpg::default(); 4],
            shown: None,
            is_settling: true,
            since: None,
            settings,
            filtered: r.image.read(Phase::Data, register(2)?),
            raw: r.image.read(Phase::Data, register(3)?),
            mpg: r.image.read(Phase::Data, mpg),
        })
    }

    /// Returns the inputs that are not valid yet at `now`.
    fn unsettled(&mut self, now: Instant) -> Levels {
        if !self.is_settling {
            return Levels::default();
        }
        let [control, slow, _] = self.words;
        let since = now.since(*self.since.get_or_insert(now));
        // With an unknown clock (0 Hz) no input becomes valid.
        let scan = Duration::try_from_secs_f64(1.0 / scan_hz(control, self.clock_hz));
        let scan = scan.unwrap_or(Duration::MAX);
        let is_over = |scans: u32| since >= scan.saturating_mul(scans.saturating_add(RAW_SCANS));
        let held = |is_over: bool, inputs: u32| if is_over { 0 } else { inputs };
        // A filter counts to its end from any content, and shows the result one scan later.
        let short = is_over((control >> SHORT & LARGEST_SHORT).saturating_add(1));
        let long = is_over((control >> LONG).saturating_add(1));
        self.is_settling = !(short && long);
        Levels {
            filtered: held(short, !slow) | held(long, slow),
            raw: held(is_over(0), u32::MAX),
        }
    }

    /// Counts the movements of the MPGs; the counts on inputs that are `held` stay unchanged.
    fn count(&mut self, pins: &mut PinStore, word: u32, held: u32) {
        let of_pins = self.pins.mpg_counts.iter().zip(self.pins.mpg_resets);
        let of_board = word.to_le_bytes().into_iter().zip([0, 2, 4, 6]);
        for ((mpg, (&count, reset)), (now, input_a)) in
            self.mpgs.iter_mut().zip(of_pins).zip(of_board)
        {
            let is_held = held >> input_a & 0b11 != 0;
            let counting = if pins.fetch(reset) {
                Counting::Reset
            } else if is_held {
                Counting::Held
            } else {
                Counting::Free
            };
            mpg.take(now, counting);
            pins.publish(count, mpg.count as i32);
            if is_held {
                pins.withhold(count);
            }
        }
    }
}

impl Module for InMux {
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        let (filtered, raw) = (cycle.words.word(self.filtered), cycle.words.word(self.raw));
        for (n, input) in self.pins.inputs.iter().enumerate() {
            for (pair, word) in [(input.filtered, filtered), (input.raw, raw)] {
                let level = word >> (n & 31) & 1 != 0;
                cycle.show(pair.pin, level);
                cycle.show(pair.not, !level);
            }
        }
    }

    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let was_settling = self.is_settling;
        let held = self.unsettled(cycle.now);
        self.count(cycle.pins, cycle.words.word(self.mpg), held.filtered);
        let levels = Levels {
            filtered: cycle.words.word(self.filtered),
            raw: cycle.words.word(self.raw),
        };
        // The levels withheld by the last read are published once more.
        if self.shown.replace(levels) != Some(levels) || was_settling {
            self.pins.publish(cycle.pins, levels, held);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        self.correct(cycle);
        self.words = self.pins.words(cycle.pins, self.clock_hz);
        for (setting, word) in self.settings.into_iter().zip(self.words) {
            cycle.words.set(setting, word);
        }
    }

    /// Waits for the scans and filters again; the counters may contain any value, and the counts
    /// continue from their last one.
    fn restored(&mut self, _: &mut PinStore, _: Instant) {
        (self.is_settling, self.since) = (true, None);
    }
}

impl InMux {
    /// Corrects rates and filters that the control register cannot have.
    fn correct(&self, cycle: &mut WriteCycle<'_>) {
        let inputs = u32::try_from(self.pins.inputs.len()).unwrap_or(1).max(1);
        let fastest = (self.clock_hz / 4).checked_div(inputs).unwrap_or(0);
        let slowest = fastest.div_ceil(LARGEST_DIVISOR.saturating_add(1));
        let params = [
            self.pins.scan_rate,
            self.pins.fast_scans,
            self.pins.slow_scans,
        ];
        let allowed = [(slowest, fastest), (1, LARGEST_SHORT), (1, LARGEST_LONG)];
        let names = if self.gtag == Gtag::IN_M {
            [
                CorrectedValue::InMScanRate,
                CorrectedValue::InMFastScans,
                CorrectedValue::InMSlowScans,
            ]
        } else {
            [
                CorrectedValue::InMuxScanRate,
                CorrectedValue::InMuxFastScans,
                CorrectedValue::InMuxSlowScans,
            ]
        };
        for ((param, (lowest, highest)), setting) in params.into_iter().zip(allowed).zip(names) {
            let limit = Limit {
                setting,
                number: self.instance.into(),
                lowest: lowest.into(),
                highest: highest.into(),
                instead: None,
            };
            limit.param(cycle, param);
        }
    }
}

impl InMuxPins {
    /// Makes the pins for `count` inputs.
    fn new(r: &mut Registrar<'_>, of: ModuleInstance, count: u16) -> Result<Self, PinError> {
        let is_muxed = of.gtag != Gtag::IN_M;
        let name = if is_muxed { "inmux" } else { "inm" };
        let stem = format!("{name}.{:02}.", of.instance);
        let mut make = r.maker(&stem);
        let mut all = Self {
            scan_rate: make.setting("scan_rate", 20_000)?,
            slow_scans: make.setting("slow_scans", 500)?,
            fast_scans: make.setting("fast_scans", 5)?,
            scan_width: make.property("scan_width", count.into())?,
            ..Self::default()
        };
        for (k, param) in all.mpg_4x.iter_mut().enumerate() {
            *param = make.setting(format!("enc{k}_4xmode"), false)?;
        }
        for n in 0..count {
            let place = r.board.place(r.firmware, of, n);
            let mut make = r.maker_at(&stem, place);
            let mut pair = |name: &str| {
                Ok::<_, PinError>(DigitalIn {
                    pin: make.input(name)?,
                    not: make.opposite(format!("{name}-not"))?,
                })
            };
            all.inputs.push(InMuxInput {
                filtered: pair(&format!("input-{n:02}"))?,
                raw: pair(&format!("raw-input-{n:02}"))?,
                slow: make.switch(format!("input-{n:02}-slow"), false)?,
            });
        }
        let mpgs = all.mpg_counts.iter_mut().zip(&mut all.mpg_resets);
        for ((k, a), (count, reset)) in (0..).zip((0u16..).step_by(2)).zip(mpgs) {
            let at = |n| r.board.place(r.firmware, of, n);
            let place = [at(a), at(a | 1)].into_iter().collect();
            let mut make = r.maker_at(&stem, place);
            *count = make.input(format!("enc{k}-count"))?;
            *reset = make.switch(format!("enc{k}-reset"), false)?;
        }
        Ok(all)
    }

    /// The words of control, filter and modes.
    fn words(&self, pins: &mut PinStore, clock_hz: u32) -> [u32; 3] {
        let slow = (0..).zip(self.inputs.iter().map(|input| input.slow));
        let slow = bits_of(pins, slow);
        let scan = ScanSettings {
            clock_hz,
            inputs: self.inputs.len() as u32,
            scan_hz: pins.param(self.scan_rate),
            short: pins.param(self.fast_scans),
            long: pins.param(self.slow_scans),
        };
        let modes = self.mpg_4x.map(|param| pins.param(param).into());
        [scan.control(), slow, u32::from_le_bytes(modes)]
    }

    /// Publishes the levels, and withholds those that are `held`.
    fn publish(&self, pins: &mut PinStore, levels: Levels, held: Levels) {
        for (n, input) in self.inputs.iter().enumerate() {
            for (pair, word, held) in [
                (input.filtered, levels.filtered, held.filtered),
                (input.raw, levels.raw, held.raw),
            ] {
                let level = word >> (n & 31) & 1 != 0;
                pins.publish(pair.pin, level);
                pins.publish(pair.not, !level);
                if held >> (n & 31) & 1 != 0 {
                    pins.withhold(pair.pin);
                    pins.withhold(pair.not);
                }
            }
        }
    }
}

/// The count of an MPG, from a counter of 8 bits that must not move 128 counts or more between two
/// reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Mpg {
    last: Option<u8>,
    count: i64,
}

/// Effect of an MPG's movements on its count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Counting {
    /// They are counted.
    Free,
    /// The count stays, because the inputs are not valid.
    Held,
    /// The count is kept at 0.
    Reset,
}

impl Mpg {
    /// Takes the counter of a cycle.
    fn take(&mut self, now: u8, counting: Counting) {
        let last = self.last.replace(now).unwrap_or(now);
        match counting {
            Counting::Free => {
                let moved = now.wrapping_sub(last) as i8;
                self.count = self.count.wrapping_add(moved.into());
            }
            Counting::Held => {}
            Counting::Reset => self.count = 0,
        }
    }
}

/// Number of the last input in the control register; read only.
const LAST_INPUT: u32 = 0x1F;
/// Inverts all inputs: the opto-isolators pull their lines low while current flows, which should
/// read as true.
const INVERT: u32 = 1 << 5;
/// Position of the rate divisor.
const DIVISOR: u32 = 6;
const LARGEST_DIVISOR: u32 = 0x3FF;
/// Position of the short filter, the number of scans for which an input must be steady.
const SHORT: u32 = 16;
const LARGEST_SHORT: u32 = 0x3F;
/// Position of the long filter.
const LONG: u32 = 22;
const LARGEST_LONG: u32 = 0x3FF;

/// Settings of the scanner, as requested.
#[derive(Clone, Copy, Debug)]
struct ScanSettings {
    clock_hz: u32,
    /// Number of inputs.
    inputs: u32,
    /// Scans of all inputs per second.
    scan_hz: u32,
    /// The short filter, in scans.
    short: u32,
    /// The long filter, in scans.
    long: u32,
}

impl ScanSettings {
    /// The control register; a value that does not fit becomes the nearest that does.
    fn control(self) -> u32 {
        let channel_hz = f64::from(self.scan_hz) * f64::from(self.inputs);
        let divisor = libm::round(f64::from(self.clock_hz) / 4.0 / channel_hz) - 1.0;
        let divisor = divisor.clamp(0.0, f64::from(LARGEST_DIVISOR)) as u32;
        self.inputs.saturating_sub(1) & LAST_INPUT
            | INVERT
            | divisor << DIVISOR
            | self.short.min(LARGEST_SHORT) << SHORT
            | self.long.min(LARGEST_LONG) << LONG
    }
}

/// Whole scans per second.
fn scan_hz(control: u32, clock_hz: u32) -> f64 {
    let divisor = f64::from(control >> DIVISOR & LARGEST_DIVISOR);
    let last_input = f64::from(control & LAST_INPUT);
    f64::from(clock_hz) / 4.0 / (divisor + 1.0) / (last_input + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CLOCK: u32 = 100_000_000;

    #[test]
    fn default_scans_sixteen_inputs_at_20_khz() {
        let scan = ScanSettings {
            clock_hz: CLOCK,
            inputs: 16,
            scan_hz: 20_000,
            short: 5,
            long: 500,
        };
        let control = scan.control();
        // 25 MHz / 16 / 20 kHz = 78.1: divisor 77.
        assert_eq!(control, 15 | 1 << 5 | 77 << 6 | 5 << 16 | 500 << 22);
        assert!((scan_hz(control, CLOCK) - 20_032.05).abs() < 0.01);
    }

    #[test]
    fn rates_and_filters_that_do_not_fit_become_the_nearest() {
        let of_rate = |scan_hz| {
            let scan = ScanSettings {
                clock_hz: CLOCK,
                inputs: 1,
                scan_hz,
                short: 255,
                long: 60_000,
            };
            scan.control()
        };
        assert_eq!(of_rate(u32::MAX), 0xFFFF_0020);
        assert_eq!(of_rate(0), 0xFFFF_0020 | 1023 << 6);
    }

    proptest! {
        #[test]
        fn mpg_counts_follow_wide_counters(
            start: u8,
            steps in prop::collection::vec((-127i64..=127, any::<bool>(), 0u8..10), 1..300),
        ) {
            let mut wide = i64::from(start);
            let mut mpg = Mpg::default();
            mpg.take(start, Counting::Free);
            prop_assert_eq!(mpg.count, 0);
            let mut count = 0;
            for (step, is_held, reset) in steps {
                wide += step;
                let counting = match (reset, is_held) {
                    (0, _) => Counting::Reset,
                    (_, true) => Counting::Held,
                    _ => Counting::Free,
                };
                mpg.take(wide as u8, counting);
                count = match counting {
                    Counting::Reset => 0,
                    Counting::Held => count,
                    Counting::Free => count + step,
                };
                prop_assert_eq!(mpg.count, count);
            }
        }
    }
}
