//! The write of a cycle: which exchange comes next.

use super::{BoardCycle, BoardState, EventKind, Evidence};
use crate::bus::{BusErrorKind, CycleWrites, Instant};
use crate::modules::{Module, WriteCycle};
use crate::tally::Tally;

/// Form of a cycle's write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::driver) struct CycleWrite {
    /// The next read includes the extra registers.
    pub extra: bool,
    /// What is written besides the registers of every cycle.
    pub writes: CycleWrites,
}

/// The next exchange of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "the board waits for it"]
pub(in crate::driver) enum Order {
    /// The whole set-up, if the same firmware still answers. Then [`BoardCycle::put`].
    SetUp,
    /// Settings that drive pins, between two checks of the evidence. Then [`BoardCycle::guarded`].
    Guarded,
    /// All pins become inputs, because the board was found in the middle of this write to be not set
    /// up. Then [`BoardCycle::quiesced`].
    Quiesce,
    /// The writes of every cycle. Then [`BoardCycle::sent`] or [`BoardCycle::write_failed`].
    Cycle(CycleWrite),
    /// No further exchange.
    Nothing,
}

impl BoardCycle {
    /// Begins a write.
    pub fn write(&mut self, now: Instant) -> Order {
        self.statistics.writes.tally(1);
        self.count_write(now);
        let quiet = self.quiet_writes;
        self.quiet_writes = quiet.saturating_sub(1);
        self.fetch_flags();
        if quiet == 0 && self.is_set_up_wanted {
            Order::SetUp
        } else {
            self.put(now)
        }
    }

    /// Handles a write without a preceding read: inputs age as after a failed read.
    fn count_write(&mut self, now: Instant) {
        let missed = self.writes_since_read;
        self.writes_since_read = missed.saturating_add(1);
        if missed == 0 || self.is_last {
            return;
        }
        self.pins.begin_cycle(now);
        self.not_read();
        if missed == self.pins.stale_after() {
            let writes = self.writes_since_read;
            self.events.tell(now, EventKind::NotRead { writes });
            self.cancel_rearm(now, true);
            self.make_safe();
        }
    }

    /// Takes whether the application has cleared the flag of the fault that made everything safe, and
    /// thereby asks for the set-up; setting the flag again withdraws that.
    fn fetch_flags(&mut self) {
        // A flag that does not show the present fault yet was not cleared.
        if self.is_running() || self.shown != Some(self.state) {
            return;
        }
        self.is_set_up_wanted = if self.has_error() {
            self.parts.connection.is_cleared(&self.pins)
        } else {
            self.parts.watchdog.is_cleared(&self.pins)
        };
    }

    /// Asks for the set-up that the board has lost; the flags of the fault are cleared.
    pub(super) fn want_set_up(&mut self) {
        self.is_set_up_wanted = true;
        self.parts.watchdog.show(&mut self.pins, false);
        self.parts.connection.show(&mut self.pins, false);
    }

    /// Lets every module put its outputs into the image.
    pub fn put(&mut self, now: Instant) -> Order {
        if self.state == BoardState::OtherFirmware {
            // The meaning of its registers is unknown.
            self.written(now, false);
            return Order::Nothing;
        }
        let is_running = self.is_running();
        let mut cycle = WriteCycle {
            words: &mut self.words,
            pins: &mut self.pins,
            now,
            // A board that is not set up gets its set-up as a whole, and no part of it before.
            hold: !is_running || self.is_last,
            changed: true,
            is_running,
            wants_extra: false,
            events: &self.events,
        };
        self.parts.watchdog.write(&mut cycle);
        for port in &mut self.parts.ports {
            port.write(&mut cycle);
        }
        for part in &mut self.parts.modules {
            let version = cycle.pins.output_version(part.group);
            cycle.changed = version.is_none() || version != part.version;
            part.version = version;
            part.module.write(&mut cycle);
        }
        self.wants_extra = cycle.wants_extra;
        if is_running && self.words.has_guarded_news() {
            self.look_closely();
            return Order::Guarded;
        }
        self.keep_quiet(now, is_running)
    }

    /// Continues after settings that drive pins were written, or were not, because the board is not
    /// set up any more. Settings that did not arrive are written again with the next write.
    pub fn guarded(&mut self, now: Instant) -> Order {
        self.keep_quiet(now, true)
    }

    /// Orders that all pins become inputs in each cycle in which the board is known not to be set
    /// up, so that late packets drive them for a cycle at most. `has_run`: the board ran when the
    /// write began.
    ///
    /// After settings that drive pins nothing is written before evidence is read: a board that has
    /// bitten meanwhile drives them until its watchdog bites again, which each write would put off.
    fn keep_quiet(&mut self, now: Instant, has_run: bool) -> Order {
        let writes = match self.state {
            BoardState::Running if self.evidence == Evidence::Unproven && !self.is_last => {
                return self.nothing(now);
            }
            BoardState::Running => CycleWrites::Settings,
            BoardState::WatchdogBitten | BoardState::Reset if has_run => return Order::Quiesce,
            BoardState::BusDown | BoardState::OtherFirmware if has_run => return self.nothing(now),
            BoardState::WatchdogBitten | BoardState::Reset => CycleWrites::Inputs,
            BoardState::BusDown | BoardState::OtherFirmware => CycleWrites::Quiet,
        };
        Order::Cycle(CycleWrite {
            extra: self.wants_closer_look(),
            writes,
        })
    }

    /// Ends the write when all pins are inputs.
    pub fn quiesced(&mut self, now: Instant) -> Order {
        self.nothing(now)
    }

    /// Ends a write whose words, which were put, are not written.
    #[cold]
    fn nothing(&mut self, now: Instant) -> Order {
        self.written(now, false);
        self.publish();
        Order::Nothing
    }

    /// Notes the begin of the cycle's write.
    pub fn sending(&mut self, now: Instant) {
        self.parts.watchdog.sending(now);
        for port in &mut self.parts.ports {
            port.sending(now);
        }
    }

    /// Handles the cycle's write that was sent.
    pub fn sent(&mut self, now: Instant) {
        self.written(now, true);
        self.write_failures = 0;
    }

    /// Handles a cycle's write that failed as a whole; returns the number of consecutive ones.
    pub fn write_failed(&mut self, now: Instant, why: BusErrorKind) -> u32 {
        self.written(now, false);
        self.statistics.write_errors.tally(1);
        self.look_closely();
        let (kind, row) = (EventKind::WriteFailed { why }, &mut self.rows.failed_writes);
        row.add(&self.events, now, 1, kind);
        self.write_failures = self.write_failures.saturating_add(1);
        if self.parts.connection.count_exchange(&mut self.pins, true) {
            self.fail(now, BoardState::BusDown);
            self.publish();
        }
        self.write_failures
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        for part in self.parts.each() {
            part.written(now, arrived);
        }
    }

    /// Notes that settings that drive pins are about to be sent.
    pub fn sending_guarded(&mut self, now: Instant) {
        self.evidence = Evidence::Unproven;
        self.parts.watchdog.sending(now);
    }

    /// Notes that these settings were sent.
    pub fn sent_guarded(&mut self, now: Instant) {
        self.parts.watchdog.written(now, true);
    }

    /// Confirms these settings, after good evidence.
    pub fn confirm_guarded(&mut self) {
        if self.is_running() {
            self.words.guarded_sent();
        }
    }
}
