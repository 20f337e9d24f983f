//! Isolated inputs with their filters and MPG counters in the cycle.

use crate::boards::fpga::{InMuxKind, InMuxPins};
use crate::bus::{ImagePlan, Instant, ReadSlot, RegisterBus};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hal::PinStore;
use crate::hostmot2::{Gtag, InMux, InMuxConfig, InMuxControl, MpgCounters, MpgModes, MpgWord};
use alloc::vec::Vec;
use core::time::Duration;

use super::{Making, PartBuildError, PartError, Wiring};

/// One instance of InMux or InM.
#[derive(Debug)]
pub(in crate::driver) struct InMuxModule {
    registers: InMux,
    pins: InMuxPins,
    last_input: u8,
    initial: InMuxConfig,
    /// What was put last.
    current: InMuxConfig,
    mpgs: MpgCounters,
    /// What the counts were when they were last at rest at 0.
    zeros: [i64; 4],
    counts: [i64; 4],
    /// Filtered and raw levels that were taken last.
    taken: Option<(u32, u32)>,
    settling: Option<Settling>,
    slots: Option<Slots>,
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

#[derive(Clone, Copy, Debug)]
struct Slots {
    filtered: ReadSlot,
    raw: ReadSlot,
    mpg: ReadSlot,
    control: SettingSlot,
    filter: SettingSlot,
    modes: SettingSlot,
}

impl InMuxModule {
    /// All instances of both kinds that a firmware has.
    pub fn build_all<B: RegisterBus>(
        parts: &mut Making<'_>,
        bus: &mut B,
    ) -> Result<Vec<Self>, PartBuildError<B::Error>> {
        let mut all = Vec::new();
        for (gtag, kind) in [
            (Gtag::IN_MUX, InMuxKind::InMux),
            (Gtag::IN_M, InMuxKind::InM),
        ] {
            let instances = parts
                .firmware
                .find(gtag)
                .map_or(0, |module| module.instances);
            for instance in 0..instances {
                let registers =
                    InMux::locate(parts.firmware, gtag, instance).map_err(PartError::from)?;
                let control = bus.read(registers.control).map_err(PartBuildError::Bus)?;
                let last_input = InMuxControl(control).last_input();
                let module = Self::build(parts, registers, last_input, (kind, gtag, instance))?;
                let made = match kind {
                    InMuxKind::InMux => &mut parts.made.in_mux,
                    InMuxKind::InM => &mut parts.made.in_m,
                };
                made.push(module.pins.clone());
                all.push(module);
            }
        }
        Ok(all)
    }

    fn build(
        parts: &mut Making<'_>,
        registers: InMux,
        last_input: u8,
        (kind, gtag, instance): (InMuxKind, Gtag, u8),
    ) -> Result<Self, PartError> {
        parts.plan.use_module(parts.firmware, gtag, instance)?;
        let known = Wiring::of(parts.firmware).inputs(parts.firmware, (gtag, instance));
        let count = usize::from(last_input) + 1;
        let number = usize::from(instance);
        let (group, board) = (parts.group, parts.board);
        let pins = InMuxPins::new(parts.pins, group, board, kind, number, (count, known))?;
        let current = config(&pins, parts.pins);
        Ok(Self {
            registers,
            last_input,
            initial: current,
            pins,
            mpgs: MpgCounters::default(),
            zeros: [0; 4],
            counts: [0; 4],
            taken: None,
            settling: Some(Settling::default()),
            current,
            slots: None,
        })
    }
}

fn config(of: &InMuxPins, pins: &mut PinStore) -> InMuxConfig {
    InMuxConfig {
        scan_hz: f64::from(pins.param(of.scan_rate)),
        short_filter: pins.param(of.fast_scans).min(63) as u8,
        long_filter: pins.param(of.slow_scans).min(1023) as u16,
        long_inputs: of.slow(pins),
        // The opto-isolators pull their lines low while current flows, which is to read as true.
        invert: true,
        mpg_4x: of.mpg_4x.map(|param| pins.param(param)),
    }
}

impl InMuxModule {
    fn words(&self, config: &InMuxConfig) -> [u32; 3] {
        let control = InMuxControl::new(self.registers.clock_hz(), self.last_input, config);
        let modes = MpgModes::new(config.mpg_4x);
        [control.0, config.long_inputs, modes.0]
    }
}

/// Scans until what is raw is of the present set-up: the one under way, one whole, and the one in
/// which it is taken over.
const RAW_SCANS: u32 = 3;

impl InMuxModule {
    /// What can not be told yet at `now`; `None` if all of it can.
    fn unsettled(&mut self, now: Instant) -> Option<Unsettled> {
        let settling = self.settling.as_mut()?;
        let since = now.since(*settling.since.get_or_insert(now));
        let config = &self.current;
        let control = InMuxControl::new(self.registers.clock_hz(), self.last_input, config);
        let seconds = 1.0 / control.scan_hz(self.registers.clock_hz());
        // A clock that is not known leaves nothing valid.
        let scan = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
        // A filter counts to its end, whatever it held, and shows that one scan later.
        let is_over = |scans: u16| since >= scan.saturating_mul(RAW_SCANS + 1 + u32::from(scans));
        let short = is_over(control.short_filter().into());
        let long = is_over(control.long_filter());
        let filtered = match (short, long) {
            (false, false) => u32::MAX,
            (true, false) => config.long_inputs,
            (false, true) => !config.long_inputs,
            (true, true) => return None,
        };
        Some(Unsettled {
            filtered,
            raw: if since < scan.saturating_mul(RAW_SCANS) {
                u32::MAX
            } else {
                0
            },
            mpgs: [0, 2, 4, 6].map(|a| filtered >> a & 0b11 != 0),
        })
    }

    /// Counts what the MPGs moved; those that are not settled stay where they are.
    fn count(&mut self, pins: &mut PinStore, mpg: MpgWord, unsettled: Option<Unsettled>) {
        let totals = self.mpgs.read(mpg);
        let held = unsettled.map_or([false; 4], |unsettled| unsettled.mpgs);
        for (n, (zero, total)) in self.zeros.iter_mut().zip(totals).enumerate() {
            let reset = self.pins.mpg_resets.get(n);
            let is_reset = reset.is_some_and(|&reset| pins.fetch(reset));
            let Some(count) = self.counts.get_mut(n) else {
                continue;
            };
            if is_reset {
                *count = 0;
            }
            if is_reset || held.get(n) == Some(&true) {
                *zero = total.wrapping_sub(*count);
            }
            *count = total.wrapping_sub(*zero);
        }
        self.pins.publish_counts(pins, self.counts);
    }
}

impl Module for InMuxModule {
    fn set_up(&self, list: &mut SetupList) {
        let [control, filter, modes] = self.words(&self.initial);
        list.push(self.registers.control, control);
        list.push(self.registers.filter, filter);
        list.push(self.registers.mpg, modes);
    }

    /// The counters may stand anywhere, and the counts go on from where they were.
    fn restarted(&mut self) {
        self.settling = Some(Settling::default());
        self.taken = None;
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        let [control, filter, modes] = self.words(&self.initial);
        let registers = &self.registers;
        self.slots = Some(Slots {
            filtered: plan.read_data(registers.filtered),
            raw: plan.read_data(registers.raw),
            mpg: plan.read_data(registers.mpg),
            control: SettingSlot::claim(plan, registers.control, control),
            filter: SettingSlot::claim(plan, registers.filter, filter),
            modes: SettingSlot::claim(plan, registers.mpg, modes),
        });
    }

    fn take(&mut self, cycle: &mut Take<'_>) {
        let Some(slots) = self.slots else {
            return;
        };
        let word = |slot: ReadSlot| cycle.image.word(slot);
        let (Some(filtered), Some(raw), Some(mpg)) =
            (word(slots.filtered), word(slots.raw), word(slots.mpg))
        else {
            return;
        };
        let unsettled = self.unsettled(cycle.now);
        self.count(cycle.pins, MpgWord(mpg), unsettled);
        if self.taken.replace((filtered, raw)) != Some((filtered, raw)) || unsettled.is_some() {
            self.pins.publish(cycle.pins, filtered, raw);
        }
        match unsettled {
            Some(Unsettled {
                filtered,
                raw,
                mpgs,
            }) => self.pins.withhold(cycle.pins, filtered, raw, mpgs),
            // What was withheld last is published once more.
            None if self.settling.take().is_some() => {
                self.pins.publish(cycle.pins, filtered, raw);
            }
            None => {}
        }
    }

    fn put(&mut self, cycle: &mut Put<'_>) {
        let config = config(&self.pins, cycle.pins);
        self.current = config;
        let [control, filter, modes] = self.words(&config);
        let slots = self.slots;
        cycle.change(slots.map(|slots| slots.control), control);
        cycle.change(slots.map(|slots| slots.filter), filter);
        cycle.change(slots.map(|slots| slots.modes), modes);
    }
}
