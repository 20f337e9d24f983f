//! The watchdog: without its cookie in time, every pin becomes an input.

use mesa_wire::bus::Direction;

use super::{Configuration, Effect, Settles, SimModule};
use crate::fpga::{Fabric, UNDRIVEN};
use crate::wire::Nanos;

const TIME: u8 = 0;
const STATUS: u8 = 1;
const RESET: u8 = 2;

/// Bit 31 of the counter: the counter is stopped.
const STOPPED: u32 = 1 << 31;
const COOKIE: u32 = 0x5A;

/// The watchdog: a counter that runs down and bites when its bit 31 rises. FACTS 12.1.
///
/// Every rise of that bit makes the watchdog bite: the counter passes 0; a time with bit 31 set is
/// written while it runs; or a cookie arrives before any time, while the time register holds zero.
/// The status is set one clock after the bit has risen, and the pins become inputs one clock after
/// that.
#[derive(Clone, Copy, Debug)]
pub struct SimWatchdog {
    clock: u32,
    /// The time register, which the cookie loads into the counter.
    time: u32,
    /// The value loaded into the counter, and the time of the load.
    loaded: u32,
    since: Nanos,
    /// Time at which the status is set after bit 31 rose.
    status_due: Option<Nanos>,
    /// Time at which the pins become inputs after bit 31 rose.
    pins_due: Option<Nanos>,
    bitten: bool,
}

impl Default for SimWatchdog {
    /// A watchdog whose counter is stopped.
    fn default() -> Self {
        Self {
            clock: 1,
            time: 0,
            loaded: STOPPED,
            since: 0,
            status_due: None,
            pins_due: None,
            bitten: false,
        }
    }
}

impl SimModule for SimWatchdog {
    fn read(&mut self, fabric: &Fabric, register: u8, _: u8) -> u32 {
        match register {
            TIME => self.count(fabric.now()),
            STATUS => u32::from(self.bitten),
            _ => UNDRIVEN,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, _: u8, value: u32) {
        match register {
            TIME => {
                self.time = value;
                self.load(fabric.now());
            }
            STATUS => self.bitten = value & 1 != 0,
            RESET if value >> 24 == COOKIE => self.load(fabric.now()),
            _ => {}
        }
    }

    fn reload(&mut self, configuration: &Configuration<'_>) {
        *self = Self::new(configuration);
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::Nothing
    }

    fn next_event(&self, _: Nanos) -> Option<Nanos> {
        let events = [self.status_due, self.pins_due, self.runs_out()];
        events.into_iter().flatten().min()
    }

    fn event(&mut self, now: Nanos) -> Effect {
        let due = |event: &mut Option<Nanos>| event.take_if(|event| *event <= now).is_some();
        self.bitten |= due(&mut self.status_due);
        let bites = due(&mut self.pins_due);
        if let Some(end) = self.runs_out().filter(|&end| end <= now) {
            self.loaded = u32::MAX;
            self.since = end;
            self.rises(end);
        }
        if bites { Effect::Bite } else { Effect::Nothing }
    }
}

impl SimWatchdog {
    /// A watchdog after configuration of the FPGA: its counter is stopped. Older firmware starts
    /// with it bitten.
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        Self {
            clock: configuration.clock(),
            bitten: configuration.firmware.starts_bitten,
            ..Self::default()
        }
    }

    /// True if the watchdog has bitten and its status has not been cleared since.
    pub fn has_bitten(&self) -> bool {
        self.bitten
    }

    /// True if the counter runs: the board is driven, and the watchdog bites unless its cookie
    /// arrives.
    pub fn is_running(&self) -> bool {
        self.loaded & STOPPED == 0
    }

    /// Loads the time register into the counter.
    fn load(&mut self, now: Nanos) {
        let running = self.is_running();
        self.loaded = self.time;
        self.since = now;
        if running && self.time & STOPPED != 0 {
            self.rises(now);
        }
    }

    /// Handles a rise of the counter's bit 31.
    fn rises(&mut self, now: Nanos) {
        self.status_due = Some(now.saturating_add(self.nanos(1)));
        self.pins_due = Some(now.saturating_add(self.nanos(2)));
    }

    /// Time at which the running counter passes 0.
    fn runs_out(&self) -> Option<Nanos> {
        let running = self.is_running();
        let clocks = u64::from(self.loaded) + 1;
        running.then(|| self.since.saturating_add(self.nanos(clocks)))
    }

    fn count(&self, now: Nanos) -> u32 {
        if !self.is_running() {
            return self.loaded;
        }
        let passed = u128::from(now.saturating_sub(self.since)) * u128::from(self.clock);
        self.loaded.wrapping_sub((passed / 1_000_000_000) as u32)
    }

    /// Duration of a number of clocks.
    fn nanos(&self, clocks: u64) -> Nanos {
        (clocks * 1_000_000_000).div_ceil(u64::from(self.clock))
    }
}
