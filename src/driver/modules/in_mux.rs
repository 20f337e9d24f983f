//! Isolated inputs with their filters and MPG counters in the cycle.

use crate::boards::fpga::{InMuxKind, InMuxPins};
use crate::bus::{ImagePlan, ReadSlot, RegisterBus};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hal::Pins;
use crate::hostmot2::{Gtag, InMux, InMuxConfig, InMuxControl, MpgCounters, MpgModes, MpgWord};
use alloc::vec::Vec;

use super::{Making, PartBuildError, PartError, Wiring};

/// One instance of InMux or InM.
#[derive(Debug)]
pub(in crate::driver) struct InMuxModule {
    registers: InMux,
    pins: InMuxPins,
    last_input: u8,
    initial: InMuxConfig,
    mpgs: MpgCounters,
    /// What the counts were when they were last at rest at 0.
    zeros: [i64; 4],
    counts: [i64; 4],
    /// Filtered and raw levels that were taken last.
    taken: Option<(u32, u32)>,
    slots: Option<Slots>,
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
        Ok(Self {
            registers,
            last_input,
            initial: config(&pins, parts.pins),
            pins,
            mpgs: MpgCounters::default(),
            zeros: [0; 4],
            counts: [0; 4],
            taken: None,
            slots: None,
        })
    }
}

fn config(of: &InMuxPins, pins: &mut Pins) -> InMuxConfig {
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

impl Module for InMuxModule {
    fn set_up(&self, list: &mut SetupList) {
        let [control, filter, modes] = self.words(&self.initial);
        list.push(self.registers.control, control);
        list.push(self.registers.filter, filter);
        list.push(self.registers.mpg, modes);
    }

    /// The counters may stand anywhere, and the counts go on from where they were.
    fn restarted(&mut self) {
        self.mpgs = MpgCounters::default();
        self.zeros = self.counts.map(i64::wrapping_neg);
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
        if let (Some(filtered), Some(raw), Some(mpg)) =
            (word(slots.filtered), word(slots.raw), word(slots.mpg))
        {
            let totals = self.mpgs.read(MpgWord(mpg));
            for (n, (zero, total)) in self.zeros.iter_mut().zip(totals).enumerate() {
                let reset = self.pins.mpg_resets.get(n);
                if reset.is_some_and(|&reset| cycle.pins.fetch(reset)) {
                    *zero = total;
                }
                if let Some(count) = self.counts.get_mut(n) {
                    *count = total.wrapping_sub(*zero);
                }
            }
            self.pins.publish_counts(cycle.pins, self.counts);
            if self.taken.replace((filtered, raw)) != Some((filtered, raw)) {
                self.pins.publish(cycle.pins, filtered, raw);
            }
        }
    }

    fn put(&mut self, cycle: &mut Put<'_>) {
        let config = config(&self.pins, cycle.pins);
        let [control, filter, modes] = self.words(&config);
        let slots = self.slots;
        cycle.change(slots.map(|slots| slots.control), control);
        cycle.change(slots.map(|slots| slots.filter), filter);
        cycle.change(slots.map(|slots| slots.modes), modes);
    }
}
