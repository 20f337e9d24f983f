//! Who decides when a cycle begins: the host, or the board.

use core::time::Duration;

use crate::bus::{CycleImage, Instant, RegisterBus, Tier};

/// Who decides when a cycle begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Pace {
    /// The application: it waits for its own period, then calls [`Driver::read`].
    ///
    /// [`Driver::read`]: super::Driver::read
    #[default]
    Host,
    /// The board's clock. [`Driver::write`] asks for the next inputs at once, the board holds the
    /// request back until its DPLL begins the next period, and [`Driver::read`] returns when the
    /// inputs have come: the application has nothing to wait for.
    ///
    /// The inputs are sampled by the board's clock, whatever the host's scheduler does, and a
    /// timer less on the host makes the cycle cheaper. It needs a bus that can do it (Ethernet),
    /// and a firmware with a DPLL, which then runs free. [`Driver::wait_transfers`] has no place
    /// in such a cycle.
    ///
    /// A host that is late misses the beginning of a period, and gets the next:
    /// [`CycleReport::missed_periods`]. What it has left of a period is in
    /// [`CycleReport::slack`].
    ///
    /// Manual: 7I97, "SPACE 4 LBP TIMER/UTILITY AREA", WaitForHM2RefTime.
    ///
    /// [`CycleReport::missed_periods`]: super::CycleReport::missed_periods
    /// [`CycleReport::slack`]: super::CycleReport::slack
    /// [`Driver::read`]: super::Driver::read
    /// [`Driver::wait_transfers`]: super::Driver::wait_transfers
    /// [`Driver::write`]: super::Driver::write
    Board,
}

impl Pace {
    /// How long the board may hold the reads of a cycle back. Its timer comes once in a period,
    /// so that a longer wait means that it stands still.
    pub(super) fn held(self, period: Duration) -> Option<Duration> {
        (self == Self::Board).then_some(period * 5 / 4)
    }
}

/// Keeps the pace.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pacer {
    pace: Pace,
    period: Duration,
    /// What the board was asked for ahead.
    posted: Option<Tier>,
    /// When the last cycle began, ...
    begun: Option<Instant>,
    /// ... and when the last one with inputs did.
    arrived: Option<Instant>,
}

impl Pacer {
    pub fn new(pace: Pace, period: Duration) -> Self {
        Self {
            pace,
            period,
            posted: None,
            begun: None,
            arrived: None,
        }
    }

    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// What was asked for ahead, which is now taken.
    pub fn take_posted(&mut self) -> Option<Tier> {
        self.posted.take()
    }

    /// Asks for the next inputs, if the board paces.
    pub fn ask_ahead<B: RegisterBus>(&mut self, bus: &mut B, image: &CycleImage, tier: Tier) {
        if self.pace == Pace::Board {
            self.post(bus, image, tier);
        }
    }

    /// Asks for inputs ahead. If that fails, the next read asks again, and says why it fails.
    pub fn post<B: RegisterBus>(&mut self, bus: &mut B, image: &CycleImage, tier: Tier) {
        self.posted = image.post_reads(bus, tier).is_ok().then_some(tier);
    }

    /// A cycle has begun. When its read failed without waiting, the rest of the period is waited
    /// for here: nobody else would, and the application's loop would spin.
    pub fn begun<B: RegisterBus>(&mut self, bus: &mut B, failed: bool) {
        let now = bus.now();
        if let (Pace::Board, true, Some(before)) = (self.pace, failed, self.begun) {
            let left = before.after(self.period).since(now);
            if !left.is_zero() {
                bus.wait(left);
            }
        }
        self.begun = Some(bus.now());
    }

    /// Inputs have arrived: how many periods went by without any.
    pub fn arrived(&mut self, now: Instant) -> u64 {
        let before = self.arrived.replace(now);
        let (Pace::Board, Some(before)) = (self.pace, before) else {
            return 0;
        };
        let period = self.period.as_nanos().max(1);
        let passed = (now.since(before).as_nanos() + period / 2) / period;
        u64::try_from(passed.saturating_sub(1)).unwrap_or(u64::MAX)
    }
}
