//! PWM generators, and the analog outputs of a 7I97 behind them.

use super::IoPorts;
use crate::sim::fpga::firmware::{Firmware, ModuleDescriptor};

const VALUE: u8 = 0;
const MODE: u8 = 1;
const MASTER_RATE: u8 = 2;
const PDM_RATE: u8 = 3;
const ENABLES: u8 = 4;

const PIN_OUT: u8 = 0x81;
const PIN_DIRECTION: u8 = 0x82;
const PIN_ENABLE: u8 = 0x83;

const SYMMETRICAL: u32 = 1 << 2;
const DITHER: u32 = 1 << 6;
const DIRECTION: u32 = 1 << 31;

/// Analog full scale of a 7I97 in volts.
const FULL_SCALE: f64 = 10.0;

/// Which signal a generator puts on its first pin.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Style {
    Magnitude,
    Swapped,
    UpDown,
    Pdm,
}

/// The pins of one generator.
#[derive(Clone, Copy, Debug, Default)]
struct Pins {
    out: Option<usize>,
    direction: Option<usize>,
    /// The /enable pin, and which generator's enable bit it follows.
    enable: Option<usize>,
    enabled_by: u8,
}

/// All PWM generators. REGISTERS, "PWM".
#[derive(Clone, Debug)]
pub struct Pwm {
    clock: u32,
    version: u8,
    master_rate: u32,
    pdm_rate: u32,
    enables: u32,
    generators: Vec<Generator>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Generator {
    value: u32,
    mode: u32,
    pins: Pins,
}

impl Pwm {
    pub(crate) fn new(firmware: &Firmware, module: &ModuleDescriptor) -> Self {
        let pin = |unit, pin| firmware.pin(module.gtag, unit, pin);
        let generators = (0..module.instances.min(32)).map(|unit| {
            let own = pin(unit, PIN_ENABLE);
            let pins = Pins {
                out: pin(unit, PIN_OUT),
                direction: pin(unit, PIN_DIRECTION),
                enable: own.or_else(|| pin(0, PIN_ENABLE)),
                enabled_by: if own.is_some() { unit } else { 0 },
            };
            Generator {
                pins,
                ..Generator::default()
            }
        });
        Self {
            clock: firmware.clock(module.clock),
            version: module.version,
            master_rate: 0,
            pdm_rate: 0,
            enables: 0,
            generators: generators.collect(),
        }
    }

    pub(crate) fn read(&self, register: u8, instance: u8) -> u32 {
        let generator = self.generators.get(usize::from(instance));
        match register {
            VALUE => generator.map_or(0, |generator| generator.value),
            MODE => generator.map_or(0, |generator| generator.mode),
            MASTER_RATE => self.master_rate,
            PDM_RATE => self.pdm_rate,
            ENABLES => self.enables,
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, register: u8, instance: u8, value: u32) {
        let generator = self.generators.get_mut(usize::from(instance));
        match (register, generator) {
            (VALUE, Some(generator)) => generator.value = value,
            (MODE, Some(generator)) => generator.mode = value & 0x7F,
            (MASTER_RATE, _) => self.master_rate = value & 0xFFFF,
            (PDM_RATE, _) => self.pdm_rate = value & 0xFFFF,
            (ENABLES, _) => self.enables = value,
            _ => {}
        }
    }

    /// Number of generators.
    pub fn count(&self) -> usize {
        self.generators.len()
    }

    /// Frequency of a generator in hertz.
    pub fn frequency(&self, unit: usize) -> f64 {
        let Some(generator) = self.generators.get(unit) else {
            return 0.0;
        };
        let clock = f64::from(self.clock) / 65_536.0;
        if generator.style() == Style::Pdm {
            return clock * f64::from(self.pdm_rate) / 4096.0;
        }
        let halves = if generator.mode & SYMMETRICAL != 0 {
            2.0
        } else {
            1.0
        };
        clock * f64::from(self.master_rate) / f64::from(1u32 << generator.bits()) / halves
    }

    /// The part of the time in which a generator's first pin is high, 0 to 1; `None` while the
    /// generator does not drive it.
    pub fn duty(&self, unit: usize, io: &IoPorts) -> Option<f64> {
        let generator = self.generators.get(unit)?;
        let inverted = io.module_pin(generator.pins.out)?;
        let high = generator.high_part(self.enabled(unit), self.version);
        Some(if inverted { 1.0 - high } else { high })
    }

    /// The voltage of an analog output of a 7I97, whose low-pass filter stands behind the pin:
    /// 0 V at half scale, and 0 V while the generator is off or does not reach the pin.
    pub fn volts(&self, unit: usize, io: &IoPorts) -> f64 {
        match self.duty(unit, io) {
            Some(high) if self.enabled(unit) => (high - 0.5) * 2.0 * FULL_SCALE,
            _ => 0.0,
        }
    }

    /// Whether the drive-enable switch of an output conducts: its /enable pin is driven low.
    pub fn drive_enabled(&self, unit: usize, io: &IoPorts) -> bool {
        self.generators.get(unit).is_some_and(|generator| {
            let on = self.enabled(usize::from(generator.pins.enabled_by));
            io.module_pin(generator.pins.enable)
                .is_some_and(|inverted| on != inverted)
        })
    }

    /// The level on a pin of a generator; a running PWM shows as low.
    pub(crate) fn level(&self, unit: u8, pin: u8) -> bool {
        let enabled = self.enabled(usize::from(unit));
        let generator = self.generators.get(usize::from(unit));
        generator.is_some_and(|generator| match pin {
            PIN_ENABLE => !enabled,
            PIN_DIRECTION => generator.value & DIRECTION != 0,
            _ => generator.high_part(enabled, self.version) >= 1.0,
        })
    }

    /// Whether a generator has its direction on a pin of its own, as sign and magnitude need.
    pub fn has_direction_pin(&self, unit: usize) -> bool {
        let generator = self.generators.get(unit);
        generator.is_some_and(|generator| generator.pins.direction.is_some())
    }

    fn enabled(&self, unit: usize) -> bool {
        unit < 32 && self.enables >> unit & 1 != 0
    }
}

impl Generator {
    fn bits(&self) -> u32 {
        9 + (self.mode & 3)
    }

    fn style(&self) -> Style {
        match self.mode >> 3 & 3 {
            0 => Style::Magnitude,
            1 => Style::Swapped,
            2 => Style::UpDown,
            _ => Style::Pdm,
        }
    }

    fn high_part(&self, enabled: bool, version: u8) -> f64 {
        if !enabled {
            return 0.0;
        }
        let steps = f64::from(self.value >> 16 & 0xFFF);
        let dithers = version >= 1 && self.mode & DITHER != 0;
        let fraction = if dithers {
            f64::from(self.value & 0xFFFF) / 65_536.0
        } else {
            0.0
        };
        let backwards = self.value & DIRECTION != 0;
        let full = match self.style() {
            Style::Pdm => 4096.0,
            Style::Swapped => return f64::from(u8::from(backwards)),
            // Up on this pin, down on the other.
            Style::UpDown if !backwards => return 0.0,
            _ => f64::from(1u32 << self.bits()),
        };
        ((steps + fraction) / full).min(1.0)
    }
}
