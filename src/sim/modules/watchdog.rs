//! The watchdog: without its cookie in time, every pin becomes an input.

use crate::sim::wire::Nanos;

const TIME: u8 = 0;
const STATUS: u8 = 1;
const RESET: u8 = 2;

const DISABLED: u32 = 1 << 31;
const COOKIE: u32 = 0x5A;

/// The watchdog: a counter that runs down. REGISTERS, "Watchdog".
///
/// It bites once when the counter runs out; after that only a new time or the cookie starts it
/// again. The time register reads what is left.
#[derive(Clone, Copy, Debug)]
pub struct Watchdog {
    clock: u32,
    time: u32,
    /// When the counter was loaded with the time, if it runs.
    started: Option<Nanos>,
    bitten: bool,
}

impl Watchdog {
    /// A watchdog at power-up: disabled.
    pub(crate) fn new(clock: u32) -> Self {
        Self {
            clock: clock.max(1),
            time: DISABLED,
            started: None,
            bitten: false,
        }
    }

    pub(crate) fn read(&self, now: Nanos, register: u8) -> u32 {
        match register {
            TIME => self.left(now),
            STATUS => u32::from(self.bitten),
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, now: Nanos, register: u8, value: u32) {
        match register {
            TIME => {
                self.time = value;
                self.start(now);
            }
            STATUS => self.bitten = value & 1 != 0,
            RESET if value >> 24 == COOKIE => self.start(now),
            _ => {}
        }
    }

    /// When it bites if nobody writes to it.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        let clocks = u64::from(self.time) + 1;
        let nanos = (clocks * 1_000_000_000).div_ceil(u64::from(self.clock));
        Some(self.started?.saturating_add(nanos))
    }

    pub(crate) fn bite(&mut self) {
        self.bitten = true;
        self.started = None;
    }

    /// Whether it has bitten and nobody has cleared its status since.
    pub fn has_bitten(&self) -> bool {
        self.bitten
    }

    fn start(&mut self, now: Nanos) {
        self.started = (self.time & DISABLED == 0).then_some(now);
    }

    fn left(&self, now: Nanos) -> u32 {
        let Some(started) = self.started else {
            return if self.time & DISABLED == 0 {
                u32::MAX
            } else {
                self.time
            };
        };
        let passed = u128::from(now.saturating_sub(started)) * u128::from(self.clock);
        self.time.wrapping_sub((passed / 1_000_000_000) as u32)
    }
}
