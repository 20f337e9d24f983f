//! PWM generators, and the analog outputs of a 7I97 behind them.

mod divider;
mod generator;
#[cfg(test)]
mod stepped;

use mesa_wire::bus::Direction;

use super::io_ports::Source;
use super::{Configuration, Effect, Settles, SimIoPorts, SimModule};
use crate::fpga::{DriveSignal, Fabric, SimPinDescriptor, UNDRIVEN};
use crate::wire::Nanos;
use divider::Divider;
use generator::{DITHER, Generator, Reference, Style};

const VALUE: u8 = 0;
const MODE: u8 = 1;
const MASTER_RATE: u8 = 2;
const PDM_RATE: u8 = 3;
const ENABLES: u8 = 4;

const PIN_OUT: u8 = 0x81;
const PIN_DIRECTION: u8 = 0x82;
const PIN_ENABLE: u8 = 0x83;

/// Clocks from the write of a rate to its first addition.
const RATE_AFTER: u64 = 4;
const PDM_RATE_AFTER: u64 = 2;

/// Analog full scale of a 7I97 in volts.
const FULL_SCALE: f64 = 10.0;

/// The pins of one generator.
#[derive(Clone, Copy, Debug, Default)]
struct Pins {
    out: Option<usize>,
    direction: Option<usize>,
    /// The /enable pin, and the generator whose enable bit it follows.
    enable: Option<usize>,
    enabled_by: usize,
}

/// All PWM generators. FACTS 12.3, 13.5.
///
/// A generator of module version 1 can dither: at the end of each period the fraction of the value
/// is accumulated, and the carry is added to the duty of the next period.
///
/// All generators run from configuration on, enabled or not: the enables only drive pins of their
/// own, low while the bit is set. The level of a pin is computed on demand, exact to the clock.
#[derive(Clone, Debug)]
pub struct SimPwm {
    clock: u32,
    dithers: bool,
    reference: Reference,
    enables: u32,
    /// The clock of the last event, and the time of the next.
    seen: u64,
    next_event: Option<Nanos>,
    generators: Vec<Generator>,
    pins: Vec<Pins>,
}

impl SimModule for SimPwm {
    fn read(&mut self, _: &Fabric, register: u8, _: u8) -> u32 {
        match register {
            ENABLES => self.enables,
            _ => UNDRIVEN,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, instance: u8, value: u32) {
        self.put(fabric.now(), register, instance, value);
    }

    fn reload(&mut self, configuration: &Configuration<'_>) {
        *self = Self::new(configuration);
    }

    fn settles(&self, access: Direction) -> Settles {
        match access {
            Direction::Read => Settles::Nothing,
            Direction::Write => Settles::World,
        }
    }

    fn is_driving(&self) -> bool {
        true
    }

    fn level(&self, now: Nanos, pin: SimPinDescriptor) -> bool {
        let Some(generator) = self.generators.get(usize::from(pin.unit)) else {
            return false;
        };
        match pin.pin {
            PIN_ENABLE => !self.enabled(pin.unit.into()),
            pin => generator.level(self.clocks(now), pin == PIN_DIRECTION, &self.reference),
        }
    }

    fn drive_signal(&self, now: Nanos, output: u8, io: &SimIoPorts) -> DriveSignal {
        let unit = usize::from(output);
        DriveSignal {
            volts: self.volts(unit, io, now),
            enabled: self.drive_enabled(unit, io),
        }
    }

    /// A written value or mode takes effect a few clocks later, or at the end of the period.
    fn next_event(&self, _: Nanos) -> Option<Nanos> {
        self.next_event
    }

    fn event(&mut self, now: Nanos) -> Effect {
        let clock = self.clocks(now);
        self.seen = clock;
        for generator in &mut self.generators {
            generator.settle(clock, &self.reference);
        }
        self.look_ahead();
        Effect::Outputs
    }
}

impl SimPwm {
    /// Generators after the configuration of the FPGA.
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        let Configuration {
            firmware, module, ..
        } = *configuration;
        let count = module.instances.min(32);
        let pin = |unit, pin| firmware.pin(module.gtag, unit, pin);
        let pins = (0..count).map(|unit| {
            let own = pin(unit, PIN_ENABLE);
            Pins {
                out: pin(unit, PIN_OUT),
                direction: pin(unit, PIN_DIRECTION),
                enable: own.or_else(|| pin(0, PIN_ENABLE)),
                enabled_by: if own.is_some() { unit.into() } else { 0 },
            }
        });
        let clock = configuration.clock();
        let start = clocks(clock, configuration.now);
        Self {
            clock,
            dithers: module.version >= 1,
            reference: Reference {
                pwm: Divider::new(start),
                pdm: Divider::new(start),
            },
            enables: 0,
            seen: start,
            next_event: None,
            generators: vec![Generator::new(start); count.into()],
            pins: pins.collect(),
        }
    }

    /// Writes a register.
    fn put(&mut self, now: Nanos, register: u8, instance: u8, value: u32) {
        let clock = self.clocks(now);
        let reference = self.reference;
        for generator in &mut self.generators {
            generator.settle(clock, &reference);
        }
        let generator = self.generators.get_mut(usize::from(instance));
        let without = if self.dithers { 0 } else { DITHER };
        match (register, generator) {
            (VALUE, Some(generator)) => generator.write_value(clock, value, &reference),
            (MODE, Some(generator)) => {
                generator.write_mode(clock, value & 0x7F & !without, &reference);
            }
            (MASTER_RATE, _) => {
                let divider = &mut self.reference.pwm;
                divider.set_rate(clock, clock + RATE_AFTER, value & 0xFFFF);
            }
            (PDM_RATE, _) => {
                let divider = &mut self.reference.pdm;
                divider.set_rate(clock, clock + PDM_RATE_AFTER, value & 0xFFFF);
            }
            (ENABLES, _) => {
                let existing = (1u64 << self.generators.len()) - 1;
                self.enables = value & existing as u32;
            }
            _ => {}
        }
        self.look_ahead();
    }

    fn look_ahead(&mut self) {
        let generators = self.generators.iter();
        let changes = generators.filter_map(|one| one.next_change(self.seen, &self.reference));
        self.next_event = changes.min().map(|clock| self.nanos(clock));
    }

    /// Number of generators.
    pub fn count(&self) -> usize {
        self.generators.len()
    }

    /// Frequency of a generator in hertz: of its periods, or of the single steps for PDM.
    pub fn frequency(&self, unit: usize, now: Nanos) -> f64 {
        let Some(generator) = self.generators.get(unit) else {
            return 0.0;
        };
        let stage = generator.stage_at(self.clocks(now), &self.reference);
        let clock = f64::from(self.clock) / 65_536.0;
        if stage.style() == Style::Pdm {
            return clock * f64::from(self.reference.pdm.rate());
        }
        let halves = if stage.symmetrical() { 2.0 } else { 1.0 };
        clock * f64::from(self.reference.pwm.rate()) / f64::from(stage.steps()) / halves
    }

    /// Fraction of the time in which a generator's first pin is high, 0 to 1; `None` while the pin
    /// is not driven. A plain output is high always or never; so is a generator whose clock stands
    /// still.
    pub fn duty(&self, unit: usize, io: &SimIoPorts, now: Nanos) -> Option<f64> {
        let generator = self.generators.get(unit)?;
        let clock = self.clocks(now);
        let (high, inverted) = match io.source(self.pins.get(unit)?.out) {
            Source::Undriven => return None,
            Source::Level(level) => (f64::from(u8::from(level)), false),
            Source::Module { inverted } => {
                let stage = generator.stage_at(clock, &self.reference);
                let rate = match stage.style() {
                    Style::Pdm => self.reference.pdm.rate(),
                    _ => self.reference.pwm.rate(),
                };
                let high = if rate == 0 {
                    f64::from(u8::from(generator.level(clock, false, &self.reference)))
                } else {
                    stage.high_part(clock, &self.reference)
                };
                (high, inverted)
            }
        };
        Some(if inverted { 1.0 - high } else { high })
    }

    /// The voltage of an analog output of a 7I97, whose low-pass filter is behind the pin: 0 V at
    /// half scale. The 0 V of a pin that is not driven is an assumption; the manual does not
    /// specify it.
    pub fn volts(&self, unit: usize, io: &SimIoPorts, now: Nanos) -> f64 {
        let duty = self.duty(unit, io, now);
        duty.map_or(0.0, |high| (high - 0.5) * 2.0 * FULL_SCALE)
    }

    /// True if the drive-enable switch of an output conducts: its /enable pin is driven low, by the
    /// module or as a plain output.
    pub fn drive_enabled(&self, unit: usize, io: &SimIoPorts) -> bool {
        self.pins
            .get(unit)
            .is_some_and(|pins| match io.source(pins.enable) {
                Source::Undriven => false,
                Source::Level(level) => !level,
                Source::Module { inverted } => self.enabled(pins.enabled_by) != inverted,
            })
    }

    /// True if a generator has its direction on a separate pin, as sign and magnitude need.
    pub fn has_direction_pin(&self, unit: usize) -> bool {
        self.pins
            .get(unit)
            .is_some_and(|pins| pins.direction.is_some())
    }

    fn enabled(&self, unit: usize) -> bool {
        unit < 32 && self.enables >> unit & 1 != 0
    }

    fn clocks(&self, nanos: Nanos) -> u64 {
        clocks(self.clock, nanos)
    }

    fn nanos(&self, clocks: u64) -> Nanos {
        (u128::from(clocks) * 1_000_000_000).div_ceil(u128::from(self.clock)) as Nanos
    }
}

fn clocks(clock: u32, nanos: Nanos) -> u64 {
    (u128::from(nanos) * u128::from(clock) / 1_000_000_000) as u64
}
