//! One encoder, cycle by cycle.

use super::{ControlWord, CountWord, EncoderConfig, VelocityEstimator};
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
    /// `count` when the latch that was asked for happened; kept until the next one.
    pub latched: Option<i64>,
    /// Both inputs changed at once: counts may be wrong. Said until it is taken back, see
    /// [`Encoder::clear_quadrature_error`].
    pub quadrature_error: bool,
    /// So much time lay between two reads that the encoder may have moved 32768 counts or more:
    /// `count` may be wrong by multiples of 65536. Said until the next reset or index.
    pub is_unsure: bool,
    /// The inputs now: A, B, index.
    pub inputs: [bool; 3],
}

/// What is to be latched, once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LatchRequest {
    /// Nothing.
    #[default]
    None,
    /// The count becomes 0 where the index was: `index-enable` of LinuxCNC.
    Index,
    /// The count is latched at the probe's edge.
    Probe,
}

impl LatchRequest {
    const fn bits(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Index => ControlWord::LATCH_ON_INDEX | ControlWord::JUST_ONCE,
            Self::Probe => ControlWord::LATCH_ON_PROBE | ControlWord::JUST_ONCE,
        }
    }

    const fn enable(self) -> u32 {
        self.bits() & !ControlWord::JUST_ONCE
    }
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
pub struct Encoder {
    config: EncoderConfig,
    tick_hz: f64,
    last: Option<Last>,
    rawcounts: i64,
    zero: i64,
    wanted: LatchRequest,
    stage: Stage,
    /// Whether the control register showed no request when it was read last.
    clean: bool,
    latched: Option<i64>,
    clear_error: bool,
    /// The most counts in a second.
    fastest: f64,
    is_unsure: bool,
    velocity: VelocityEstimator,
}

/// The cycle before.
#[derive(Clone, Copy, Debug)]
struct Last {
    count: u16,
    ticks: u64,
    at: Instant,
}

/// How far a latch request has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The control register still shows an earlier request, or is not known: nothing is written
    /// until that is gone, so that its end is not taken for the end of this one.
    Settling,
    /// Not in the control register yet, as far as is known.
    Asked,
    /// Was seen in the control register.
    Armed,
}

impl Encoder {
    /// An encoder at 0. `tick_hz` is the rate of its time stamps.
    pub fn new(config: EncoderConfig, tick_hz: f64) -> Self {
        Self {
            config,
            tick_hz,
            last: None,
            rawcounts: 0,
            zero: 0,
            wanted: LatchRequest::None,
            stage: Stage::Settling,
            clean: false,
            latched: None,
            clear_error: false,
            fastest: 0.0,
            is_unsure: false,
            velocity: VelocityEstimator::default(),
        }
    }

    /// The same, which counts at most so many times a second: that tells how far it may have moved
    /// unseen. Otherwise nothing is told of that.
    #[must_use]
    pub fn counting_up_to(mut self, hz: f64) -> Self {
        self.set_max_count_rate(hz);
        self
    }

    /// Changes how often it counts in a second at most.
    pub fn set_max_count_rate(&mut self, hz: f64) {
        self.fastest = hz;
    }

    /// How it counts.
    pub fn config(&self) -> &EncoderConfig {
        &self.config
    }

    /// Changes how it counts; the control word follows with the next write.
    pub fn set_config(&mut self, config: EncoderConfig) {
        self.config = config;
    }

    /// The rate of the time stamps has changed. Velocity begins anew, since times before and after
    /// can not be compared; counts go on.
    pub fn set_tick_hz(&mut self, tick_hz: f64) {
        self.tick_hz = tick_hz;
        self.velocity.reset();
    }

    /// Asks for a latch, or takes the request back.
    pub fn request(&mut self, wanted: LatchRequest) {
        if wanted != self.wanted {
            let fresh = self.clean && self.wanted == LatchRequest::None;
            self.wanted = wanted;
            self.stage = if fresh { Stage::Asked } else { Stage::Settling };
        }
    }

    /// What is still asked for; [`LatchRequest::None`] once it has happened.
    pub const fn requested(&self) -> LatchRequest {
        self.wanted
    }

    /// Makes the count 0 here.
    pub fn reset(&mut self) {
        self.zero = self.rawcounts;
        self.is_unsure = false;
    }

    /// Takes the next read as a new start: counts go on from here, whatever the counter in the FPGA
    /// says then. For when it may have been reset, or moved by 32768 counts or more unseen.
    pub fn resume(&mut self) {
        self.is_unsure |= self.last.is_some();
        self.last = None;
        self.clean = false;
        self.velocity.reset();
        if self.wanted != LatchRequest::None {
            self.stage = Stage::Settling;
        }
    }

    /// Takes a quadrature error back: it stays until then, since counts may be wrong for good.
    pub fn clear_quadrature_error(&mut self) {
        self.clear_error = true;
    }

    /// The control word to write in this cycle.
    pub fn control(&self) -> ControlWord {
        let request = match self.stage {
            Stage::Settling => 0,
            Stage::Asked | Stage::Armed => self.wanted.bits(),
        };
        // Writing a 1 clears it.
        let clear = if self.clear_error {
            ControlWord::QUADRATURE_ERROR
        } else {
            0
        };
        ControlWord(self.config.control().0 | request | clear)
    }

    /// Takes what a cycle read. The first call after [`new`](Self::new) sets the start.
    pub fn read(&mut self, sample: EncoderSample) -> EncoderReading {
        let count = sample.count.count();
        match self.last {
            None => {
                self.last = Some(Last {
                    count,
                    ticks: u64::from(sample.timestamp),
                    at: sample.at,
                });
            }
            Some(last) => self.advance(last, sample),
        }
        self.check_latch(sample);
        self.clear_error &= sample.control.has(ControlWord::QUADRATURE_ERROR);
        let counts = self.rawcounts.wrapping_sub(self.zero);
        let scale = self.config.usable_scale();
        let input = |bit| sample.control.has(bit);
        EncoderReading {
            rawcounts: self.rawcounts,
            count: counts,
            position: counts as f64 / scale,
            velocity: self.velocity.velocity() / scale,
            latched: self.latched,
            quadrature_error: input(ControlWord::QUADRATURE_ERROR),
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
        let change = i64::from(count.wrapping_sub(last.count) as i16);
        let gap = sample.at.since(last.at).as_secs_f64();
        self.is_unsure |= gap * self.fastest >= AMBIGUOUS;
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
            count,
            ticks,
            at: sample.at,
        });
    }

    /// The enable bit reads back 0 when the latch has happened. It is 0 before it was written as
    /// well, and when that write was lost: then nothing may be taken for a latch. `JUST_ONCE`
    /// tells, which no other request sets.
    fn check_latch(&mut self, sample: EncoderSample) {
        self.clean = !sample.control.has(ANY_REQUEST);
        if self.wanted == LatchRequest::None {
            return;
        }
        if self.stage == Stage::Settling {
            if self.clean {
                self.stage = Stage::Asked;
            }
            return;
        }
        if sample.control.has(self.wanted.enable()) {
            self.stage = Stage::Armed;
            return;
        }
        if self.stage != Stage::Armed && !sample.control.has(ControlWord::JUST_ONCE) {
            return;
        }
        let behind = sample.count.count().wrapping_sub(sample.control.latched()) as i16;
        let latched = self.rawcounts.wrapping_sub(i64::from(behind));
        if self.wanted == LatchRequest::Index {
            self.zero = latched;
            self.is_unsure = false;
        }
        self.latched = Some(latched.wrapping_sub(self.zero));
        self.wanted = LatchRequest::None;
        self.stage = Stage::Settling;
    }
}

/// The bits of the control register that any request sets.
const ANY_REQUEST: u32 = LatchRequest::Index.bits() | LatchRequest::Probe.bits();

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
