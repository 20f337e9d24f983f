//! The write of a cycle: which exchange comes next.

use super::order::{CycleWrite, Exchange, Guard, Next, Outcome, Purpose, Separate, Then};
use super::{BoardCycle, Evidence};
use crate::bus::{CycleWrites, Instant};
use crate::driver::{BoardState, CycleError, EventKind};
use crate::hal::ArmingEvent;
use crate::modules::{Module, WriteCycle};
use crate::tally::Tally;

impl BoardCycle {
    /// Begins a write. A failed exchange before the last one is repeated with the next write; this
    /// one continues without it.
    pub fn begin_write(&mut self, now: Instant) -> Next {
        self.statistics.writes.tally(1);
        self.count_write(now);
        let quiet = self.quiet_writes;
        self.quiet_writes = quiet.saturating_sub(1);
        self.fetch_flags();
        if quiet == 0 && self.is_set_up_wanted {
            self.begin_set_up_for(now, Purpose::Write)
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
            self.events.report(now, EventKind::NotRead { writes });
            self.cancel_rearm(now, ArmingEvent::Cancel);
            self.make_safe();
        }
    }

    /// Takes whether the application has cleared the flag of the fault that made everything safe,
    /// and thereby asks for the set-up; setting the flag again withdraws that.
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
    pub(super) fn put(&mut self, now: Instant) -> Next {
        if self.state == BoardState::OtherFirmware {
            // The meaning of its registers is unknown.
            self.written(now, false);
            return Next::End(Ok(()));
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
        if is_running && self.words.has_guarded_pending() {
            self.look_closely();
            return Next::separate(Separate::Evidence, Then::Guard(Guard::Before));
        }
        self.hold_inputs_only(now, is_running)
    }

    /// Continues with settings that drive pins. They could drive pins that the rest of the set-up
    /// protects, so the evidence of the set-up is read before and after them. Settings that did not
    /// arrive are written again with the next write.
    pub(super) fn after_guard(&mut self, step: &Guard, outcome: Outcome, now: Instant) -> Next {
        if let Guard::Settings = step {
            self.evidence = Evidence::Unproven;
            self.parts.watchdog.sending(outcome.from);
        } else {
            self.asked = outcome.from;
        }
        if outcome.result.is_err() {
            return self.hold_inputs_only(now, true);
        }
        match step {
            Guard::Before => {
                self.evidence_read(now);
                if self.is_running() {
                    return Next::separate(Separate::Guarded, Then::Guard(Guard::Settings));
                }
            }
            Guard::Settings => {
                self.parts.watchdog.written(now, true);
                return Next::separate(Separate::Evidence, Then::Guard(Guard::After));
            }
            Guard::After => {
                self.evidence_read(now);
                if self.is_running() {
                    self.words.guarded_sent();
                }
            }
        }
        self.hold_inputs_only(now, true)
    }

    /// Orders that all pins become inputs in each cycle in which the board is known not to be set
    /// up, so that late packets drive them for a cycle at most. `has_run`: the board ran when the
    /// write began.
    ///
    /// After settings that drive pins nothing is written before evidence is read: a board that has
    /// bitten meanwhile drives them until its watchdog bites again, which each write would put off.
    fn hold_inputs_only(&mut self, now: Instant, has_run: bool) -> Next {
        let writes = match self.state {
            BoardState::Running if self.evidence == Evidence::Unproven && !self.is_last => {
                return self.end_without_write(now);
            }
            BoardState::Running => CycleWrites::Settings,
            BoardState::WatchdogBitten | BoardState::Reset if has_run => {
                return Next::separate(Separate::Quiesce, Then::Release);
            }
            BoardState::BusDown | BoardState::OtherFirmware if has_run => {
                return self.end_without_write(now);
            }
            BoardState::WatchdogBitten | BoardState::Reset => CycleWrites::Inputs,
            BoardState::BusDown | BoardState::OtherFirmware => CycleWrites::Quiet,
        };
        let extra = self.wants_closer_look();
        Next::order(Exchange::Write(CycleWrite { extra, writes }), Then::Write)
    }

    /// Ends a write whose words, which were put, are not written.
    #[cold]
    pub(super) fn end_without_write(&mut self, now: Instant) -> Next {
        self.written(now, false);
        self.publish();
        Next::End(Ok(()))
    }

    /// Handles the cycle's write, which was sent or failed as a whole.
    pub(super) fn after_write(&mut self, outcome: Outcome, now: Instant) -> Result<(), CycleError> {
        self.parts.watchdog.sending(outcome.from);
        for port in &mut self.parts.ports {
            port.sending(outcome.from);
        }
        self.written(now, outcome.result.is_ok());
        let Err(source) = outcome.result else {
            self.write_failures = 0;
            return Ok(());
        };
        self.statistics.write_errors.tally(1);
        self.look_closely();
        let why = source.kind();
        let (kind, row) = (EventKind::WriteFailed { why }, &mut self.rows.failed_writes);
        row.add(&self.events, now, 1, kind);
        self.write_failures = self.write_failures.saturating_add(1);
        if self.parts.connection.count_exchange(&mut self.pins, true) {
            self.fail(now, BoardState::BusDown);
            self.publish();
        }
        Err(CycleError::Write {
            source,
            consecutive: self.write_failures,
        })
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        for part in self.parts.each() {
            part.written(now, arrived);
        }
    }
}
