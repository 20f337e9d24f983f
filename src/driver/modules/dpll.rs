//! The phase-locked loop in the cycle: it times the board by the reads, or the reads by the board.

use core::convert::Infallible;
use core::time::Duration;

use super::phase_start::PhaseStart;
use super::{Making, PartBuildError, PartError};
use crate::boards::fpga::DpllPins;
use crate::bus::{ImagePlan, ReadPhase, ReadSlot, RegisterBus, Tier, WritePhase, WriteSlot};
use crate::driver::{Module, Pace, Put, SettingSlot, SetupList, Take};
use crate::hal::{PinStore, Rejection};
use crate::hostmot2::{Dpll, DpllConfig, DpllError, DpllSetup, Gtag, phase_error_us};

/// The phase-locked loop.
#[derive(Debug)]
pub(in crate::driver) struct DpllModule {
    registers: Dpll,
    pins: DpllPins,
    dds_bits: u8,
    config: DpllConfig,
    setup: DpllSetup,
    pace: Pace,
    sync: Option<ReadSlot>,
    phase: Option<WriteSlot>,
    start: PhaseStart,
    settings: [Option<SettingSlot>; 5],
}

impl DpllModule {
    /// The loop of a firmware, if it has one, for cycles of `period`.
    pub fn build<B: RegisterBus>(
        parts: &mut Making<'_>,
        bus: &mut B,
        period: Duration,
        pace: Pace,
    ) -> Result<Option<Self>, PartBuildError<B::Error>> {
        if parts.firmware.find(Gtag::HM2DPLL).is_none() {
            return Ok(None);
        }
        let registers = Dpll::locate(parts.firmware).map_err(PartError::from)?;
        let control = bus.read(registers.control_1).map_err(PartBuildError::Bus)?;
        let dds_bits = control as u8;
        let pins = DpllPins::new(parts.pins, parts.group, parts.board).map_err(PartError::from)?;
        parts
            .pins
            .set(pins.base_freq_khz, 1e-3 / period.as_secs_f64());
        let config = config(&pins, parts.pins);
        let setup = DpllSetup::new(registers.clock_hz(), dds_bits, &config)?;
        parts.made.dpll = Some(pins);
        Ok(Some(Self {
            registers,
            pins,
            dds_bits,
            config,
            setup,
            pace,
            sync: None,
            phase: None,
            start: PhaseStart::default(),
            settings: [None; 5],
        }))
    }

    /// Registers and words of the set-up, in the order they are written.
    fn words(&self) -> [(u16, u32); 5] {
        let (at, to) = (&self.registers, &self.setup);
        [
            (at.base_rate, to.base_rate),
            (at.control_0, to.control_0),
            (at.control_1, to.control_1),
            (at.timers_12, to.timers_12),
            (at.timers_34, to.timers_34),
        ]
    }
}

impl DpllModule {
    /// Sets the phase, as long as it is not followed. Writing control 0 again makes the loop forget
    /// what it took for an error meanwhile.
    fn put_phase(&mut self, cycle: &mut Put<'_>) {
        let Some(slot) = self.phase else {
            return;
        };
        if let Some(phase) = self.start.write() {
            cycle.image.put(slot, phase);
            cycle.image.request_write(slot);
            let [_, control_0, ..] = self.settings;
            cycle.repeat(control_0);
        }
    }
}

fn config(of: &DpllPins, pins: &mut PinStore) -> DpllConfig {
    DpllConfig {
        hz: pins.fetch(of.base_freq_khz) * 1e3,
        phase_limit: pins.fetch(of.plimit),
        time_constant: u16::try_from(pins.fetch(of.time_const)).unwrap_or(u16::MAX),
        timers_us: of.timer_us.map(|timer| pins.fetch(timer)),
    }
}

impl Module for DpllModule {
    fn set_up(&self, list: &mut SetupList) {
        for (address, word) in self.words() {
            list.push(address, word);
        }
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        let words = self.words();
        for (slot, (address, word)) in self.settings.iter_mut().zip(words) {
            *slot = Some(SettingSlot::claim(plan, address, word));
        }
        // Without this read, the loop runs free.
        if self.pace == Pace::Host {
            let (sync, phase) = (self.registers.sync, self.registers.phase);
            // It is what the loop follows, so it comes first.
            self.sync = Some(plan.read(ReadPhase::Latch, Tier::Cycle, sync, 1));
            self.phase = Some(plan.write(WritePhase::Data, Tier::Extended, phase, 1, 0));
        }
    }

    /// The loop runs at another phase.
    fn restarted(&mut self) {
        self.start = PhaseStart::default();
    }

    fn take(&mut self, cycle: &mut Take<'_>) {
        if let Some(word) = self.sync.and_then(|slot| cycle.image.word(slot)) {
            let error = phase_error_us(word, self.config.hz);
            cycle.pins.publish(self.pins.phase_error_us, error);
            self.start.read(word);
        }
        let prescale = u32::from(self.setup.prescale);
        cycle.pins.publish(self.pins.prescale, prescale);
        cycle.pins.publish(self.pins.ddsize, self.dds_bits.into());
    }

    /// A frequency that the loop can not have is counted, and the one before stays.
    fn put(&mut self, cycle: &mut Put<'_>) {
        self.put_phase(cycle);
        let config = config(&self.pins, cycle.pins);
        if config == self.config {
            return;
        }
        let clock_hz = self.registers.clock_hz();
        let setup: Result<_, DpllError<Infallible>> =
            DpllSetup::new(clock_hz, self.dds_bits, &config);
        if let Ok(setup) = setup {
            if setup.base_rate != self.setup.base_rate || setup.prescale != self.setup.prescale {
                self.start = PhaseStart::default();
            }
            (self.config, self.setup) = (config, setup);
        } else {
            let frequency = self.pins.base_freq_khz;
            cycle.pins.count_rejection(frequency, Rejection::OutOfRange);
        }
        let slots = self.settings;
        for (slot, (_, word)) in slots.into_iter().zip(self.words()) {
            cycle.change(slot, word);
        }
    }
}
