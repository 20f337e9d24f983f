//! The watchdog: without its cookie in time, every pin becomes an input.

use crate::sim::wire::Nanos;

const TIME: u8 = 0;
const STATUS: u8 = 1;
const RESET: u8 = 2;

const DISABLED: u32 = 1 << 31;
const COOKIE: u32 = 0x5A;

/// The watchdog. REGISTERS, "Watchdog".
#[derive(Clone, Copy, Debug)]
pub struct Watchdog {
    clock: u32,
    time: u32,
    started: Nanos,
    bitten: bool,
}

impl Watchdog {
    /// A watchdog at power-up: disabled.
    pub(crate) fn new(clock: u32) -> Self {
        Self {
            clock: clock.max(1),
            time: DISABLED,
            started: 0,
            bitten: false,
        }
    }

    pub(crate) fn read(&self, register: u8) -> u32 {
        match register {
            TIME => self.time,
            STATUS => u32::from(self.bitten),
            _ => 0,
        }
    }

    /// Clearing the status, a new time and the cookie each start the full time again.
    pub(crate) fn write(&mut self, now: Nanos, register: u8, value: u32) {
        match register {
            TIME => {
                self.time = value;
                self.started = now;
            }
            STATUS if value & 1 == 0 => {
                self.bitten = false;
                self.started = now;
            }
            RESET if value >> 24 == COOKIE => self.started = now,
            _ => {}
        }
    }

    /// When it bites if nobody writes to it.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        if self.bitten || self.time & DISABLED != 0 {
            return None;
        }
        let clocks = u64::from(self.time) + 1;
        Some(self.started + (clocks * 1_000_000_000).div_ceil(u64::from(self.clock)))
    }

    pub(crate) fn bite(&mut self) {
        self.bitten = true;
    }

    /// Whether it has bitten and nobody has cleared it since.
    pub fn has_bitten(&self) -> bool {
        self.bitten
    }
}
