//! A generator of a board that is not set up.

use super::{Generator, STEP_PER_TICK};
use crate::bus::Instant;
use crate::modules::stepgen::counts::{AMBIGUOUS, Expected, SUB_COUNTS};
use crate::modules::{Outage, RunOnCycle};

/// The last read of the accumulators.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::modules::stepgen) struct LastRead {
    /// Time of its request.
    pub asked: Instant,
    /// Arrival of its reply.
    pub at: Instant,
}

impl Generator {
    /// Follows the accumulator as long as the pins are outputs. `last`: the last read of it.
    pub fn run_on(&mut self, cycle: &RunOnCycle<'_>, last: LastRead) {
        let outage = cycle.outage;
        let is_lost = outage.was_reset || outage.was_replaced;
        if is_lost || self.is_released || !self.counts.has_begun() {
            return;
        }
        let accumulator = cycle.words.word(self.registers.accumulator);
        let gap = cycle.now.since(last.asked);
        let fastest = self.steps_per_second(self.rate.fastest());
        if !outage.has_released {
            self.counts.observe_gap(gap, fastest);
            self.counts.read(accumulator);
            return;
        }
        self.is_released = true;
        let is_ambiguous = gap.as_secs_f64() * fastest >= AMBIGUOUS;
        let expected = self.until_released(outage, cycle.now, last, is_ambiguous);
        self.counts.released(accumulator, expected);
    }

    /// The movement of the motor from the last read on, until a bite released its pins.
    /// `is_ambiguous`: the accumulator may have wrapped around since.
    fn until_released(
        &self,
        outage: &Outage,
        now: Instant,
        last: LastRead,
        is_ambiguous: bool,
    ) -> Expected {
        let Some(feed) = outage.last_feed else {
            return if is_ambiguous {
                Expected::ByTime(0)
            } else {
                Expected::Within(0)
            };
        };
        let sent = self.rate.sent();
        let [before, first, newest] =
            [sent.before, sent.first, sent.last].map(|word| self.speed(word));
        // A read from after the bite would have shown it: the host was suspended with the reply.
        let is_old = last.at > feed.bitten_at;
        let from = if is_old { last.asked } else { last.at };
        let is_after = feed.at > from || !is_old && feed.at == from;
        let speed = if is_after { first } else { before };
        let ran = feed.bitten_at.since(from).as_secs_f64();
        let by_time = (speed * ran) as i64;
        if is_ambiguous {
            return Expected::ByTime(by_time);
        }
        if !feed.is_last || self.rate.has_failed() {
            return Expected::Within(by_time);
        }
        // The driver stops it when it knows of the outage, before the bite or after it.
        let until = sent.stopped_at.unwrap_or(now);
        if until < feed.bitten_at {
            return Expected::Beyond(0);
        }
        let gap = until.since(from).as_secs_f64();
        if sent.is_one() {
            Expected::Changed {
                speeds: [before, first],
                ran,
                gap,
            }
        } else {
            Expected::Beyond((newest * (gap - ran)) as i64)
        }
    }

    /// The speed of a word in sub-counts per second.
    fn speed(&self, word: i32) -> f64 {
        f64::from(word) / STEP_PER_TICK * f64::from(self.clock_hz) * SUB_COUNTS
    }
}
