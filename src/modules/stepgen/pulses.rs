//! A change of the pulses: written at rest, and confirmed by a read before anything moves.

use super::pins::PulseSetup;
use crate::bus::{HORIZON, Instant};

/// Least number of reads for which a generator must have stood still to be at rest.
const STILL_READS: u32 = 2;

/// Progress of a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ChangeProgress {
    /// The board has the pulses.
    Settled,
    /// They are in the words of the next write.
    Written,
    /// They were sent, and no read has confirmed them yet.
    Sent,
}

/// The pulses that the board makes, and those that the parameters ask for.
#[derive(Debug)]
pub(super) struct PulseChange {
    board: PulseSetup,
    wanted: PulseSetup,
    progress: ChangeProgress,
    /// Number of further reads during which a packet of the last set-up may be in flight: executed
    /// again, it would cut a pulse off, or begin a table from its first entry.
    set_up_for: u32,
    /// Time and number of reads for which the generator has stood still with a rate of 0.
    still: Option<(Instant, u32)>,
    /// It has stood still for so long that no timer of a step runs.
    rests: bool,
    /// The two differ.
    is_due: bool,
}

impl PulseChange {
    /// The pulses with which the board is set up.
    pub fn new(pulses: PulseSetup) -> Self {
        Self {
            board: pulses,
            wanted: pulses,
            progress: ChangeProgress::Settled,
            set_up_for: HORIZON.into(),
            still: None,
            rests: true,
            is_due: false,
        }
    }

    /// The pulses that the board makes.
    pub const fn board(&self) -> &PulseSetup {
        &self.board
    }

    /// Asks for pulses.
    pub fn want(&mut self, pulses: PulseSetup) {
        self.wanted = pulses;
        self.is_due = self.board != self.wanted;
    }

    /// True if the board does not make the pulses that the parameters ask for.
    pub const fn is_due(&self) -> bool {
        self.is_due
    }

    /// True if no change is under way.
    pub fn is_settled(&self) -> bool {
        !self.is_due && self.progress == ChangeProgress::Settled
    }

    /// True if nothing may begin to move: a change has to be confirmed, or waits for the rest of a
    /// generator that `stands`. A table is not used as long as it may be written again.
    pub fn holds(&self, stands: bool) -> bool {
        self.progress != ChangeProgress::Settled
            || stands && (self.is_due || self.board.is_table() && self.set_up_for > 0)
    }

    /// The board has its set-up again, and the rate is 0.
    pub fn restored(&mut self) {
        (self.rests, self.still, self.set_up_for) = (false, None, HORIZON.into());
    }

    /// The words of a write have been sent.
    pub const fn sent(&mut self) {
        if matches!(self.progress, ChangeProgress::Written) {
            self.progress = ChangeProgress::Sent;
        }
    }

    /// Takes a read. Returns true if a packet of the set-up may have been executed again since the
    /// last one.
    pub fn read(&mut self, certain: bool) -> bool {
        if certain && self.progress == ChangeProgress::Sent {
            self.progress = ChangeProgress::Settled;
        }
        let is_recent = self.set_up_for > 0;
        if is_recent {
            // After doubts all recent settings are written again, the table among them.
            self.set_up_for = if certain || !self.board.is_table() {
                self.set_up_for.saturating_sub(1)
            } else {
                HORIZON.into()
            };
        }
        is_recent && !certain
    }

    /// Takes a read in which the generator `is_still` with a rate of 0.
    pub fn observe_rest(&mut self, now: Instant, is_still: bool, clock_hz: u32) {
        if !is_still {
            (self.still, self.rests) = (None, false);
            return;
        }
        if self.rests {
            return;
        }
        let (since, reads) = self.still.unwrap_or((now, 0));
        let reads = reads.saturating_add(1);
        self.still = Some((since, reads));
        let settling = self.board.ticks.settling(clock_hz);
        self.rests = reads > STILL_READS && now.since(since).as_secs_f64() >= settling;
    }

    /// The pulses to write in place of others, once the generator rests: `(before, after)`.
    pub fn take(&mut self) -> Option<(PulseSetup, PulseSetup)> {
        if !self.is_due || !self.rests {
            return None;
        }
        let before = core::mem::replace(&mut self.board, self.wanted);
        self.is_due = false;
        self.progress = ChangeProgress::Written;
        self.set_up_for = HORIZON.into();
        Some((before, self.wanted))
    }
}

#[cfg(test)]
mod tests {
    use super::super::pins::PulseSetup;
    use super::super::timing::{PulseTicks, PulseTimes};
    use super::*;

    const CLOCK: u32 = 100_000_000;

    fn pulses(step_len: u32, mode: u32) -> PulseSetup {
        let times = PulseTimes {
            step_len,
            step_space: 163_000,
            dir_setup: 163_000,
            dir_hold: 1_000,
        };
        PulseSetup {
            ticks: PulseTicks::new(times, CLOCK),
            mode,
            table: [0; 16],
            table_max: 0,
        }
    }

    fn at(micros: u64) -> Instant {
        Instant::from_nanos(micros * 1_000)
    }

    /// 163 us of space and 163 us of set-up may still run, however many reads pass meanwhile.
    #[test]
    fn generator_rests_when_no_timer_runs_any_more() {
        let mut change = PulseChange::new(pulses(2_000, 0));
        change.observe_rest(at(0), false, CLOCK);
        change.want(pulses(3_000, 0));
        for read in 0..10 {
            change.observe_rest(at(10 + read * 20), true, CLOCK);
            assert_eq!(change.take(), None, "{read}");
        }
        change.observe_rest(at(400), true, CLOCK);
        let (before, after) = change.take().expect("it rests");
        assert_eq!((before.ticks.step_len, after.ticks.step_len), (200, 300));
        assert_eq!(change.take(), None, "once");
    }

    #[test]
    fn change_is_confirmed_by_a_certain_read_after_it_was_sent() {
        let mut change = PulseChange::new(pulses(2_000, 0));
        change.want(pulses(3_000, 0));
        assert!(change.take().is_some() && change.holds(true) && change.holds(false));
        change.read(true);
        assert!(change.holds(false), "not sent yet");
        change.sent();
        assert!(change.read(false) && change.holds(false), "in doubt");
        change.read(true);
        assert!(!change.holds(true) && change.is_settled());
    }

    #[test]
    fn no_motion_starts_before_a_pending_pulse_change() {
        let mut change = PulseChange::new(pulses(2_000, 0));
        change.observe_rest(at(0), false, CLOCK);
        change.want(pulses(3_000, 0));
        assert!(change.holds(true));
        assert!(!change.holds(false), "it brakes first");
        change.want(pulses(2_000, 0));
        assert!(!change.holds(true), "taken back");
    }

    /// A doubt within that time writes it again.
    #[test]
    fn table_is_used_when_it_cannot_be_written_again() {
        let mut change = PulseChange::new(pulses(2_000, 0));
        change.want(pulses(2_000, 3));
        change.take().expect("it rests");
        change.sent();
        for read in 0..150 {
            assert!(change.holds(true), "{read}");
            change.read(read != 50);
        }
        change.read(true);
        assert!(!change.holds(true));
        change.restored();
        assert!(change.holds(true));
    }

    #[test]
    fn doubt_matters_while_a_set_up_may_be_in_flight() {
        let mut change = PulseChange::new(pulses(2_000, 0));
        for _ in 0..99 {
            assert!(!change.read(true));
        }
        assert!(change.read(false));
        assert!(!change.read(false));
    }
}
