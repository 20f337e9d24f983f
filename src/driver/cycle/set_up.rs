//! The set-up that a board has lost, step by step.
//!
//! If the evidence shows the set-up at its end, the board runs, and so does its watchdog; otherwise
//! the state is unchanged. Another firmware gets no part of it, because its registers have other
//! meanings, and its pins other wires.

use super::BoardCycle;
use super::order::{Next, Outcome, Purpose, Separate, SetUp, SetUpStep, Then};
use crate::bus::{BusError, Instant};
use crate::driver::{BoardState, CycleError, EventKind};
use crate::hal::ArmingEvent;

impl SetUp {
    /// Orders the exchange of the next step.
    fn next(self, step: SetUpStep) -> Next {
        let exchange = match &step {
            SetUpStep::Status { .. } => Separate::Status,
            SetUpStep::Firmware { .. } => Separate::Firmware,
            SetUpStep::Survey => Separate::Everything,
            SetUpStep::Renewal => Separate::Renewal,
            SetUpStep::Whole => Separate::SetUp,
            SetUpStep::Release(_) => Separate::Quiesce,
        };
        Next::separate(exchange, Then::SetUp(Self { step, ..self }))
    }
}

impl BoardCycle {
    /// Begins the set-up of a board that has lost it. Its last step arms nothing.
    pub fn begin_set_up(&self, now: Instant) -> Next {
        self.begin_set_up_for(now, Purpose::Rearming)
    }

    /// Begins to identify the board that answers. The result is
    /// [`NotThere`](CycleError::NotThere) if no `HostMot2` does, as during a reset, and
    /// [`OtherFirmware`](CycleError::OtherFirmware) if another board or firmware does.
    pub fn begin_identification(&self, now: Instant) -> Next {
        self.begin_set_up_for(now, Purpose::Identification)
    }

    /// An FPGA without its configuration could get it back in the middle of an exchange, and take
    /// the end of the set-up, which drives the pins, without its beginning: so the status is read
    /// alone before anything else.
    pub(super) fn begin_set_up_for(&self, begun: Instant, purpose: Purpose) -> Next {
        debug_assert!(!self.is_running(), "a board that runs has its set-up");
        let step = SetUpStep::Survey;
        let set_up = SetUp {
            begun,
            purpose,
            step,
        };
        set_up.next(SetUpStep::Status { is_repeated: false })
    }

    /// Continues a set-up.
    pub(super) fn after_set_up(&mut self, set_up: SetUp, outcome: Outcome, now: Instant) -> Next {
        match (&set_up.step, outcome.result) {
            (SetUpStep::Renewal, Ok(())) => {
                self.evidence_read(now);
                let is_set_up = self.is_standing();
                self.after_writing(set_up, Ok(()), is_set_up, now)
            }
            (SetUpStep::Whole, Ok(())) => {
                let is_set_up = self.parts.watchdog.set_up_restored(&self.words);
                self.after_writing(set_up, Ok(()), is_set_up, now)
            }
            (SetUpStep::Renewal | SetUpStep::Whole, failed) => {
                self.after_writing(set_up, failed, false, now)
            }
            (SetUpStep::Release(result), _) => {
                // What failed here is tried again with the next write.
                let result = *result;
                self.outage.has_released = true;
                self.end_set_up(&set_up, result, now)
            }
            (_, Err(error)) => self.end_set_up(&set_up, Err(error), now),
            (&SetUpStep::Status { is_repeated }, Ok(())) => match self.check() {
                Ok(()) => set_up.next(SetUpStep::Firmware { is_repeated }),
                Err(found) => self.absent(&set_up, found, now),
            },
            (&SetUpStep::Firmware { is_repeated }, Ok(())) => {
                self.after_comparison(set_up, is_repeated, outcome.is_same, now)
            }
            (SetUpStep::Survey, Ok(())) => {
                // The set-up would hide that the board was reset while it did not answer, and what
                // its counters show of that.
                self.asked = outcome.from;
                self.evidence_read(now);
                self.run_on(now);
                set_up.next(if self.is_standing() {
                    SetUpStep::Renewal
                } else {
                    SetUpStep::Whole
                })
            }
        }
    }

    /// Continues after the comparison of the firmware. A read around a reset is no evidence of
    /// another one, so that is read twice.
    fn after_comparison(
        &mut self,
        set_up: SetUp,
        is_repeated: bool,
        is_same: bool,
        now: Instant,
    ) -> Next {
        if is_same && set_up.purpose == Purpose::Identification {
            Next::End(Ok(()))
        } else if is_same {
            set_up.next(SetUpStep::Survey)
        } else if is_repeated {
            self.other_firmware(now);
            self.end_with(set_up.purpose, Err(CycleError::OtherFirmware), now)
        } else {
            set_up.next(SetUpStep::Status { is_repeated: true })
        }
    }

    /// Ends with nothing written, because no `HostMot2` answers.
    fn absent(&mut self, set_up: &SetUp, found: u32, now: Instant) -> Next {
        let absent = CycleError::NotThere {
            found,
            consecutive: 1,
        };
        let result = match set_up.purpose {
            Purpose::Identification => Err(absent),
            Purpose::Rearming | Purpose::Write => Ok(()),
        };
        self.end_with(set_up.purpose, result, now)
    }

    /// Continues after the set-up was written, or was not. A board that does not show it may be set
    /// up with a watchdog that is not fed, or drive pins without one: all pins are let go of.
    fn after_writing(
        &mut self,
        set_up: SetUp,
        result: Result<(), BusError>,
        is_set_up: bool,
        now: Instant,
    ) -> Next {
        if !is_set_up {
            return set_up.next(SetUpStep::Release(result));
        }
        self.set_up_restored(set_up.begun);
        self.end_set_up(&set_up, Ok(()), now)
    }

    fn end_set_up(&mut self, set_up: &SetUp, result: Result<(), BusError>, now: Instant) -> Next {
        let result = result.map_err(|source| CycleError::Write {
            source,
            consecutive: self.write_failures.saturating_add(1),
        });
        self.end_with(set_up.purpose, result, now)
    }

    /// Ends the set-up. A write continues whatever its result is, and repeats it with the next one.
    fn end_with(&mut self, purpose: Purpose, result: Result<(), CycleError>, now: Instant) -> Next {
        match purpose {
            Purpose::Write => self.put(now),
            Purpose::Identification | Purpose::Rearming => Next::End(result),
        }
    }

    /// True if the board still has its set-up, as its evidence has just shown: only the bus was
    /// down.
    fn is_standing(&self) -> bool {
        self.state == BoardState::BusDown && self.outage.has_kept_set_up()
    }

    /// Continues with a board that has its set-up back, which was begun at `now`.
    fn set_up_restored(&mut self, now: Instant) {
        self.words.all_set();
        self.look_closely();
        let outage = core::mem::take(&mut self.outage);
        for part in self.parts.each() {
            part.set_up_again(&mut self.pins, now, &outage);
        }
        (self.state, self.is_set_up_wanted) = (BoardState::Running, false);
        self.pins.change_all_arming(ArmingEvent::SetUp);
        self.events.report(now, EventKind::BoardSetUp);
        self.parts.connection.level = 0;
        self.old_read_errors = self.statistics.read_errors;
        self.write_failures = 0;
    }

    /// Handles another firmware that answers. The application has to clear the flag before the
    /// board is checked again.
    fn other_firmware(&mut self, now: Instant) {
        self.outage.was_replaced = true;
        let state = BoardState::OtherFirmware;
        if core::mem::replace(&mut self.state, state) != state {
            self.events.report(now, EventKind::OtherFirmware);
        }
        self.cancel_rearm(now, ArmingEvent::Cancel);
        self.is_set_up_wanted = false;
        // Sets the flag again, even if it was published before.
        self.shown = None;
        self.publish();
    }
}
