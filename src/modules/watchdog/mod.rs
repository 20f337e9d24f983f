//! The watchdog: makes all pins inputs when the host falls silent, and provides the evidence that
//! the set-up of the board still stands.
//!
//! # Evidence
//! Two registers are read in every cycle. The *status* is set by a bite, and the *time* reads the
//! rest of the time: 0x8000_0000 after a reset, 0xFFFF_FFFF after a bite, and otherwise at most the
//! written value (FACTS 12.1). No single exchange restores both:
//!
//! - A write of the cycle restarts the watchdog, which bites if its time was never written.
//! - A write with a new time restarts it first, so that a reset shows in the status.
//! - The set-up clears the status and leaves a time that is longer than any time of the cycle; only
//!   the write after it sets the true time.
//!
//! After every event that may have masked a reset, the directions of the pins are read as well,
//! which a reset and a bite clear. The evidence is read after the inputs: inputs read before good
//! evidence come from a board that was set up.

mod registers;

pub use registers::WatchdogRegisters;

use core::time::Duration;

use super::limit::Limit;
use super::{LastFeed, ListenCycle, Module, RegisterError, Registrar, WriteCycle};
use crate::bus::{Instant, Phase, ReadSlot, Setting, Words, WriteSlot};
use crate::events::{BoardState, CorrectedValue};
use crate::hal::{InOut, Param, PinStore, Pins};
use crate::settings::usual_watchdog_time;

/// The board's watchdog.
#[derive(Debug)]
pub struct Watchdog {
    /// The registers of the watchdog.
    pub registers: WatchdogRegisters,
    /// The pins of the watchdog.
    pub(crate) pins: WatchdogPins,
    timeout_ns: u32,
    /// Lower limit of the time: two periods, because a shorter time could not be kept up by the
    /// cycle.
    shortest: Duration,
    /// The time of the parameter that follows from the period; `None` if the settings have it.
    usual_ns: Option<u32>,
    stage: WatchdogStage,
    /// The longest time that the cycle has written, as a word and as a duration.
    longest: u32,
    longest_time: Duration,
    /// The next write restarts the watchdog.
    is_fed: bool,
    /// The last write that restarted it.
    fed: Option<Feed>,
    /// End of that write, and the write before it.
    fed_by: Instant,
    fed_before: Option<Feed>,
    /// The last write that is known to have restarted it, by evidence read after it.
    confirmed: Option<Feed>,
    /// The first and the last write since then that may have restarted it, except those that have
    /// failed.
    unconfirmed: Option<[Feed; 2]>,
    /// The first write since then that the next one followed too late.
    starved: Option<Feed>,
    /// Start of the current write: the host may be suspended between that and its end.
    sent_from: Option<Instant>,
    status: ReadSlot,
    time_left: ReadSlot,
    pet: WriteSlot,
    time: Setting,
}

/// The watchdog's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WatchdogPins {
    /// The watchdog has bitten; set to false to continue.
    pub has_bit: InOut<bool>,
    /// Nanoseconds without a write after which the watchdog bites. Values below two periods are
    /// raised to two periods, because a single lost write must not cause a bite.
    pub timeout_ns: Param<u32>,
}

/// Expected content of the time register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WatchdogStage {
    /// The first set-up was written, and the cycle has not begun: disabled.
    Disabled,
    /// The board was set up again, or was given a long time outside the cycle.
    Held,
    /// The cycle runs: a time of the cycle.
    Running,
}

/// A write that restarted the watchdog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Feed {
    /// Its start.
    at: Instant,
    /// The time that it gave to the watchdog, or left to it.
    time: Duration,
}

impl Feed {
    /// Time at which the watchdog bites, without a further write.
    fn bitten_at(&self) -> Instant {
        self.at.after(self.time)
    }
}

/// A read with evidence of the set-up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EvidenceRead<'a> {
    pub words: &'a Words,
    /// Time at which the registers were read.
    pub at: Instant,
    /// The read includes the extra registers.
    pub closely: bool,
    /// All previous writes have arrived.
    pub is_certain: bool,
}

impl Watchdog {
    /// Registers the watchdog of a firmware. Must be registered first: its time is the first write
    /// of the set-up.
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
        // Initially disabled, so that it does not bite before the cycle feeds it: discovery takes
        // seconds. A running watchdog bites at this write (FACTS 12.1).
        let (at_first, again) = (WatchdogRegisters::DISABLED, WatchdogRegisters::LONGEST);
        r.image.opening(time, at_first, again);
        // Older firmware starts with a bite.
        r.image.closing(status, Some(0), 0);
        // If the board was reset in the middle of the set-up, the time is lost again, and this
        // write makes the watchdog bite. A disabled watchdog stays disabled (FACTS 12.1).
        let pet = WatchdogRegisters::PET;
        r.image.closing(reset, Some(pet), pet);
        Ok(Self {
            registers,
            pins,
            timeout_ns,
            shortest: r.settings.period.saturating_mul(2),
            usual_ns: r.settings.watchdog.is_none().then_some(timeout_ns),
            stage: WatchdogStage::Disabled,
            longest: 0,
            longest_time: Duration::ZERO,
            is_fed: false,
            fed: None,
            fed_by: Instant::default(),
            fed_before: None,
            confirmed: None,
            unconfirmed: None,
            starved: None,
            sent_from: None,
            status: r.image.read(Phase::Evidence, status),
            time_left: r.image.read(Phase::Evidence, time),
            // First, so that a board that was reset bites before it is given a time.
            pet: r.image.write(Phase::First, reset, WatchdogRegisters::PET),
            time: r.image.on_demand(time),
        })
    }

    /// Notes the start of a write that may restart the watchdog.
    pub(crate) fn sending(&mut self, now: Instant) {
        self.sent_from = Some(now);
    }

    /// The time without a write after which the watchdog bites, as set by the parameter at the last
    /// write.
    pub fn timeout(&self) -> Duration {
        Duration::from_nanos(self.timeout_ns.into())
    }

    /// The longest time that the register and the parameter have, in ns.
    fn longest_ns(&self) -> i64 {
        let longest = self.registers.timeout_of(WatchdogRegisters::LONGEST);
        let longest = longest.map_or(0, |longest| longest.as_nanos());
        i64::try_from(longest.min(u32::MAX.into())).unwrap_or(0)
    }

    /// The time with another period: that of the parameter, if the application has set it.
    pub(crate) fn time_at(&self, period: Duration, pins: &Pins) -> Duration {
        let set = pins.param(self.pins.timeout_ns);
        if self.usual_ns == Some(set) {
            usual_watchdog_time(period)
        } else {
            Duration::from_nanos(set.into())
        }
    }

    /// Takes a write outside the cycle, from its start to its end, which gives this time to the
    /// watchdog: what the board has from that is no sign of a reset, until the cycle has written
    /// its own time.
    pub(crate) fn fed_outside(&mut self, at: Instant, by: Instant, time: Duration, arrived: bool) {
        if self.stage == WatchdogStage::Running {
            self.stage = WatchdogStage::Held;
        }
        self.note_feed(Feed { at, time }, by, arrived);
    }

    /// Takes a write that restarted the watchdog, and its end.
    fn note_feed(&mut self, feed: Feed, by: Instant, arrived: bool) {
        let is_late = |fed: &Feed| feed.at >= fed.bitten_at();
        self.starved = self.starved.or(self.fed.filter(is_late));
        self.fed_before = self.fed.replace(feed);
        self.fed_by = by;
        if arrived {
            let [first, _] = self.unconfirmed.unwrap_or([feed; 2]);
            self.unconfirmed = Some([first, feed]);
        }
    }

    /// True if the evidence is that of a fresh set-up; the cycle then continues from there.
    pub(crate) fn set_up_restored(&mut self, words: &Words) -> bool {
        let time = words.word(self.time_left);
        let is_held = is_counting(time) && time > self.longest;
        let is_set_up = !has_bitten(words.word(self.status)) && is_held && words.evidence_matches();
        if is_set_up {
            self.stage = WatchdogStage::Held;
            (self.fed, self.confirmed) = (None, None);
            (self.unconfirmed, self.starved) = (None, None);
        }
        is_set_up
    }

    /// Evaluates the evidence of a read: returns the fault that it shows, or `None` if the set-up
    /// stands.
    pub(crate) fn examine(
        &mut self,
        &EvidenceRead {
            words,
            at: now,
            closely,
            is_certain,
        }: &EvidenceRead<'_>,
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
            WatchdogStage::Disabled => in_cycle || time == WatchdogRegisters::DISABLED,
            WatchdogStage::Held => is_counting(time),
            WatchdogStage::Running => in_cycle,
        };
        if !is_expected || closely && !words.evidence_matches() {
            return Some(BoardState::Reset);
        }
        if in_cycle {
            self.stage = WatchdogStage::Running;
        }
        if is_certain {
            (self.confirmed, self.unconfirmed, self.starved) = (self.fed, None, None);
        }
        None
    }

    /// True if the status shows a bite.
    pub(crate) fn shows_bite(&self, words: &Words) -> bool {
        has_bitten(words.word(self.status))
    }

    /// True if the evidence is that of a reset: no bite, and no time from a set-up.
    pub(crate) fn shows_reset(&self, words: &Words) -> bool {
        let (status, time) = (words.word(self.status), words.word(self.time_left));
        self.stage != WatchdogStage::Disabled
            && !has_bitten(status)
            && !WatchdogRegisters::runs(time)
    }

    /// Time from which on the board's pins are inputs, so that no frame reaches a remote: its
    /// watchdog has bitten by then, if no older write arrives late. `None` if the time that the
    /// board was given is not known.
    pub(crate) fn bitten_by(&self) -> Option<Instant> {
        self.fed?;
        (self.stage == WatchdogStage::Running).then(|| self.fed_by.after(self.longest_time))
    }

    /// Finds the cause of a bite. After a reset the next write makes the watchdog bite at once,
    /// without a time of its own; a bite of a board that was set up needs a silence longer than its
    /// time since a write that has arrived before it could bite.
    fn who_bit(&self, time: u32, now: Instant, is_certain: bool) -> BoardState {
        // The last write ended before the watchdog could bite, as each one before it.
        let is_in_time = |before: Feed| self.fed_by < before.bitten_at();
        let is_in_time = self.starved.is_none() && self.fed_before.is_none_or(is_in_time);
        let cannot_bite = if is_certain && is_in_time {
            self.fed.is_some_and(|fed| now < fed.bitten_at())
        } else {
            // Whatever time of the cycle is in use.
            let is_short = |fed: Feed| now.since(fed.at) < self.longest_time;
            !is_counting(time) && self.confirmed.is_some_and(is_short)
        };
        if cannot_bite {
            BoardState::Reset
        } else {
            BoardState::WatchdogBitten
        }
    }

    /// The last write before a bite that was found. `have_all_arrived`: all writes up to now have;
    /// otherwise that is taken of the first one after the last good evidence only.
    pub(crate) fn bitten_after(&self, have_all_arrived: bool) -> Option<LastFeed> {
        let fed = match self.unconfirmed {
            Some([_, last]) if have_all_arrived => Some(last),
            Some([first, _]) => Some(first),
            None => self.confirmed,
        };
        let is_last = have_all_arrived && self.starved.is_none();
        let feed = self.starved.or(fed)?;
        Some(LastFeed {
            at: feed.at,
            bitten_at: feed.bitten_at(),
            is_last,
        })
    }

    /// True if the application has cleared the bite.
    pub(crate) fn is_cleared(&self, pins: &Pins) -> bool {
        !pins.read(self.pins.has_bit).value
    }

    /// Publishes `has_bit`.
    pub(crate) fn show(&self, pins: &mut PinStore, has_bitten: bool) {
        pins.publish(self.pins.has_bit, has_bitten);
    }
}

impl Module for Watchdog {
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        let status = cycle.words.word(self.status);
        if status != NO_FPGA {
            cycle.show(self.pins.has_bit, has_bitten(status));
        }
    }

    fn set_period(&mut self, period: Duration, pins: &mut PinStore) -> Result<(), RegisterError> {
        self.shortest = period.saturating_mul(2);
        let time = self.time_at(period, pins);
        let nanos = u32::try_from(time.as_nanos()).unwrap_or(u32::MAX);
        if self.usual_ns == Some(pins.param(self.pins.timeout_ns)) {
            self.usual_ns = Some(nanos);
        }
        // The next write gives the watchdog this time.
        Ok(pins.set_param(self.pins.timeout_ns, nanos)?)
    }

    /// Restarts the watchdog, unless everything has to stay safe; and writes its time, if the
    /// watchdog has none yet, or the time has changed.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        let limit = Limit {
            setting: CorrectedValue::WatchdogTimeout,
            number: 0,
            lowest: i64::try_from(self.shortest.as_nanos()).unwrap_or(0),
            highest: self.longest_ns(),
            instead: None,
        };
        let timeout_ns = limit.param(cycle, self.pins.timeout_ns);
        let is_new = core::mem::replace(&mut self.timeout_ns, timeout_ns) != timeout_ns;
        self.is_fed = cycle.is_running;
        // A restart without a time would cause a bite.
        let is_restarted = self.is_fed && self.stage != WatchdogStage::Disabled;
        let word = if is_restarted {
            WatchdogRegisters::PET
        } else {
            0
        };
        cycle.words.put(self.pet, word);
        if !cycle.is_running || self.stage == WatchdogStage::Running && !is_new {
            return;
        }
        let time = self.registers.time_for(self.timeout().max(self.shortest));
        if time > self.longest {
            self.longest = time;
            let longest = self.registers.timeout_of(time);
            self.longest_time = longest.unwrap_or(self.longest_time);
        }
        cycle.words.set(self.time, time);
        cycle.words.repeat(self.time);
        cycle.request_extra();
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        // Without it, the write was omitted.
        let Some(sent_from) = self.sent_from.take() else {
            return;
        };
        if self.is_fed {
            let time = self.timeout().max(self.shortest);
            let feed = Feed {
                at: sent_from,
                time,
            };
            self.note_feed(feed, now, arrived);
        }
    }
}

/// True while the counter runs; it stops below 0.
fn is_counting(time: u32) -> bool {
    time != 0 && WatchdogRegisters::runs(time)
}

/// Status of an FPGA that has lost its configuration in the middle of the exchange, after its
/// identity was read. A bite sets a single bit.
const NO_FPGA: u32 = u32::MAX;

fn has_bitten(status: u32) -> bool {
    status & WatchdogRegisters::HAS_BIT != 0
}
