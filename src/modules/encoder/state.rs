//! One encoder, cycle by cycle: counts, index and velocity.

use super::latch::Latch;
use super::latch::LatchRequest;
use super::registers::{ControlWord, CountWord, EncoderConfig};
use super::velocity::VelocityEstimator;
use crate::bus::Instant;

/// What a cycle read of one encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncoderSample {
    /// The count register.
    pub count: CountWord,
    /// The control register.
    pub control: ControlWord,
    /// The low 16 bits of the time-stamp counter, read in the same exchange.
    pub timestamp: u16,
    /// When the exchange was.
    pub at: Instant,
}

/// What an encoder says after a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncoderReading {
    /// Counts since the start, whatever was reset or indexed.
    pub rawcounts: i64,
    /// Counts since the last reset or index.
    pub count: i64,
    /// `count` by scale, in units of position.
    pub position: f64,
    /// In units of position per second.
    pub velocity: f64,
    /// Counts for one unit of position.
    pub scale: f64,
    /// `count` when the latch that was asked for happened; kept until the next one.
    pub latched: Option<i64>,
    /// Both inputs changed at once: counts may be wrong. Said until it is taken back, see
    /// [`EncoderState::clear_quadrature_error`].
    pub quadrature_error: bool,
    /// So much time lay between two reads that the encoder may have moved 32768 counts or more:
    /// `count` may be wrong by multiples of 65536. Said until the next reset or index.
    pub is_unsure: bool,
    /// It turns at nine tenths or more of the greatest rate that is followed: beyond that rate counts
    /// are garbage, and no error tells (FACTS 12.6).
    pub is_near_max: bool,
    /// The inputs now: A, B, index.
    pub inputs: [bool; 3],
}

/// The state of one encoder: 64-bit counts, index and probe latch, velocity.
///
/// Once per cycle: [`read`](Self::read) with what was read, then [`control`](Self::control) for
/// what is to be written.
///
/// The counter in the FPGA has 16 bits: if the encoder moves 32768 counts or more between two
/// reads, counts are wrong. That it may have done so is said, see [`EncoderReading::is_unsure`].
///
/// # Real time
/// Constant time, no allocation.
#[derive(Clone, Debug)]
#[allow(
    clippy::struct_excessive_bools,
    reason = "independent conditions, each said on its own"
)]
pub struct EncoderState {
    config: EncoderConfig,
    /// What `config` makes of the control word.
    mode: ControlWord,
    tick_hz: f64,
    last: Option<Last>,
    /// Something may have changed that the words of the encoder do not show.
    is_awake: bool,
    /// A shorter gap between two reads is neither ambiguous nor lets time stamps wrap unseen.
    short_gap_ns: u64,
    rawcounts: i64,
    zero: i64,
    latch: Latch,
    latched: Option<i64>,
    clear_error: bool,
    /// An error that is to be taken back is not told until it is gone.
    ignores_error: bool,
    /// The most counts in a second that are followed, with the short filter and with the long one.
    fastest: [f64; 2],
    /// The most that the counter can count in a second: once a sample.
    sampled: f64,
    has_probe: bool,
    is_unsure: bool,
    velocity: VelocityEstimator,
}

/// The cycle before.
#[derive(Clone, Copy, Debug)]
struct Last {
    count: CountWord,
    control: ControlWord,
    ticks: u64,
    at: Instant,
}

impl EncoderState {
    /// A counter at 0, whose time stamps are microseconds.
    pub fn new(config: EncoderConfig) -> Self {
        Self {
            config,
            mode: config.control(),
            tick_hz: 1e6,
            last: None,
            is_awake: true,
            short_gap_ns: 0,
            rawcounts: 0,
            zero: 0,
            latch: Latch::new(),
            latched: None,
            clear_error: false,
            ignores_error: false,
            fastest: [0.0; 2],
            sampled: 0.0,
            has_probe: true,
            is_unsure: false,
            velocity: VelocityEstimator::default(),
        }
    }

    /// Whether there is a probe. A request for one that is not there is not made: in the control
    /// register it would look as if it had happened at once (FACTS 12.5).
    pub fn set_probe(&mut self, has_probe: bool) {
        self.has_probe = has_probe;
    }

    /// Changes how often it counts rightly in a second at most, with the short filter and with the
    /// long one, and how often it is sampled: it counts at most once a sample.
    pub fn set_max_count_rates(&mut self, hz: [f64; 2], sampled: f64) {
        self.fastest = hz;
        self.sampled = sampled;
        self.limit_gap();
    }

    /// How often it counts rightly in a second at most, with the filter that it has.
    pub fn max_count_rate(&self) -> f64 {
        let [short, long] = self.fastest;
        if self.config.filter { long } else { short }
    }

    /// Whether there is a probe.
    pub const fn has_probe(&self) -> bool {
        self.has_probe
    }

    /// Changes how it counts; the control word follows with the next write.
    pub fn set_config(&mut self, config: EncoderConfig) {
        self.config = config;
        self.mode = config.control();
    }

    /// The rate of the time stamps has changed. Velocity begins anew, since times before and after
    /// can not be compared; counts go on.
    pub fn set_tick_hz(&mut self, tick_hz: f64) {
        self.tick_hz = tick_hz;
        self.velocity.reset();
        self.limit_gap();
    }

    fn limit_gap(&mut self) {
        let seconds = AMBIGUOUS / self.sampled.max(self.tick_hz).max(1.0);
        // Less by a thousandth: a gap as long as this is none that has to be looked at closely.
        self.short_gap_ns = (seconds * 0.999e9) as u64;
    }

    /// The next read is looked at closely: a command or the configuration may have changed.
    pub fn wake(&mut self) {
        self.is_awake = true;
    }

    /// Takes a read that shows nothing new of an encoder that stands still and is not asked for
    /// anything; false for any other, which has to be [read](Self::read).
    pub fn rests(&mut self, sample: &EncoderSample) -> bool {
        let Some(last) = &mut self.last else {
            return false;
        };
        let is_same = last.count == sample.count && last.control == sample.control;
        let has_error = sample.control.has(ControlWord::QUADRATURE_ERROR);
        let gap_ns = sample.at.as_nanos().saturating_sub(last.at.as_nanos());
        if !is_same
            || has_error
            || self.is_awake
            || !self.velocity.is_at_rest()
            || gap_ns >= self.short_gap_ns
            || !self.latch.rests()
        {
            return false;
        }
        let step = sample.timestamp.wrapping_sub(last.ticks as u16);
        last.ticks = last.ticks.saturating_add(u64::from(step));
        last.at = sample.at;
        (self.ignores_error, self.clear_error) = (false, false);
        true
    }

    /// Asks for a latch, or takes the request back. Where there is no probe, a request for one is
    /// none.
    pub fn request(&mut self, wanted: LatchRequest) {
        let is_possible = self.has_probe || wanted != LatchRequest::Probe;
        self.latch.request(if is_possible {
            wanted
        } else {
            LatchRequest::None
        });
    }

    /// What is still asked for; [`LatchRequest::None`] once it has happened.
    pub const fn requested(&self) -> LatchRequest {
        self.latch.wanted()
    }

    /// Says what happened to the writes since the last read, before the next: `is_doubtful` if
    /// others than the newest may have been executed, as on a network that delays, duplicates or
    /// loses packets; `is_repeated` if the control word was written again unchanged.
    pub fn disturbed(&mut self, is_doubtful: bool, is_repeated: bool) {
        self.latch.disturbed(is_doubtful, is_repeated);
    }

    /// Whether the control word has to be written although it has not changed: a request is not
    /// seen in the control register.
    pub fn wants_write(&self) -> bool {
        self.latch.is_unsettled()
    }

    /// Makes the count 0 here.
    pub fn reset(&mut self) {
        self.is_awake |= self.is_unsure || self.zero != self.rawcounts;
        self.zero = self.rawcounts;
        self.is_unsure = false;
    }

    /// Takes the next read as a new start: counts go on from here, whatever the counter in the FPGA
    /// says then. For when it may have been reset, or moved by 32768 counts or more unseen.
    pub fn resume(&mut self) {
        self.is_unsure |= self.last.is_some();
        self.last = None;
        self.latch.forget();
        self.velocity.reset();
    }

    /// Takes a quadrature error back: it stays until then, since counts may be wrong for good.
    pub fn clear_quadrature_error(&mut self) {
        self.clear_error = true;
        self.ignores_error = true;
    }

    /// The control word to write in this cycle.
    pub fn control(&self) -> ControlWord {
        let request = self.latch.bits();
        // Writing a 1 clears it. Not while a latch may be armed, which the write would arm again.
        let has_error = |last: &Last| last.control.has(ControlWord::QUADRATURE_ERROR);
        let is_wanted = self.clear_error && self.last.as_ref().is_some_and(has_error);
        let clear = if is_wanted && !self.latch.may_be_armed() {
            ControlWord::QUADRATURE_ERROR
        } else {
            0
        };
        ControlWord(self.mode.0 | request | clear)
    }

    /// Takes what a cycle read. The first call after [`new`](Self::new) sets the start.
    pub fn read(&mut self, sample: EncoderSample) -> EncoderReading {
        let count = sample.count.count();
        self.is_awake = false;
        let from = self.last.map_or(count, |last| last.count.count());
        let error = sample.control.has(ControlWord::QUADRATURE_ERROR);
        let is_old_error = self.last.is_none() && error;
        // As the multiplexer makes when its select line begins to be driven.
        if is_old_error {
            self.clear_quadrature_error();
        }
        match self.last {
            None => {
                self.last = Some(Last {
                    count: sample.count,
                    control: sample.control,
                    ticks: u64::from(sample.timestamp),
                    at: sample.at,
                });
            }
            Some(last) => self.advance(last, sample),
        }
        self.check_latch(sample, from);
        self.ignores_error &= error;
        self.clear_error &= error;
        let counts = self.rawcounts.wrapping_sub(self.zero);
        let scale = self.config.usable_scale();
        let (velocity, fastest) = (self.velocity.velocity(), self.max_count_rate());
        let input = |bit| sample.control.has(bit);
        EncoderReading {
            rawcounts: self.rawcounts,
            count: counts,
            position: counts as f64 / scale,
            velocity: velocity / scale,
            scale,
            latched: self.latched,
            quadrature_error: error && !self.ignores_error && !is_old_error,
            is_near_max: fastest > 0.0 && velocity.abs() >= NEAR * fastest,
            is_unsure: self.is_unsure,
            inputs: [
                input(ControlWord::A),
                input(ControlWord::B),
                input(ControlWord::INDEX),
            ],
        }
    }

    fn advance(&mut self, last: Last, sample: EncoderSample) {
        let count = sample.count.count();
        let change = i64::from(count.wrapping_sub(last.count.count()) as i16);
        let gap = sample.at.since(last.at).as_secs_f64();
        self.is_unsure |= gap * self.sampled >= AMBIGUOUS;
        let ticks = extend_ticks(last, &sample, self.tick_hz);
        // A change after the time stamp counter was read would look 65535 ticks old.
        let age = sample.timestamp.wrapping_sub(sample.count.timestamp());
        let age = if age > u16::MAX - READ_SKEW { 0 } else { age };
        let elapsed = ticks.saturating_sub(last.ticks);
        let changed_at = ticks.saturating_sub(u64::from(age).min(elapsed));
        self.rawcounts = self.rawcounts.wrapping_add(change);
        self.velocity.update(
            change,
            changed_at,
            last.ticks,
            ticks,
            self.tick_hz,
            self.config.idle_time,
        );
        self.last = Some(Last {
            count: sample.count,
            control: sample.control,
            ticks,
            at: sample.at,
        });
    }

    /// Makes the count 0 at an index that came, and keeps where a probe did.
    fn check_latch(&mut self, sample: EncoderSample, from: u16) {
        let wanted = self.latch.wanted();
        let count = sample.count.count();
        let Some(latched) = self.latch.observe(sample.control, from, count) else {
            return;
        };
        let behind = count.wrapping_sub(latched) as i16;
        let latched = self.rawcounts.wrapping_sub(i64::from(behind));
        if wanted == LatchRequest::Index {
            self.zero = latched;
            self.is_unsure = false;
        }
        self.latched = Some(latched.wrapping_sub(self.zero));
    }
}

/// The part of the greatest count rate from which on it is near.
const NEAR: f64 = 0.9;

/// So many counts between two reads may as well be as many in the other direction.
const AMBIGUOUS: f64 = 32_768.0;

/// How many ticks later than the time stamp counter a count may have been read.
const READ_SKEW: u16 = 256;

/// The time stamp counter without wrap-around: the value with these low 16 bits that is nearest to
/// what the clock of the bus says, since cycles may have been missed.
fn extend_ticks(last: Last, sample: &EncoderSample, hz: f64) -> u64 {
    let step = u64::from(sample.timestamp.wrapping_sub(last.ticks as u16));
    let elapsed = sample.at.since(last.at).as_secs_f64() * hz;
    let wraps = libm::round((elapsed - step as f64) / 65_536.0).max(0.0) as u64;
    last.ticks
        .saturating_add(step)
        .saturating_add(wraps.saturating_mul(65_536))
}

#[cfg(test)]
mod tests;
