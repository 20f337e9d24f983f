//! Isolated outputs: SSR and OutM; and LEDs.

use mesa_wire::bus::Direction;

use super::io_ports::Source;
use super::{Configuration, Settles, SimIoPorts, SimModule};
use crate::fpga::{Fabric, SimPinDescriptor, UNDRIVEN, gtag};
use crate::wire::Nanos;

const DATA: u8 = 0;
const RATE: u8 = 1;

const RUN: u32 = 1 << 12;
const DIVISOR: u32 = 0xFFF;

/// First output pin, and the pin of the AC reference.
const FIRST_PIN: u8 = 0x81;
const REFERENCE_PIN: u8 = 0xA0;

/// The rate register of an SSR after configuration: 1 MHz, off. FACTS 12.10.
const RATE_AT_RESET: u32 = 0x030;

/// The outputs of an SSR or OutM module. FACTS 12.10, 13.7.
#[derive(Clone, Debug)]
pub struct SimOutputs {
    driven_by_ac: bool,
    data: u32,
    rate: u32,
    carrier: Carrier,
    pins: [Option<usize>; 32],
    reference: Option<usize>,
}

impl SimModule for SimOutputs {
    fn read(&mut self, _: &Fabric, register: u8, _: u8) -> u32 {
        match register {
            DATA => self.data,
            RATE if self.driven_by_ac => self.rate,
            _ => UNDRIVEN,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, _: u8, value: u32) {
        match register {
            DATA => self.data = value,
            RATE => {
                self.rate = value & (RUN | DIVISOR);
                self.carrier.set(fabric.now(), self.rate);
            }
            _ => {}
        }
    }

    fn reload(&mut self, configuration: &Configuration<'_>) {
        *self = Self::new(configuration);
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::Nothing
    }

    fn is_driving(&self) -> bool {
        true
    }

    /// An SSR is on while its pin and the reference differ.
    fn level(&self, now: Nanos, pin: SimPinDescriptor) -> bool {
        let carrier = self.driven_by_ac && self.carrier.level(now);
        if self.driven_by_ac && pin.pin == REFERENCE_PIN {
            return carrier;
        }
        let output = pin.pin.wrapping_sub(FIRST_PIN);
        output < 32 && (self.data >> output & 1 != 0) ^ carrier
    }
}

impl SimOutputs {
    /// Outputs after the configuration of the FPGA.
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        let gtag = configuration.module.gtag;
        let driven_by_ac = gtag == gtag::SSR;
        let pin = |number| configuration.firmware.pin(gtag, 0, number);
        Self {
            driven_by_ac,
            data: 0,
            rate: RATE_AT_RESET,
            carrier: Carrier::new(configuration.clock(), configuration.now),
            pins: core::array::from_fn(|n| {
                let number = FIRST_PIN + n as u8;
                let is_free = !driven_by_ac || number != REFERENCE_PIN;
                is_free.then(|| pin(number)).flatten()
            }),
            reference: pin(REFERENCE_PIN),
        }
    }

    /// Frequency in hertz of the AC that drives the SSRs; 0 while it is off.
    pub fn drive_frequency(&self) -> f64 {
        if self.rate & RUN == 0 {
            return 0.0;
        }
        f64::from(self.carrier.clock) / f64::from((self.rate & DIVISOR) + 2) / 2.0
    }

    /// True if an output conducts. An SSR conducts while its AC runs on the reference, and its own
    /// pin is not in phase with it.
    pub fn is_on(&self, output: usize, io: &SimIoPorts) -> bool {
        let source = io.source(self.pins.get(output).copied().flatten());
        let wanted = self.data >> output & 1 != 0;
        if !self.driven_by_ac {
            return match source {
                Source::Undriven => false,
                Source::Level(level) => level,
                Source::Module { inverted } => wanted != inverted,
            };
        }
        let Some(reference) = io
            .module_pin(self.reference)
            .filter(|_| self.rate & RUN != 0)
        else {
            return false;
        };
        match source {
            Source::Undriven => false,
            Source::Level(_) => true,
            Source::Module { inverted } => wanted != (inverted != reference),
        }
    }
}

/// The AC of the SSRs: a divider that runs from configuration on and takes a new divisor at its
/// next edge, and a switch behind it. Times are in clocks.
#[derive(Clone, Copy, Debug)]
struct Carrier {
    clock: u32,
    /// First edge of the divider after the last write, and the level before that edge.
    next: u64,
    high: bool,
    /// Clocks between two edges from `next` on.
    half_period: u64,
    /// Present and previous state of the AC switch, and the clock of the change.
    runs: bool,
    ran: bool,
    switched: u64,
}

impl Carrier {
    fn new(clock: u32, now: Nanos) -> Self {
        let mut carrier = Self {
            clock,
            next: 0,
            high: false,
            half_period: u64::from(RATE_AT_RESET) + 2,
            runs: false,
            ran: false,
            switched: 0,
        };
        carrier.next = carrier.clocks(now) + 2;
        carrier
    }

    fn set(&mut self, now: Nanos, rate: u32) {
        let now = self.clocks(now);
        let passed = self.edges(now);
        self.high ^= passed % 2 == 1;
        self.next += passed * self.half_period;
        self.half_period = u64::from(rate & DIVISOR) + 2;
        self.ran = self.runs;
        self.runs = rate & RUN != 0;
        self.switched = now;
    }

    fn level(&self, now: Nanos) -> bool {
        let now = self.clocks(now);
        // The switch acts one clock after the write.
        let on = if now > self.switched {
            self.runs
        } else {
            self.ran
        };
        on && self.high ^ (self.edges(now) % 2 == 1)
    }

    /// Edges of the divider since the last write.
    fn edges(&self, now: u64) -> u64 {
        let since = now.checked_sub(self.next);
        since.map_or(0, |clocks| clocks / self.half_period + 1)
    }

    fn clocks(&self, nanos: Nanos) -> u64 {
        (u128::from(nanos) * u128::from(self.clock) / 1_000_000_000) as u64
    }
}

/// Number of LEDs of a board: the bits of the register. FACTS 12.10.
const LEDS: usize = 4;

/// The LEDs: the top bits of one register. FACTS 12.10, 13.9.
#[derive(Clone, Copy, Debug, Default)]
pub struct SimLeds {
    word: u32,
}

impl SimModule for SimLeds {
    fn read(&mut self, _: &Fabric, _: u8, _: u8) -> u32 {
        UNDRIVEN
    }

    fn write(&mut self, _: &mut Fabric, _: u8, _: u8, value: u32) {
        self.word = value & 0xF000_0000;
    }

    fn reload(&mut self, _: &Configuration<'_>) {
        *self = Self::default();
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::Nothing
    }
}

impl SimLeds {
    /// True if an LED is lit (its pin is low); LED 0 is the top bit.
    pub fn is_lit(self, led: usize) -> bool {
        led < LEDS && self.word >> (31 - led) & 1 != 0
    }
}
