//! Whether the board is still the one that was set up: evidence that is read in every cycle.
//!
//! The evidence is two registers of the watchdog. Its *status* is set by a bite, and its *time*
//! reads what is left of it: 0x8000_0000 after a reset, 0xFFFF_FFFF after a bite, and otherwise no
//! more than was written (FACTS 12.1). No single exchange makes both look right again:
//!
//! - A write of the cycle restarts the watchdog, which bites if its time was never written.
//! - A write that holds a new time restarts it first, so that a reset shows in the status.
//! - The set-up clears the status and leaves a time that is longer than any that is used; only the
//!   write after it sets the true time.
//!
//! After whatever could have blurred this, the directions of the pins are read as well, which a
//! reset and a bite clear. All of it is read after the inputs: what was read before good evidence is
//! from a board that was set up.

use alloc::vec::Vec;

use crate::bus::{CycleImage, ImagePlan, Instant, ReadPhase, ReadSlot, Tier};
use crate::hostmot2::{Watchdog, WatchdogStatus, WatchdogTime};

/// What is known of the board's set-up.
#[derive(Debug)]
pub(super) struct Evidence {
    watchdog: Watchdog,
    stage: Stage,
    /// The longest time that was written in the cycle.
    longest: u32,
    status: Option<ReadSlot>,
    time: Option<ReadSlot>,
    directions: Vec<Directions>,
    /// When the watchdog was restarted last.
    fed: Option<Instant>,
}

/// The directions of a port.
#[derive(Clone, Copy, Debug)]
pub(super) struct Directions {
    address: u16,
    /// Pins that are outputs.
    pub outputs: u32,
    slot: Option<ReadSlot>,
}

/// What the watchdog's time register is expected to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// It was set up, and the cycle has not begun.
    Disabled,
    /// The board was set up again.
    Held,
    /// In the cycle.
    Running,
}

/// What the evidence says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Finding {
    /// The board is set up.
    Sound,
    /// The watchdog has bitten.
    Bitten,
    /// The board was reset.
    Reset,
}

impl Evidence {
    pub fn new(watchdog: Watchdog) -> Self {
        Self {
            watchdog,
            stage: Stage::Disabled,
            longest: 0,
            status: None,
            time: None,
            directions: Vec::new(),
            fed: None,
        }
    }

    /// The directions of all ports, in their order.
    pub fn watch(&mut self, directions: Vec<Directions>) {
        self.directions = directions;
    }

    pub fn claim(&mut self, plan: &mut ImagePlan) {
        let mut read = |tier, address| plan.read(ReadPhase::Evidence, tier, address, 1);
        self.status = Some(read(Tier::Cycle, self.watchdog.status));
        self.time = Some(read(Tier::Cycle, self.watchdog.time));
        for port in &mut self.directions {
            port.slot = Some(read(Tier::Evidence, port.address));
        }
    }

    /// The registers that show whether a set-up has arrived, in the order of
    /// [`is_set_up`](Self::is_set_up).
    pub fn registers(&self) -> impl Iterator<Item = u16> + '_ {
        let watchdog = [self.watchdog.status, self.watchdog.time];
        let directions = self.directions.iter().map(|port| port.address);
        watchdog.into_iter().chain(directions)
    }

    /// Whether these registers are as the set-up leaves them; if so, the cycle goes on from there.
    pub fn is_set_up(&mut self, words: &[u32]) -> bool {
        let [status, time, directions @ ..] = words else {
            return false;
        };
        let is_held = is_counting(*time) && *time > self.longest;
        let mut ports = directions.iter().zip(&self.directions);
        let is_set_up =
            !has_bitten(*status) && is_held && ports.all(|(word, port)| port.fits(*word));
        if is_set_up {
            self.stage = Stage::Held;
            self.fed = None;
        }
        is_set_up
    }

    /// What a read says. `tier` is that of the read; `is_certain`: all writes before have arrived.
    pub fn examine(
        &mut self,
        image: &CycleImage,
        tier: Tier,
        now: Instant,
        is_certain: bool,
    ) -> Finding {
        let word = |slot: Option<ReadSlot>| slot.and_then(|slot| image.word(slot));
        let (status, time) = (word(self.status), word(self.time));
        let (Some(status), Some(time)) = (status, time) else {
            return Finding::Reset;
        };
        if has_bitten(status) {
            return self.who_bit(time, now, is_certain);
        }
        let in_cycle = is_counting(time) && time <= self.longest;
        let is_expected = match self.stage {
            Stage::Disabled => in_cycle || time == WatchdogTime::DISABLED.0,
            Stage::Held => is_counting(time),
            Stage::Running => in_cycle,
        };
        let mut ports = self.directions.iter();
        let are_driven = tier == Tier::Cycle
            || ports.all(|port| word(port.slot).is_some_and(|word| port.fits(word)));
        if !is_expected || !are_driven {
            return Finding::Reset;
        }
        if in_cycle {
            self.stage = Stage::Running;
        }
        Finding::Sound
    }

    /// After a reset the next write makes the watchdog bite at once, without a time of its own; a
    /// bite of a board that was set up needs a silence that is longer than its time.
    fn who_bit(&self, time: u32, now: Instant, is_certain: bool) -> Finding {
        let timeout = self.watchdog.timeout_of(WatchdogTime(self.longest));
        let was_fed = |fed: Instant| timeout.is_some_and(|timeout| now.since(fed) < timeout);
        if !is_counting(time) && is_certain && self.fed.is_some_and(was_fed) {
            Finding::Reset
        } else {
            Finding::Bitten
        }
    }

    /// Whether the watchdog runs with a time of the cycle.
    pub fn is_in_cycle(&self) -> bool {
        self.stage == Stage::Running
    }

    /// Whether the watchdog has a time, so that it may be restarted.
    pub fn has_time(&self) -> bool {
        self.stage != Stage::Disabled
    }

    /// The watchdog is given this time with the next write.
    pub fn give(&mut self, time: WatchdogTime) {
        self.longest = self.longest.max(time.0);
    }

    /// The watchdog was restarted.
    pub fn fed(&mut self, at: Instant) {
        self.fed = Some(at);
    }

    /// The directions of a port, to change what is expected of them.
    pub fn port_mut(&mut self, port: usize) -> Option<&mut Directions> {
        self.directions.get_mut(port)
    }

    /// Whether the directions of a port were read as these, as far as this board reads them back.
    pub fn shows(&self, image: &CycleImage, port: usize, directions: u32) -> bool {
        self.directions.get(port).is_none_or(|port| {
            let word = port.slot.and_then(|slot| image.word(slot));
            word == Some(directions)
        })
    }
}

impl Directions {
    pub fn new(address: u16, outputs: u32) -> Self {
        Self {
            address,
            outputs,
            slot: None,
        }
    }

    fn fits(&self, word: u32) -> bool {
        word & self.outputs == self.outputs
    }
}

/// The watchdog's counter stops below 0.
fn is_counting(time: u32) -> bool {
    time != 0 && WatchdogTime(time).runs()
}

fn has_bitten(status: u32) -> bool {
    WatchdogStatus::from_bits_retain(status).contains(WatchdogStatus::HAS_BIT)
}
