//! State of one encoder: counts, index and velocity.

use core::mem::{replace, take};

use super::command::EncoderCommand;
use super::latch::{Latch, Movement};
use super::reach::Reach;
use super::registers::bits;
use super::velocity::{CountStep, VelocityEstimator};
use crate::bus::{HORIZON, Instant};
use crate::modules::Outage;
use crate::modules::doubt::PositionDoubt;
use crate::modules::latch::LatchRequest;

/// The registers of one encoder, as read in one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct EncoderSample {
    /// The count register.
    pub count: u32,
    /// The control register.
    pub control: u32,
    /// The low 16 bits of the time-stamp counter.
    pub timestamp: u16,
    /// Time of the request, before which the registers were not read.
    pub asked: Instant,
    /// Time of the exchange.
    pub at: Instant,
}

/// Configuration of an encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncoderConfig {
    /// The control word, without any latch or clear.
    pub mode: u32,
    /// Counts for one unit of position: finite and nonzero.
    pub scale: f64,
    /// Time without a count after which velocity is 0, in seconds.
    pub idle_time: f64,
}

/// Rates of an encoder, per second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncoderRates {
    /// Rate of the time stamps.
    pub tick_hz: f64,
    /// Rate of the samples, which is also the upper limit of the count rate.
    pub sample_hz: f64,
}

/// Reliability of the counts between two reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CountEvidence {
    Certain,
    /// The select line of multiplexed encoders may have been released.
    Unsure,
    /// The counter may have wrapped around: the distance to a latched count is unknown.
    Lost,
}

/// The values of an encoder after a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(
    clippy::struct_excessive_bools,
    reason = "independent conditions, each shown on its own"
)]
#[non_exhaustive]
pub struct EncoderReading {
    /// Counts since the start, independent of reset and index.
    pub rawcounts: i64,
    /// Counts since the last reset or index.
    pub count: i64,
    /// `count / scale`, in units of position.
    pub position: f64,
    /// `position`, and the way since the last count at the present velocity: less than a count.
    pub interpolated: f64,
    /// In units of position per second.
    pub velocity: f64,
    /// Counts for one unit of position.
    pub scale: f64,
    /// `count` at the last requested latch; kept until the next one.
    pub latched: Option<i64>,
    /// The requested index was latched in this read.
    pub index_came: bool,
    /// Both inputs changed at once while error detection was on: counts may be wrong. Kept until
    /// detection is turned off.
    pub quadrature_error: bool,
    /// `count` may be wrong, for one of these reasons:
    /// - The board was reset or lost its power; or its watchdog has bitten, and its registers do
    ///   not show that it was not reset before.
    /// - The encoder is multiplexed, and its select line was released: by a bite, by the set-up
    ///   that follows one, or by an exchange in doubt within 100 reads after that. `count` is then
    ///   the best estimate.
    /// - In the time between two reads it can have moved by 32768 counts or more: with half as much
    ///   again as its last speed and acceleration, and 1000 counts a second. If its last edge is
    ///   still the same, it has not moved.
    /// - The encoder was near the highest rate that can be followed, and seemed to stop from one
    ///   read to the next, as it does beyond that rate.
    ///
    /// Kept until the next reset, the next index latched between two reads without such doubt or
    /// gap, or the next rising edge of `homed`.
    pub is_unsure: bool,
    /// The encoder turns at nine tenths or more of the highest rate that can be followed: beyond
    /// that rate counts are garbage, and no error is indicated (FACTS 12.6).
    pub is_near_max: bool,
    /// Levels of the inputs: A, B, index.
    pub inputs: [bool; 3],
}

/// The state of one encoder: 64-bit counts, index and probe latch, velocity.
///
/// Once per cycle, call [`read`](Self::read) with the registers that were read, then
/// [`control`](Self::control) for the word to write.
///
/// The counter in the FPGA has 16 bits: if the encoder moves 32768 counts or more between two
/// reads, counts are wrong. [`EncoderReading::is_unsure`] indicates that this may have happened.
/// The counter runs on through every fault but a reset, and is never written.
///
/// # Real time
/// Constant time, no allocation.
#[derive(Clone, Debug, Default)]
#[expect(clippy::struct_excessive_bools, reason = "each is a fact of its own")]
pub struct EncoderState {
    /// Configuration; the control word follows with the next write.
    pub config: EncoderConfig,
    /// The requested latch.
    pub latch: Latch,
    /// Detects quadrature errors. If false, each error is cleared in the board.
    pub watches_errors: bool,
    /// A requested index latches the count, and leaves it as it is.
    pub index_keeps_count: bool,
    /// The next read is evaluated in full: a command or the configuration may have changed.
    pub is_awake: bool,
    /// Two encoders share the pins of each, by means of a select line that the board drives.
    is_muxed: bool,
    rates: EncoderRates,
    /// A gap between two reads below this limit is neither ambiguous nor lets time stamps wrap
    /// unseen.
    short_gap_ns: u64,
    /// The previous sample, with its time stamp without wrap-around.
    last: Option<(EncoderSample, u64)>,
    /// The current values, as far as they are kept from read to read.
    reading: EncoderReading,
    doubt: PositionDoubt,
    /// The error in the control register is an old one, which is cleared, and not published until
    /// it is gone.
    clears_error: bool,
    /// Number of further reads during which a packet of the last set-up may be in flight. If such a
    /// packet is executed again, the select line of multiplexed encoders is not driven meanwhile.
    set_up_for: u32,
    /// Number of further reads in which counts may be wrong because of such a packet: the read
    /// after it, and the next one, because the write between them drives the line again.
    disturbed_for: u8,
    velocity: VelocityEstimator,
    /// The pin `homed` of the last command.
    was_homed: bool,
    reach: Reach,
    /// Reads were passed over because nothing moved.
    has_rested: bool,
    outage: OutageProof,
    /// The next read is the first one after a set-up through which the counter went on.
    must_go_on: bool,
}

impl EncoderState {
    /// A counter at 0, with time stamps in microseconds.
    pub fn new(config: EncoderConfig, is_muxed: bool) -> Self {
        Self {
            config,
            is_muxed,
            is_awake: true,
            rates: EncoderRates {
                tick_hz: 1e6,
                sample_hz: 0.0,
            },
            set_up_for: HORIZON.into(),
            ..Self::default()
        }
    }

    /// Changes the rates. With another rate of the time stamps the velocity estimate restarts,
    /// since times before and after cannot be compared; counts continue.
    pub fn set_rates(&mut self, rates: EncoderRates) {
        if rates.tick_hz != self.rates.tick_hz {
            self.velocity = VelocityEstimator::default();
        }
        self.rates = rates;
        let seconds = AMBIGUOUS / rates.sample_hz.max(rates.tick_hz).max(1.0);
        // A thousandth less than the limit: a gap of exactly the limit has to be evaluated in full.
        self.short_gap_ns = (seconds * 0.999e9) as u64;
    }

    /// The highest rate that can be followed, in counts per second: each level of A and B lasts for
    /// two counts, and has to last for the number of samples of the filter. For multiplexed
    /// encoders that is clock / (3 (n + 2)), or clock / (15 (n + 2)) with the long filter. Beyond
    /// it counts are garbage, and no error is indicated (FACTS 12.6).
    pub fn max_count_rate(&self) -> f64 {
        let is_long = self.config.mode & bits::FILTER != 0;
        2.0 * self.rates.sample_hz / if is_long { 15.0 } else { 3.0 }
    }

    /// Skips a read that shows nothing new of an encoder at standstill without a request. Returns
    /// false for any other read, which has to be passed to [`read`](Self::read).
    pub fn rests(&mut self, sample: &EncoderSample) -> bool {
        let Some((last, ticks)) = &mut self.last else {
            return false;
        };
        let is_same = last.count == sample.count && last.control == sample.control;
        let has_error = sample.control & bits::QUADRATURE_ERROR != 0;
        let gap_ns = sample.at.as_nanos().saturating_sub(last.asked.as_nanos());
        if !is_same
            || has_error
            || self.is_awake
            || self.set_up_for > 0
            || self.disturbed_for > 0
            || self.velocity.last_change.is_some()
            || gap_ns >= self.short_gap_ns
            || !self.latch.rests()
        {
            return false;
        }
        let step = sample.timestamp.wrapping_sub(*ticks as u16);
        *ticks = ticks.saturating_add(u64::from(step));
        (last.asked, last.at) = (sample.asked, sample.at);
        self.clears_error = false;
        self.has_rested = true;
        true
    }

    /// Makes the current count 0.
    pub fn reset(&mut self) {
        let EncoderReading { count, .. } = &mut self.reading;
        self.is_awake |= self.doubt.is_unsure() || *count != 0;
        *count = 0;
        self.doubt.settle();
    }

    /// Takes the command of this write.
    pub fn follow(&mut self, command: EncoderCommand) {
        if command.reset {
            self.reset();
        }
        let was_homed = replace(&mut self.was_homed, command.homed);
        if command.homed && !was_homed {
            self.is_awake |= self.doubt.is_unsure();
            self.doubt.settle();
        }
        self.latch.request(command.request);
    }

    /// Follows the counter of a board that is not set up, as long as it was not reset. `is_unseen`:
    /// the mode was written after the last good read, so that a board that was reset before has it
    /// as well.
    pub fn run_on(&mut self, sample: EncoderSample, outage: &Outage, is_unseen: bool) {
        let Some((last, ticks)) = self.last else {
            return;
        };
        self.outage.mode_written.get_or_insert(is_unseen);
        self.outage.examine(self.config.mode, last.control, &sample);
        // A reset board can have the mode from a set-up that came late, but shows no bite then.
        self.outage.is_proven &= outage.shows_bite || self.set_up_for == 0;
        self.outage.is_lost |= outage.was_reset && !self.outage.is_proven;
        if !self.outage.is_lost {
            let is_ambiguous = self.note_ambiguity(last, sample);
            self.doubt.add(is_ambiguous);
            self.advance(last, ticks, sample);
        }
    }

    /// The board has its set-up back. Without a reset, the counter goes on where it was.
    pub fn set_up_again(&mut self, outage: &Outage) {
        let OutageProof {
            is_lost, is_proven, ..
        } = take(&mut self.outage);
        let is_reset = outage.was_reset && !is_proven;
        if !outage.has_kept_set_up() {
            self.set_up_for = HORIZON.into();
        }
        self.latch.forget();
        self.is_awake = true;
        self.doubt.set_up_again();
        if is_lost || is_reset || outage.was_replaced {
            self.start_anew();
        } else if outage.has_released && (self.is_muxed || !is_proven) {
            self.doubt.add(self.last.is_some());
        } else {
            self.must_go_on = self.last.is_some();
        }
    }

    /// Takes the next read as a new start: counts continue from here, whatever the counter in the
    /// FPGA contains then.
    fn start_anew(&mut self) {
        self.doubt.add(self.last.is_some());
        self.last = None;
        self.velocity = VelocityEstimator::default();
    }

    /// Returns the control word to write in this cycle.
    pub fn control(&mut self) -> u32 {
        self.clears_error |= !self.watches_errors;
        let request = self.latch.bits();
        let shown = self.last.map_or(0, |(last, _)| last.control);
        // Writing a 1 clears the error. Omitted while a latch may be armed, since the write would
        // arm it again.
        let clear = if self.clears_error && request == 0 {
            shown & bits::QUADRATURE_ERROR
        } else {
            0
        };
        self.config.mode | request | clear
    }

    /// Takes the sample of a cycle. The first call after [`new`](Self::new) sets the start.
    pub fn read(&mut self, sample: EncoderSample) -> EncoderReading {
        self.is_awake = false;
        let input = |bit| sample.control & bit != 0;
        let has_error = input(bits::QUADRATURE_ERROR);
        let (last, ticks) = self.last.unwrap_or((sample, sample.timestamp.into()));
        // The multiplexer causes such an error when its select line begins to be driven.
        self.clears_error |= self.last.is_none();
        self.clears_error &= has_error;
        let has_error = self.reading.quadrature_error || has_error && !self.clears_error;
        let from = self.reading.rawcounts;
        let is_ambiguous = self.note_ambiguity(last, sample);
        let is_disturbed = self.last.is_some() && self.may_be_set_up_again();
        self.doubt.add(is_ambiguous || is_disturbed);
        let evidence = if is_ambiguous {
            CountEvidence::Lost
        } else if is_disturbed {
            CountEvidence::Unsure
        } else {
            CountEvidence::Certain
        };
        self.advance(last, ticks, sample);
        let index_came = self.check_latch(sample, from, evidence);
        let EncoderConfig { scale, .. } = self.config;
        let (velocity, fastest) = (self.velocity.velocity, self.max_count_rate());
        let at = self.last.map_or(0, |(_, ticks)| ticks);
        let position = self.reading.count as f64 / scale;
        let ahead = self.velocity.ahead(at, self.rates.tick_hz);
        self.reading = EncoderReading {
            position,
            interpolated: position + ahead / scale,
            velocity: velocity / scale,
            scale,
            index_came,
            quadrature_error: self.watches_errors && has_error,
            is_unsure: self.doubt.is_unsure(),
            is_near_max: fastest > 0.0 && velocity.abs() >= NEAR_FRACTION * fastest,
            inputs: [bits::A, bits::B, bits::INDEX].map(input),
            ..self.reading
        };
        self.reading
    }

    /// Ends a read. True, once, if a position that the application had is lost.
    pub fn end_read(&mut self) -> bool {
        self.doubt.read()
    }

    /// True if the counter may have wrapped around between two samples.
    fn note_ambiguity(&mut self, last: EncoderSample, sample: EncoderSample) -> bool {
        let rawcounts = self.reading.rawcounts;
        if take(&mut self.has_rested) || self.last.is_none() {
            self.reach = Reach::standing(last.at, rawcounts);
        } else {
            self.reach.note(last.at, rawcounts);
        }
        let must_go_on = take(&mut self.must_go_on);
        // With the time of the last edge.
        if last.count == sample.count {
            return false;
        }
        let gap = sample.at.since(last.asked);
        if gap.as_nanos() < self.short_gap_ns.into() && !must_go_on {
            return false;
        }
        let gap = gap.as_secs_f64();
        let farthest = self.reach.farthest(gap);
        // A counter that was reset between the last look at its registers and the set-up begins at
        // 0.
        let moved = counts_between(last, sample).unsigned_abs() as f64;
        let is_elsewhere = must_go_on && moved > farthest + MIN_MISSING;
        farthest.min(gap * self.rates.sample_hz) >= AMBIGUOUS || is_elsewhere
    }

    /// True if a packet of the last set-up may have been executed again between the last two reads,
    /// or before them.
    fn may_be_set_up_again(&mut self) -> bool {
        if self.is_muxed && self.set_up_for > 0 && self.latch.is_doubtful {
            self.disturbed_for = 2;
        }
        self.set_up_for = self.set_up_for.saturating_sub(1);
        let is_disturbed = self.disturbed_for > 0;
        self.disturbed_for = self.disturbed_for.saturating_sub(1);
        is_disturbed
    }

    /// True if counts stopped from one read to the next, at a rate near the highest one: the
    /// encoder is then beyond that rate rather than still.
    fn has_gone_beyond(&self, change: i64, elapsed: u64) -> bool {
        let fewest =
            0.5 * NEAR_FRACTION * self.max_count_rate() * (elapsed as f64 / self.rates.tick_hz);
        self.reading.is_near_max && fewest >= MIN_MISSING && (change.unsigned_abs() as f64) < fewest
    }

    fn advance(&mut self, last: EncoderSample, last_ticks: u64, sample: EncoderSample) {
        let change = counts_between(last, sample);
        let gap = sample.at.since(last.asked).as_secs_f64();
        let ticks = extend_ticks(last_ticks, sample.timestamp, gap * self.rates.tick_hz);
        // The age of a change that came after the time stamp counter was read would wrap to 65535
        // ticks.
        let age = sample.timestamp.wrapping_sub((sample.count >> 16) as u16);
        let age = if age > u16::MAX - READ_SKEW { 0 } else { age };
        let elapsed = ticks.saturating_sub(last_ticks);
        let changed_at = ticks.saturating_sub(u64::from(age).min(elapsed));
        self.doubt.add(self.has_gone_beyond(change, elapsed));
        self.reading.rawcounts = self.reading.rawcounts.wrapping_add(change);
        self.reading.count = self.reading.count.wrapping_add(change);
        let step = CountStep {
            counts: change,
            changed_at,
            from: last_ticks,
            to: ticks,
        };
        let (hz, idle_time) = (self.rates.tick_hz, self.config.idle_time);
        self.velocity.update(step, hz, idle_time);
        self.last = Some((sample, ticks));
    }

    /// Sets the count to 0 at a latched index, and keeps the position of a latched probe. Returns
    /// true if an index was latched.
    fn check_latch(&mut self, sample: EncoderSample, from: i64, evidence: CountEvidence) -> bool {
        let (wanted, count) = (self.latch.wanted, sample.count as u16);
        let moved = Movement {
            from,
            to: self.reading.rawcounts,
        };
        let behind = |latched: u16| i64::from(count.wrapping_sub(latched) as i16);
        let known = |latched| (evidence != CountEvidence::Lost).then(|| behind(latched));
        let Some(latched) = self.latch.observe(sample.control, moved, known) else {
            return false;
        };
        let behind = behind(latched);
        let is_index = wanted == LatchRequest::Index;
        if is_index && !self.index_keeps_count {
            self.reading.count = behind;
            self.doubt.settle();
            self.doubt.add(evidence != CountEvidence::Certain);
        }
        self.reading.latched = Some(self.reading.count.wrapping_sub(behind));
        is_index
    }
}

/// What the control register has shown since the set-up was lost: a reset clears it, and nothing
/// but the set-up writes it again.
#[derive(Clone, Copy, Debug, Default)]
struct OutageProof {
    /// The counter was cleared, or may have been.
    is_lost: bool,
    /// It showed the mode, which is not 0.
    is_proven: bool,
    /// The mode was written by one of the last writes before the first read of the outage: a reset
    /// board shows it as well. `None` before that read.
    mode_written: Option<bool>,
}

impl OutageProof {
    /// Takes a sample: the mode is the one that was written last, or the one that was read last.
    fn examine(&mut self, written: u32, read: u32, sample: &EncoderSample) {
        let shown = sample.control & bits::MODE;
        let expected = [written, read].map(|word| word & bits::MODE);
        let is_shown = shown != 0 && expected.contains(&shown);
        self.is_proven = is_shown && self.mode_written != Some(true);
        self.is_lost |= !is_shown && !expected.contains(&shown);
    }
}

/// The shortest way from one count to another.
fn counts_between(from: EncoderSample, to: EncoderSample) -> i64 {
    i64::from((to.count as u16).wrapping_sub(from.count as u16) as i16)
}

/// Fraction of the highest count rate that counts as near to it.
const NEAR_FRACTION: f64 = 0.9;

/// Least number of missing counts for which an encoder is taken to be beyond that rate.
const MIN_MISSING: f64 = 4.0;

/// Number of counts between two reads that is the same in either direction.
const AMBIGUOUS: f64 = 32_768.0;

/// Greatest number of ticks by which a count may be read later than the time stamp counter.
const READ_SKEW: u16 = 256;

/// Extends a time stamp without wrap-around: returns the value with these low 16 bits that is
/// nearest to `elapsed` ticks after `last` by the clock of the bus, since cycles may have been
/// missed.
fn extend_ticks(last: u64, timestamp: u16, elapsed: f64) -> u64 {
    let step = u64::from(timestamp.wrapping_sub(last as u16));
    let wraps = libm::round((elapsed - step as f64) / 65_536.0).max(0.0) as u64;
    last.saturating_add(step)
        .saturating_add(wraps.saturating_mul(65_536))
}

#[cfg(test)]
mod tests;
