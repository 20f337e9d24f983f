//! The watchdog: without its cookie in time, every pin becomes an input.

use crate::fpga::UNDRIVEN;
use crate::wire::Nanos;

const TIME: u8 = 0;
const STATUS: u8 = 1;
const RESET: u8 = 2;

/// Bit 31 of the counter: it stands still.
const STOPPED: u32 = 1 << 31;
const COOKIE: u32 = 0x5A;

/// The watchdog: a counter that runs down and bites when its bit 31 rises. FACTS 12.1.
///
/// Whoever makes that bit rise makes it bite: the counter that passes 0, a time with bit 31 set
/// that is written while it runs, and a cookie that comes before any time, because the time
/// register then holds 0. The status is set one clock after the bit has risen, and the pins become
/// inputs one clock after that.
#[derive(Clone, Copy, Debug)]
pub struct Watchdog {
    clock: u32,
    /// The time register, which the cookie loads into the counter.
    time: u32,
    /// What the counter was loaded with, and when.
    loaded: u32,
    since: Nanos,
    /// When the status is set, because bit 31 rose.
    status_due: Option<Nanos>,
    /// When the pins become inputs, because bit 31 rose.
    pins_due: Option<Nanos>,
    bitten: bool,
}

impl Watchdog {
    /// A watchdog after configuration of the FPGA: its counter stands. Older firmware starts with
    /// `bitten`.
    pub(crate) fn new(clock: u32, bitten: bool) -> Self {
        Self {
            clock: clock.max(1),
            time: 0,
            loaded: STOPPED,
            since: 0,
            status_due: None,
            pins_due: None,
            bitten,
        }
    }

    pub(crate) fn read(&self, now: Nanos, register: u8) -> u32 {
        match register {
            TIME => self.count(now),
            STATUS => u32::from(self.bitten),
            _ => UNDRIVEN,
        }
    }

    pub(crate) fn write(&mut self, now: Nanos, register: u8, value: u32) {
        match register {
            TIME => {
                self.time = value;
                self.load(now);
            }
            STATUS => self.bitten = value & 1 != 0,
            RESET if value >> 24 == COOKIE => self.load(now),
            _ => {}
        }
    }

    /// When something happens if nobody writes to it.
    pub(crate) fn next_event(&self) -> Option<Nanos> {
        let events = [self.status_due, self.pins_due, self.runs_out()];
        events.into_iter().flatten().min()
    }

    /// Does what is due at `now`; `true` if the pins become inputs.
    pub(crate) fn event(&mut self, now: Nanos) -> bool {
        let due = |event: &mut Option<Nanos>| event.take_if(|event| *event <= now).is_some();
        self.bitten |= due(&mut self.status_due);
        let bites = due(&mut self.pins_due);
        if let Some(end) = self.runs_out().filter(|&end| end <= now) {
            self.loaded = u32::MAX;
            self.since = end;
            self.rises(end);
        }
        bites
    }

    /// Whether it has bitten and nobody has cleared its status since.
    pub fn has_bitten(&self) -> bool {
        self.bitten
    }

    /// Whether its counter runs: somebody drives the board, and it bites unless its cookie comes.
    pub fn is_running(&self) -> bool {
        self.loaded & STOPPED == 0
    }

    /// Puts the time into the counter.
    fn load(&mut self, now: Nanos) {
        let running = self.is_running();
        self.loaded = self.time;
        self.since = now;
        if running && self.time & STOPPED != 0 {
            self.rises(now);
        }
    }

    /// Bit 31 of the counter rises.
    fn rises(&mut self, now: Nanos) {
        self.status_due = Some(now.saturating_add(self.nanos(1)));
        self.pins_due = Some(now.saturating_add(self.nanos(2)));
    }

    /// When the counter passes 0, while it runs.
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

    /// The time that a number of clocks takes.
    fn nanos(&self, clocks: u64) -> Nanos {
        (clocks * 1_000_000_000).div_ceil(u64::from(self.clock))
    }
}
