//! Step generators: positions or speeds as pulses for step drives.
//!
//! In each cycle the accumulators are read and the rates are written, all generators in the packet
//! that goes anyway. Everything else is written when it changes.
//!
//! What may never happen, and why it does not:
//! - **A pulse that does not end, or a pulse with wrong times.** Times, type and table are written
//!   at rest only, with a rate of 0, and no other rate goes out before a read has confirmed them. A
//!   table is not used before it cannot be written again. In the set-up they come before the master
//!   rate. The length of a pulse is never 0.
//! - **A change of the direction inside a pulse.** The hold time in the register includes the
//!   pulse.
//! - **Motion after a bite of the watchdog.** A bite does not stop the generator (FACTS 14.15). The
//!   rate becomes 0 with the first write after it and in the set-up, both before any direction. The
//!   position is the one at which the pins were released, as well as that is known, and is unsure.
//! - **A step that the driver does not know.** The position is that of the accumulator, which makes
//!   exactly one step for each crossing of a whole number. It is never written. One that does not
//!   move at its rate is not believed: the generator stops, and its position is unsure.
//!
//! Source: FACTS 14.

mod control;
mod counts;
mod firmware;
mod generator;
mod latch;
mod pins;
mod pulses;
mod rate;
mod registers;
mod reports;
mod timing;

use alloc::format;
use alloc::vec::Vec;
use core::time::Duration;

pub use pins::StepgenPins;

use firmware::Firmware;
use generator::{Generator, LastRead, WriteTiming};

use super::limit::Limit;
use super::registrar::DrivenModule;
use super::unsure::UnsureMask;
use super::{
    Module, Outage, ReadCycle, RegisterError, Registrar, RunOnCycle, WriteCycle, bank_stem,
};
use crate::bus::{Instant, Setting, Stage};
use crate::events::{CorrectedValue, Positions};
use crate::hal::{Output, PinStore};
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor, PinDescriptor};
use crate::settings::Defaults;

/// The accumulators advance in every tick.
const EVERY_TICK: u32 = u32::MAX;
/// Versions with `swap_step_dir`, and with index and probe.
const WITH_SWAP: u8 = 0x42;
const WITH_LATCH: u8 = 0xC2;
/// The unit of pins that all generators share.
const ALL_UNITS: u8 = 0x80;
/// Secondary pins: the first output, and the first of those that only tables have.
const FIRST_OUTPUT: u8 = 0x81;
const FIRST_OF_TABLE: u8 = 0x83;

/// All step generators of a module.
#[derive(Debug)]
pub struct Stepgens {
    generators: Vec<Generator>,
    /// The number of the first of them.
    first: u8,
    /// Source that latches all accumulators; only with a DPLL.
    timer: Option<LatchTimer>,
    /// The last good read.
    last: LastRead,
    period: Duration,
    /// Periods in a second.
    per_second: f64,
    /// The part of the period from the sample of the positions to the write.
    delay: f64,
}

/// The source that latches all accumulators.
#[derive(Clone, Copy, Debug)]
struct LatchTimer {
    number: Output<i32>,
    /// Its last value that is not allowed.
    reported: Option<i64>,
    setting: Setting,
    /// Times of the DPLL's timers, in microseconds from the read.
    timers_us: [Option<Output<f64>>; 4],
}

impl Stepgens {
    /// The pins of each generator.
    pub fn pins(&self) -> impl ExactSizeIterator<Item = StepgenPins> + '_ {
        self.generators.iter().map(Generator::pins)
    }

    /// Source that latches the positions of all generators: 0 the DPLL's reference, 1 to 4 its
    /// timers, -1 none. Only with a DPLL.
    pub fn timer_number(&self) -> Option<Output<i32>> {
        self.timer.map(|timer| timer.number)
    }

    /// Registers the generators of a firmware, as many as the settings ask for: versions 0, 1, 2,
    /// 42 and C2.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        let modules = r.driven(&[Gtag::STEPGEN]);
        if modules
            .iter()
            .any(|module| module.descriptor.version == WITH_LATCH)
        {
            r.use_io(Gtag::STEPGEN, ALL_UNITS)?;
        }
        for (bank, module) in modules.iter().enumerate() {
            let module = Self::new(r, module, bank)?;
            r.add(module);
        }
        Ok(())
    }

    fn new(
        r: &mut Registrar<'_>,
        of_kind: &DrivenModule,
        bank: usize,
    ) -> Result<Self, RegisterError> {
        let module = &of_kind.descriptor;
        let width = r.settings.stepgen_width;
        let firmware = Firmware {
            clock_hz: module.clock_hz,
            has_swap: matches!(module.version, WITH_SWAP | WITH_LATCH),
            has_latch: module.version == WITH_LATCH,
            has_table: r.firmware.pins.iter().any(|pin| is_of_table(*pin)),
        };
        let latched_by = timer_register(r, module)?;
        for instance in 0..module.instances {
            let number = of_kind.number(instance);
            r.use_io_if(Gtag::STEPGEN, number, |pin| is_used(pin, width))?;
            // Also of a generator that another program has left running.
            r.image
                .step(Stage::Quiesce, module.register(0, instance)?, 0);
        }
        let mut generators = Vec::new();
        for instance in 0..module.instances {
            let number = of_kind.number(instance);
            generators.push(Generator::new(r, module, instance, number, firmware)?);
            if !firmware.has_table && r.settings.defaults == Defaults::LinuxCnc {
                // LinuxCNC has them in any firmware. Without outputs no step type uses them.
                let mut make = r.maker(&format!("stepgen.{number:02}."));
                for four in 0..4 {
                    make.setting(format!("table-data-{four}"), 0_u32)?;
                }
            }
        }
        let timer = match latched_by {
            None => None,
            Some(address) => Some(LatchTimer::new(r, bank, address)?),
        };
        // After all times: until now nothing moves.
        r.image
            .step(Stage::Configure, module.register(9, 0)?, EVERY_TICK);
        Ok(Self {
            generators,
            first: of_kind.number(0),
            timer,
            last: LastRead::default(),
            period: r.settings.period,
            per_second: 1.0 / r.settings.period.as_secs_f64(),
            delay: 0.0,
        })
    }

    /// Measures the time from the sample of the positions to this write. Without a read, that of
    /// before stays.
    fn observe_delay(&mut self, now: Instant, pins: &PinStore) {
        let passed = now.since(self.last.at);
        if passed < self.period {
            let lead = self.timer.map_or(0.0, |timer| timer.lead(pins));
            let period = self.period.as_secs_f64();
            // What a timer samples after a read is read a period later.
            let lead = if lead < 0.0 { lead + period } else { lead };
            let lead = lead.max(0.0).min(period);
            self.delay = (passed.as_secs_f64() + lead) * self.per_second;
        }
    }
}

impl LatchTimer {
    fn new(r: &mut Registrar<'_>, bank: usize, address: u16) -> Result<Self, RegisterError> {
        let name =
            |timer: usize| format!("{}.dpll.{:02}.timer-us", r.name, timer.saturating_add(1));
        let timers_us = core::array::from_fn(|timer| r.pins.output(&name(timer)).ok());
        let mut make = r.maker(&bank_stem("stepgen", bank));
        let number = make.switch("timer-number", -1)?;
        let setting = r.image.setting(Stage::Configure, address, latch_timer(-1));
        Ok(Self {
            number,
            reported: None,
            setting,
            timers_us,
        })
    }

    /// Time by which the positions are sampled before the read, in seconds.
    fn lead(&self, pins: &PinStore) -> f64 {
        let timer = pins.commanded(self.number).checked_sub(1);
        let timer = timer.and_then(|timer| usize::try_from(timer).ok());
        let timer = timer.and_then(|timer| self.timers_us.get(timer).copied().flatten());
        timer.map_or(0.0, |us| -1e-6 * pins.commanded(us))
    }
}

/// True for the pins of a generator that are in use: inputs, and the first outputs.
fn is_used(pin: PinDescriptor, width: u8) -> bool {
    !pin.is_output() || pin.secondary_pin.saturating_sub(FIRST_OUTPUT) < width
}

fn is_of_table(pin: PinDescriptor) -> bool {
    let is_output = pin.secondary == Gtag::STEPGEN && pin.is_output();
    is_output && pin.secondary_pin >= FIRST_OF_TABLE
}

/// The register that selects the source of the latch; `None` without a DPLL that runs: without its
/// edges the positions would stay as they are.
fn timer_register(
    r: &Registrar<'_>,
    module: &ModuleDescriptor,
) -> Result<Option<u16>, RegisterError> {
    let master = module.register(9, 0)?;
    // The descriptor does not count this register (FACTS 14.1).
    let register = master.checked_add(module.register_stride);
    Ok(register.filter(|_| r.has_dpll()))
}

/// Word of the latch source: -1 none, 0 the DPLL's reference, 1 to 4 one of its timers; any other
/// number counts as 0, as in LinuxCNC.
const fn latch_timer(timer: i32) -> u32 {
    const LATCH: u32 = 1 << 15;
    match timer {
        -1 => 0,
        1..=4 => (timer as u32) << 12 | LATCH,
        _ => LATCH,
    }
}

/// Checks layout and version.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    module.check_layout(10, 0x1FF)?;
    match module.version {
        0..=2 | WITH_SWAP | WITH_LATCH => Ok(()),
        version => Err(HostMot2Error::Unknown {
            gtag: module.gtag,
            found: format!("version {version:02X}"),
            expected: format!("00, 01, 02, {WITH_SWAP:X} or {WITH_LATCH:X}"),
        }),
    }
}

/// True for the first versions, whose times have faults (FACTS 14.2).
pub(crate) const fn is_old(version: u8) -> bool {
    version < 2
}

impl Module for Stepgens {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let asked = self.last.asked.as_nanos();
        let gap_ns = cycle.now.as_nanos().saturating_sub(asked);
        self.last = LastRead {
            asked: cycle.asked,
            at: cycle.now,
        };
        let mut unsure = UnsureMask::default();
        for (number, generator) in (self.first..).zip(&mut self.generators) {
            if generator.read(cycle, gap_ns) {
                unsure.add(number);
            }
        }
        unsure.report(cycle, Positions::StepGenerators);
    }

    fn run_on(&mut self, cycle: &RunOnCycle<'_>) {
        for generator in &mut self.generators {
            generator.run_on(cycle, self.last);
        }
        self.last = LastRead {
            asked: cycle.asked,
            at: cycle.now,
        };
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if let (Some(timer), true) = (&mut self.timer, cycle.changed) {
            let limit = Limit::timer(CorrectedValue::StepgenTimer, 0);
            let number = limit.pin(cycle, timer.number, &mut timer.reported);
            cycle.words.set(timer.setting, latch_timer(number));
        }
        self.observe_delay(cycle.now, cycle.pins);
        let timing = WriteTiming {
            delay: self.delay,
            period: self.period,
        };
        for generator in &mut self.generators {
            generator.write(cycle, &timing);
        }
    }

    fn written(&mut self, _: Instant, arrived: bool) {
        for generator in &mut self.generators {
            generator.written(arrived);
        }
    }

    fn make_safe(&mut self, _: &mut PinStore) {
        self.generators.iter_mut().for_each(Generator::halt);
    }

    fn set_period(&mut self, period: Duration, _: &mut PinStore) -> Result<(), RegisterError> {
        self.period = period;
        self.per_second = 1.0 / period.as_secs_f64();
        self.generators
            .iter_mut()
            .for_each(Generator::period_changed);
        Ok(())
    }

    /// Pins that are released and driven again make edges: the next read is then a new origin.
    fn set_up_again(&mut self, _: &mut PinStore, _: Instant, outage: &Outage) {
        for generator in &mut self.generators {
            generator.set_up_again(!outage.has_kept_set_up());
        }
    }
}

#[cfg(all(test, feature = "std"))]
mod tests;
