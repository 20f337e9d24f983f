//! Isolated outputs: SSR and OutM; and LEDs.

use super::IoPorts;
use crate::sim::fpga::firmware::{Firmware, ModuleDescriptor, gtag};

const DATA: u8 = 0;
const RATE: u8 = 1;

const RUN: u32 = 1 << 12;
const DIVISOR: u32 = 0xFFF;

/// First output pin, and the pin of the AC reference.
const FIRST_PIN: u8 = 0x81;
const REFERENCE_PIN: u8 = 0xA0;

/// The outputs of an SSR or OutM module. REGISTERS, "SSR".
#[derive(Clone, Debug)]
pub struct Outputs {
    driven_by_ac: bool,
    clock: u32,
    data: u32,
    rate: u32,
    pins: [Option<usize>; 32],
    reference: Option<usize>,
}

impl Outputs {
    pub(crate) fn new(firmware: &Firmware, module: &ModuleDescriptor) -> Self {
        Self {
            driven_by_ac: module.gtag == gtag::SSR,
            clock: firmware.clock(module.clock),
            data: 0,
            rate: 0,
            pins: core::array::from_fn(|n| {
                let number = FIRST_PIN + n as u8;
                let free = module.gtag != gtag::SSR || number != REFERENCE_PIN;
                free.then(|| firmware.pin(module.gtag, 0, number)).flatten()
            }),
            reference: firmware.pin(module.gtag, 0, REFERENCE_PIN),
        }
    }

    pub(crate) fn read(&self, register: u8) -> u32 {
        match register {
            DATA => self.data,
            RATE => self.rate,
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, register: u8, value: u32) {
        match register {
            DATA => self.data = value,
            RATE => self.rate = value & (RUN | DIVISOR),
            _ => {}
        }
    }

    /// Frequency of the AC that carries the SSRs' signals, in hertz; 0 while it is off.
    pub fn drive_frequency(&self) -> f64 {
        if self.rate & RUN == 0 {
            return 0.0;
        }
        f64::from(self.clock) / f64::from((self.rate & DIVISOR) + 2) / 2.0
    }

    /// Whether an output conducts. An SSR needs its AC on its own pin and on the reference.
    pub fn is_on(&self, output: usize, io: &IoPorts) -> bool {
        let pin = self.pins.get(output).copied().flatten();
        let Some(inverted) = io.module_pin(pin) else {
            return false;
        };
        let wanted = self.data >> output & 1 != 0;
        if !self.driven_by_ac {
            return wanted != inverted;
        }
        // An inverted pin is in phase with the reference when it should not be, and the reverse.
        let running = self.rate & RUN != 0;
        running && io.module_pin(self.reference).is_some() && wanted != inverted
    }

    /// The level on a pin of the module; running AC shows as low.
    pub(crate) fn level(&self, pin: u8) -> bool {
        let output = pin.wrapping_sub(FIRST_PIN);
        !self.driven_by_ac && output < 32 && self.data >> output & 1 != 0
    }
}

/// The LEDs: the top bits of one register. REGISTERS, "LED".
#[derive(Clone, Copy, Debug, Default)]
pub struct Leds {
    word: u32,
}

impl Leds {
    pub(crate) fn read(self) -> u32 {
        self.word
    }

    pub(crate) fn write(&mut self, value: u32) {
        self.word = value & 0xFF00_0000;
    }

    /// Whether an LED is lit; LED 0 is the top bit.
    pub fn is_lit(self, led: usize) -> bool {
        led < 8 && self.word >> (31 - led) & 1 != 0
    }
}
