//! Filtered inputs with MPG counters: InMux (multiplexed) and InM (a pin each).
//!
//! Source: FACTS 13.6.

use alloc::format;
use alloc::vec::Vec;
use core::time::Duration;

use super::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::bus::Instant;
use crate::bus::{ReadSlot, Setting, Stage};
use crate::hal::{DigitalIn, Input, Output, Param, PinError, PinStore};
use crate::hostmot2::{Gtag, ModuleDescriptor};

/// The pins of one input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InMuxInput {
    /// Filtered.
    pub filtered: DigitalIn,
    /// As it is.
    pub raw: DigitalIn,
    /// Filtered for long, and not for short.
    pub slow: Output<bool>,
}

/// The pins of one instance: `hm2_7i97.0.inmux.00.input-00` and so on.
///
/// After the board was set up, at start and again after a bite or a reset, inputs are not valid
/// before they have been scanned (raw), or scanned as often as their filter takes (filtered, and the
/// MPG counts on them): 0.5 ms with the short filter, 26 ms with the long one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct InMuxPins {
    /// How often all inputs are scanned, in Hz.
    pub scan_rate: Param<u32>,
    /// The long filter, in scans: 1 to 1023.
    pub slow_scans: Param<u32>,
    /// The short filter, in scans: 1 to 63.
    pub fast_scans: Param<u32>,
    /// An MPG counts all four edges, and not one.
    pub mpg_4x: [Param<bool>; 4],
    /// How many inputs there are.
    pub scan_width: Param<u32>,
    /// The inputs.
    pub inputs: Vec<InMuxInput>,
    /// The counts of the MPGs; MPG k is on inputs 2k and 2k+1.
    pub mpg_counts: [Input<i32>; 4],
    /// Keep the counts at 0.
    pub mpg_resets: [Output<bool>; 4],
}

/// One instance of InMux or InM. The layouts are the same.
#[derive(Debug)]
pub struct InMux {
    /// InMux or InM.
    pub gtag: Gtag,
    /// The handles of its pins.
    pub pins: InMuxPins,
    clock_hz: u32,
    last_input: u8,
    config: Config,
    mpgs: [Mpg; 4],
    /// Filtered and raw levels that were published last.
    shown: Option<(u32, u32)>,
    settling: Option<Settling>,
    control: Setting,
    /// The inputs with the long filter: bit n is input n.
    filter: Setting,
    modes: Setting,
    filtered: ReadSlot,
    raw: ReadSlot,
    /// Four counters of 8 bits. Counter k is on inputs 2k (A) and 2k+1 (B).
    mpg: ReadSlot,
}

/// The module was set up, and its scans and filters hold what was before.
#[derive(Clone, Copy, Debug, Default)]
struct Settling {
    /// The first read since.
    since: Option<Instant>,
}

/// What can not be told yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Unsettled {
    filtered: u32,
    raw: u32,
    mpgs: [bool; 4],
}

/// Scans until what is raw is of the present set-up: the one in progress, one whole, and the one in
/// which it is taken over.
const RAW_SCANS: u32 = 3;

impl InMux {
    /// All instances of both kinds.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<Vec<Self>, RegisterError> {
        r.each_instance(&[Gtag::IN_MUX, Gtag::IN_M], Self::new)
    }

    fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        instance: u8,
    ) -> Result<Self, RegisterError> {
        let (gtag, clock_hz) = (module.gtag, module.clock_hz);
        r.use_io(gtag, instance)?;
        let register = |register| module.register(register, instance);
        let (control, filter, mpg) = (register(0)?, register(1)?, register(4)?);
        let last_input = Control(r.peek(control)?).last_input();
        let pins = InMuxPins::new(r, (gtag, instance), u16::from(last_input) + 1)?;
        let config = pins.config(r.pins);
        let [control_word, slow, modes] = config.words(clock_hz, last_input);
        Ok(Self {
            gtag,
            pins,
            clock_hz,
            last_input,
            config,
            mpgs: [Mpg::default(); 4],
            shown: None,
            settling: Some(Settling::default()),
            control: r.setting(Stage::Configure, control, control_word),
            filter: r.setting(Stage::Configure, filter, slow),
            modes: r.setting(Stage::Configure, mpg, modes),
            filtered: r.input(register(2)?),
            raw: r.input(register(3)?),
            mpg: r.input(mpg),
        })
    }

    /// What can not be told yet at `now`; `None` if all of it can.
    fn unsettled(&mut self, now: Instant) -> Option<Unsettled> {
        let settling = self.settling.as_mut()?;
        let since = now.since(*settling.since.get_or_insert(now));
        let control = Control::new(self.clock_hz, self.last_input, &self.config);
        let seconds = 1.0 / control.scan_hz(self.clock_hz);
        // A clock that is not known leaves nothing valid.
        let scan = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
        // A filter counts to its end, whatever it held, and shows that one scan later.
        let is_over = |scans: u16| since >= scan.saturating_mul(RAW_SCANS + 1 + u32::from(scans));
        let short = is_over(self.config.short_filter.into());
        let long = is_over(self.config.long_filter);
        let filtered = match (short, long) {
            (false, false) => u32::MAX,
            (true, false) => self.config.slow,
            (false, true) => !self.config.slow,
            (true, true) => return None,
        };
        let is_raw = since >= scan.saturating_mul(RAW_SCANS);
        Some(Unsettled {
            filtered,
            raw: if is_raw { 0 } else { u32::MAX },
            mpgs: [0, 2, 4, 6].map(|a| filtered >> a & 0b11 != 0),
        })
    }

    /// Counts what the MPGs moved; those that are not settled stay where they are.
    fn count(&mut self, pins: &mut PinStore, word: u32, unsettled: Option<Unsettled>) {
        let held = unsettled.map_or([false; 4], |unsettled| unsettled.mpgs);
        let of_pins = self.pins.mpg_counts.iter().zip(self.pins.mpg_resets);
        let of_board = word.to_le_bytes().into_iter().zip(held);
        for ((mpg, (&count, reset)), (now, is_held)) in
            self.mpgs.iter_mut().zip(of_pins).zip(of_board)
        {
            mpg.take(now, is_held, pins.fetch(reset));
            pins.publish(count, mpg.count as i32);
        }
    }
}

impl Module for InMux {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let unsettled = self.unsettled(cycle.now);
        let levels = (cycle.word(self.filtered), cycle.word(self.raw));
        let mpg = cycle.word(self.mpg);
        self.count(cycle.pins, mpg, unsettled);
        // What was withheld last is published once more.
        let is_over = unsettled.is_none() && self.settling.take().is_some();
        if self.shown.replace(levels) != Some(levels) || unsettled.is_some() || is_over {
            self.pins.publish(cycle.pins, levels);
        }
        if let Some(unsettled) = unsettled {
            self.pins.withhold(cycle.pins, unsettled);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        let config = self.pins.config(cycle.pins);
        self.config = config;
        let [control, slow, modes] = config.words(self.clock_hz, self.last_input);
        cycle.set(self.control, control);
        cycle.set(self.filter, slow);
        cycle.set(self.modes, modes);
    }

    /// The counters may stand anywhere, and the counts go on from where they were.
    fn restored(&mut self, _: &mut PinStore, _: Instant) {
        self.settling = Some(Settling::default());
        self.shown = None;
    }
}

impl InMuxPins {
    /// `count` inputs.
    fn new(
        r: &mut Registrar<'_>,
        (gtag, instance): (Gtag, u8),
        count: u16,
    ) -> Result<Self, PinError> {
        let name = if gtag == Gtag::IN_M { "inm" } else { "inmux" };
        let stem = format!("{name}.{instance:02}.");
        let mut make = r.maker(&stem);
        let mut all = Self {
            scan_rate: make.setting("scan_rate", 20_000)?,
            slow_scans: make.setting("slow_scans", 500)?,
            fast_scans: make.setting("fast_scans", 5)?,
            scan_width: make.property("scan_width", count.into())?,
            ..Self::default()
        };
        for (k, param) in all.mpg_4x.iter_mut().enumerate() {
            *param = make.setting(&format!("enc{k}_4xmode"), false)?;
        }
        for n in 0..count {
            let place = r.board.place(r.firmware, (gtag, instance), n);
            let mut make = r.maker(&stem).at(place.terminal, place.signal);
            let mut pair = |name: &str| {
                Ok::<_, PinError>(DigitalIn {
                    pin: make.input(name)?,
                    not: make.input(&format!("{name}-not"))?,
                })
            };
            all.inputs.push(InMuxInput {
                filtered: pair(&format!("input-{n:02}"))?,
                raw: pair(&format!("raw-input-{n:02}"))?,
                slow: make.switch(&format!("input-{n:02}-slow"), false)?,
            });
        }
        let mpgs = all.mpg_counts.iter_mut().zip(&mut all.mpg_resets);
        for (k, (count, reset)) in (0u16..).zip(mpgs) {
            let at = |n| r.board.place(r.firmware, (gtag, instance), n);
            let place = at(2 * k).and(at(2 * k + 1));
            let mut make = r.maker(&stem).at(place.terminal, place.signal);
            *count = make.input(&format!("enc{k}-count"))?;
            *reset = make.switch(&format!("enc{k}-reset"), false)?;
        }
        Ok(all)
    }

    fn config(&self, pins: &mut PinStore) -> Config {
        let inputs = self.inputs.iter().enumerate();
        Config {
            scan_hz: pins.param(self.scan_rate),
            short_filter: pins.param(self.fast_scans).min(63) as u8,
            long_filter: pins.param(self.slow_scans).min(1023) as u16,
            slow: inputs.fold(0, |word, (n, input)| {
                word | u32::from(pins.fetch(input.slow)) << (n & 31)
            }),
            mpg_4x: self.mpg_4x.map(|param| pins.param(param)),
        }
    }

    fn publish(&self, pins: &mut PinStore, (filtered, raw): (u32, u32)) {
        for (n, input) in self.inputs.iter().enumerate() {
            for (pair, word) in [(input.filtered, filtered), (input.raw, raw)] {
                let level = word >> (n & 31) & 1 != 0;
                pins.publish(pair.pin, level);
                pins.publish(pair.not, !level);
            }
        }
    }

    fn withhold(&self, pins: &mut PinStore, unsettled: Unsettled) {
        let Unsettled {
            filtered,
            raw,
            mpgs,
        } = unsettled;
        for (n, input) in self.inputs.iter().enumerate() {
            for (pair, word) in [(input.filtered, filtered), (input.raw, raw)] {
                if word >> (n & 31) & 1 != 0 {
                    pins.withhold(pair.pin);
                    pins.withhold(pair.not);
                }
            }
        }
        for (&pin, is_withheld) in self.mpg_counts.iter().zip(mpgs) {
            if is_withheld {
                pins.withhold(pin);
            }
        }
    }
}

/// An MPG's count, from a counter of 8 bits that must not move 128 counts or more between two reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Mpg {
    last: Option<u8>,
    count: i64,
}

impl Mpg {
    /// Takes what a cycle read. While the counter is held, or its count is kept at 0, what it moves
    /// does not count.
    fn take(&mut self, now: u8, is_held: bool, is_reset: bool) {
        let last = self.last.replace(now).unwrap_or(now);
        if is_reset {
            self.count = 0;
        } else if !is_held {
            let moved = now.wrapping_sub(last) as i8;
            self.count = self.count.wrapping_add(moved.into());
        }
    }
}

/// How the inputs are scanned and filtered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Config {
    /// Whole scans per second.
    scan_hz: u32,
    /// Scans that an input must be steady for, short filter: 0 to 63.
    short_filter: u8,
    /// Scans that an input must be steady for, long filter: 0 to 1023.
    long_filter: u16,
    /// The inputs with the long filter: bit n is input n.
    slow: u32,
    /// The counters that count every edge (4X), else one per cycle (1X).
    mpg_4x: [bool; 4],
}

impl Config {
    /// Control, filter and MPG registers; the last has bit 0 of each byte: 0 = 1X, 1 = 4X.
    fn words(&self, clock_hz: u32, last_input: u8) -> [u32; 3] {
        let control = Control::new(clock_hz, last_input, self);
        let modes = u32::from_le_bytes(self.mpg_4x.map(u8::from));
        [control.0, self.slow, modes]
    }
}

/// The control register: 4..0 last input number (read only), 5 invert, 15..6 rate divisor,
/// 21..16 short filter, 31..22 long filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Control(u32);

impl Control {
    /// All inputs inverted: the opto-isolators pull their lines low while current flows, which is to
    /// read as true.
    const INVERT: u32 = 1 << 5;

    /// The word for a configuration; rates that do not fit become the nearest.
    fn new(clock_hz: u32, last_input: u8, config: &Config) -> Self {
        let channel_hz = f64::from(config.scan_hz) * (f64::from(last_input & 0x1F) + 1.0);
        let divisor = libm::round(f64::from(clock_hz) / 4.0 / channel_hz) - 1.0;
        Self(
            u32::from(last_input & 0x1F)
                | Self::INVERT
                | (divisor.clamp(0.0, 1023.0) as u32) << 6
                | u32::from(config.short_filter.min(63)) << 16
                | u32::from(config.long_filter.min(1023)) << 22,
        )
    }

    const fn last_input(self) -> u8 {
        (self.0 & 0x1F) as u8
    }

    /// Whole scans per second.
    fn scan_hz(self, clock_hz: u32) -> f64 {
        let divisor = f64::from(self.0 >> 6 & 0x3FF);
        f64::from(clock_hz) / 4.0 / (divisor + 1.0) / (f64::from(self.last_input()) + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CONFIG: Config = Config {
        scan_hz: 20_000,
        short_filter: 5,
        long_filter: 500,
        slow: 0,
        mpg_4x: [true, false, false, true],
    };

    #[test]
    fn the_default_scans_sixteen_inputs_at_20_khz() {
        let [control, _, modes] = CONFIG.words(100_000_000, 15);
        // 25 MHz / 16 / 20 kHz = 78.1: divisor 77.
        assert_eq!(control, 15 | 1 << 5 | 77 << 6 | 5 << 16 | 500 << 22);
        assert!((Control(control).scan_hz(100_000_000) - 20_032.05).abs() < 0.01);
        assert_eq!(modes, 0x0100_0001);
    }

    #[test]
    fn rates_and_filters_that_do_not_fit_become_the_nearest() {
        let config = Config {
            scan_hz: u32::MAX,
            short_filter: 255,
            long_filter: 60_000,
            ..CONFIG
        };
        assert_eq!(Control::new(100_000_000, 0, &config).0, 0xFFFF_0020);
        let slow = Config {
            scan_hz: 0,
            ..config
        };
        assert_eq!(
            Control::new(100_000_000, 0, &slow).0,
            0xFFFF_0020 | 1023 << 6
        );
    }

    proptest! {
        #[test]
        fn mpg_counts_follow_wide_counters(
            start: u8,
            steps in prop::collection::vec((-127i64..=127, any::<bool>(), 0u8..10), 1..300),
        ) {
            let mut wide = i64::from(start);
            let mut mpg = Mpg::default();
            mpg.take(start, false, false);
            prop_assert_eq!(mpg.count, 0);
            let mut count = 0;
            for (step, is_held, reset) in steps {
                wide += step;
                mpg.take(wide as u8, is_held, reset == 0);
                count = match (reset, is_held) {
                    (0, _) => 0,
                    (_, true) => count,
                    _ => count + step,
                };
                prop_assert_eq!(mpg.count, count);
            }
        }
    }
}
