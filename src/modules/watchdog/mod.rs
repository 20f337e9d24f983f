//! The watchdog: makes all pins inputs when the host falls silent, and shows whether the board is
//! still the one that was set up.
//!
//! # Evidence
//! Two registers are read in every cycle. The *status* is set by a bite, and the *time* reads what is
//! left of it: 0x8000_0000 after a reset, 0xFFFF_FFFF after a bite, and otherwise no more than was
//! written (FACTS 12.1). No single exchange makes both look right again:
//!
//! - A write of the cycle restarts the watchdog, which bites if its time was never written.
//! - A write that holds a new time restarts it first, so that a reset shows in the status.
//! - The set-up clears the status and leaves a time that is longer than any that is used; only the
//!   write after it sets the true time.
//!
//! After whatever could have blurred this, the directions of the pins are read as well, which a
//! reset and a bite clear. All of it is read after the inputs: what was read before good evidence is
//! from a board that was set up.

mod registers;

pub use registers::WatchdogRegisters;

use core::time::Duration;

use super::{BoardState, Module, RegisterError, Registrar, WriteCycle};
use crate::bus::{Instant, Phase, ReadSlot, Setting, Words, WriteSlot};
use crate::hal::{InOut, Param, PinStore, Pins};

/// The board's watchdog.
#[derive(Debug)]
pub struct Watchdog {
    /// Its registers.
    pub registers: WatchdogRegisters,
    /// Its pins.
    pub pins: WatchdogPins,
    timeout_ns: u32,
    /// No shorter time is taken, because the period could not feed it.
    shortest: Duration,
    stage: Stage,
    /// The longest time that was written in the cycle.
    longest: u32,
    /// Whether the next write keeps it running, ...
    is_fed: bool,
    /// ... and when the last one did.
    fed: Option<Instant>,
    /// When the write began: the host may stand still between that and its end.
    sent_from: Option<Instant>,
    status: ReadSlot,
    time_left: ReadSlot,
    pet: WriteSlot,
    time: Setting,
}

/// The watchdog's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WatchdogPins {
    /// It has bitten; set it to false to go on.
    pub has_bit: InOut<bool>,
    /// Nanoseconds without a write after which it bites. Less than two periods are taken as two
    /// periods, because a write that is lost must not let it bite.
    pub timeout_ns: Param<u32>,
}

/// What the time register is expected to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// It was set up, and the cycle has not begun.
    Disabled,
    /// The board was set up again.
    Held,
    /// In the cycle.
    Running,
}

impl Watchdog {
    /// The watchdog of a firmware. To be registered first: its time is the first write of the set-up.
    ///
    /// # Errors
    /// [`RegisterError::Firmware`] and [`RegisterError::Pin`].
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<Self, RegisterError> {
        let registers = WatchdogRegisters::locate(r.firmware)?;
        let timeout = r.settings.watchdog_time();
        let timeout_ns = u32::try_from(timeout.as_nanos()).unwrap_or(u32::MAX);
        let mut make = r.maker("watchdog.");
        let pins = WatchdogPins {
            has_bit: make.inout("has_bit")?,
            timeout_ns: make.setting("timeout_ns", timeout_ns)?,
        };
        let (time, status, reset) = (registers.time, registers.status, registers.reset);
        // At first it must not bite before the cycle feeds it: discovery takes seconds. If it runs, it
        // bites now (FACTS 12.1).
        let (at_first, again) = (WatchdogRegisters::DISABLED, WatchdogRegisters::LONGEST);
        r.image.opening(time, at_first, again);
        // Older firmware starts with a bite.
        r.image.closing(status, Some(0), 0);
        // If the board was reset in the middle of it, the time is lost again, and the watchdog bites.
        // One that is disabled stays so (FACTS 12.1).
        let pet = WatchdogRegisters::PET;
        r.image.closing(reset, Some(pet), pet);
        Ok(Self {
            registers,
            pins,
            timeout_ns,
            shortest: r.settings.period.saturating_mul(2),
            stage: Stage::Disabled,
            longest: 0,
            is_fed: false,
            fed: None,
            sent_from: None,
            status: r.image.read(Phase::Evidence, status),
            time_left: r.image.read(Phase::Evidence, time),
            // First, so that a board that was reset bites before it is given a time.
            pet: r.image.write(Phase::First, reset, WatchdogRegisters::PET),
            time: r.image.on_demand(time),
        })
    }

    /// A write begins that may restart it.
    pub(crate) fn sending(&mut self, now: Instant) {
        self.sent_from = Some(now);
    }

    /// Its time as it was written last.
    pub fn timeout(&self) -> Duration {
        Duration::from_nanos(self.timeout_ns.into())
    }

    /// Whether the evidence is as the set-up leaves it; if so, the cycle goes on from there.
    pub(crate) fn is_set_up(&mut self, words: &Words) -> bool {
        let time = words.word(self.time_left);
        let is_held = is_counting(time) && time > self.longest;
        let is_set_up = !has_bitten(words.word(self.status)) && is_held && words.stands();
        if is_set_up {
            self.stage = Stage::Held;
            self.fed = None;
        }
        is_set_up
    }

    /// What the evidence in a read shows has happened to the board; `None` if it is set up.
    /// `closely`: the read holds more than usual; `is_certain`: all writes before have arrived.
    pub(crate) fn examine(
        &mut self,
        words: &Words,
        closely: bool,
        now: Instant,
        is_certain: bool,
    ) -> Option<BoardState> {
        let time = words.word(self.time_left);
        if words.word(self.status) == NO_FPGA {
            return Some(BoardState::Reset);
        }
        if has_bitten(words.word(self.status)) {
            return Some(self.who_bit(time, now, is_certain));
        }
        let in_cycle = is_counting(time) && time <= self.longest;
        let is_expected = match self.stage {
            Stage::Disabled => in_cycle || time == WatchdogRegisters::DISABLED,
            Stage::Held => is_counting(time),
            Stage::Running => in_cycle,
        };
        if !is_expected || closely && !words.stands() {
            return Some(BoardState::Reset);
        }
        if in_cycle {
            self.stage = Stage::Running;
        }
        None
    }

    /// Whether it is as a reset leaves it: without a bite, and without the time that a set-up gives it.
    pub(crate) fn shows_reset(&self, words: &Words) -> bool {
        let (status, time) = (words.word(self.status), words.word(self.time_left));
        self.stage != Stage::Disabled && !has_bitten(status) && !WatchdogRegisters::runs(time)
    }

    /// After a reset the next write makes the watchdog bite at once, without a time of its own; a
    /// bite of a board that was set up needs a silence that is longer than its time.
    fn who_bit(&self, time: u32, now: Instant, is_certain: bool) -> BoardState {
        let timeout = self.registers.timeout_of(self.longest);
        let was_fed = |fed: Instant| timeout.is_some_and(|timeout| now.since(fed) < timeout);
        if !is_counting(time) && is_certain && self.fed.is_some_and(was_fed) {
            BoardState::Reset
        } else {
            BoardState::WatchdogBitten
        }
    }

    /// Whether the application has cleared the bite.
    pub(crate) fn is_cleared(&self, pins: &Pins) -> bool {
        !pins.read(self.pins.has_bit).value
    }

    /// Publishes whether it has bitten.
    pub(crate) fn show(&self, pins: &mut PinStore, has_bitten: bool) {
        pins.publish(self.pins.has_bit, has_bitten);
    }
}

impl Module for Watchdog {
    /// Restarts it, unless everything has to stay safe; and gives it its time, if it has none yet, or
    /// another one.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        let timeout_ns = cycle.pins.param(self.pins.timeout_ns);
        let is_new = core::mem::replace(&mut self.timeout_ns, timeout_ns) != timeout_ns;
        self.is_fed = cycle.is_running;
        // Restarted without a time, it would bite.
        let is_restarted = self.is_fed && self.stage != Stage::Disabled;
        let word = if is_restarted {
            WatchdogRegisters::PET
        } else {
            0
        };
        cycle.words.put(self.pet, word);
        if !cycle.is_running || self.stage == Stage::Running && !is_new {
            return;
        }
        let time = self.registers.time_for(self.timeout().max(self.shortest));
        self.longest = self.longest.max(time);
        cycle.words.set(self.time, time);
        cycle.words.repeat(self.time);
        cycle.ask_extra();
    }

    fn written(&mut self, now: Instant, _: bool) {
        let sent_from = self.sent_from.take().unwrap_or(now);
        if self.is_fed {
            self.fed = Some(sent_from);
        }
    }
}

/// The counter stops below 0.
fn is_counting(time: u32) -> bool {
    time != 0 && WatchdogRegisters::runs(time)
}

/// What is read where an FPGA has lost its configuration in the middle of the exchange, after it has
/// shown what it is. A bite sets a single bit.
const NO_FPGA: u32 = u32::MAX;

fn has_bitten(status: u32) -> bool {
    status & WatchdogRegisters::HAS_BIT != 0
}
