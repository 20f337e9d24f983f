//! A module that mesa-hal does not know: a pulse generator that counts its pulses.
//!
//! | register | meaning |
//! |---|---|
//! | 0 | written: frequency in 2^-32 of the clock |
//! | 1 | written: width of a pulse in clocks |
//! | 2 | read: pulses so far |
//!
//! Pin 0x81 carries the pulses.

use mesa_hal::bus::{Instant, Phase, ReadSlot, Setting, Stage, WriteSlot};
use mesa_hal::hal::{Input, Output, Param, PinStore};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};

/// The number of the module in the gateware.
pub const GTAG: Gtag = Gtag(0x99);

const WIDTH_US: u32 = 10;

/// The pins of the pulse generator: `hm2_7i92.0.pulser.frequency` and so on.
#[derive(Clone, Copy, Debug)]
pub struct PulserPins {
    /// Pulses per second; safe at 0.
    pub frequency: Output<f64>,
    /// Width of a pulse in microseconds.
    pub width_us: Param<u32>,
    /// Pulses since the start, also across a reset of the board.
    pub count: Input<i32>,
}

/// The pulse generator in the cycle.
#[derive(Debug)]
pub struct Pulser {
    pins: PulserPins,
    clock_hz: u32,
    total: i32,
    /// The counter at the previous read; `None` if it may have been reset since.
    last: Option<u32>,
    rate: WriteSlot,
    width: Setting,
    counter: ReadSlot,
}

impl Pulser {
    /// Adds the pulse generator of a firmware, if it has one, and returns its pins.
    pub fn register(r: &mut Registrar<'_>) -> Result<Option<PulserPins>, RegisterError> {
        let Some(module) = r.module(GTAG) else {
            return Ok(None);
        };
        r.use_io(GTAG, 0)?;
        let mut make = r.maker("pulser.");
        let pins = PulserPins {
            frequency: make.output("frequency", 0.0)?,
            width_us: make.setting("width-us", WIDTH_US)?,
            count: make.input("count")?,
        };
        let width = clocks(WIDTH_US, module.clock_hz);
        let image = &mut *r.image;
        let pulser = Self {
            pins,
            clock_hz: module.clock_hz,
            total: 0,
            last: None,
            rate: image.output(module.register(0, 0)?, 0),
            width: image.setting(Stage::Configure, module.register(1, 0)?, width),
            counter: image.read(Phase::Data, module.register(2, 0)?),
        };
        r.add(pulser);
        Ok(Some(pins))
    }
}

impl Module for Pulser {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let now = cycle.words.word(self.counter);
        let last = self.last.replace(now).unwrap_or(now);
        self.total = self.total.wrapping_add(now.wrapping_sub(last) as i32);
        cycle.pins.publish(self.pins.count, self.total);
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        let turns = cycle.pins.fetch(self.pins.frequency) / f64::from(self.clock_hz);
        cycle.words.put(self.rate, (turns * 4_294_967_296.0) as u32);
        let width_us = cycle.pins.param(self.pins.width_us);
        cycle.words.set(self.width, clocks(width_us, self.clock_hz));
    }

    fn restored(&mut self, _: &mut PinStore, _: Instant) {
        self.last = None;
    }
}

fn clocks(us: u32, clock_hz: u32) -> u32 {
    us.saturating_mul(clock_hz / 1_000_000)
}
