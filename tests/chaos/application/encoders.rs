//! Encoders: counts, indexes and velocity against the true motion of the motors.

use mesa_hal::hal::{InOut, Input, Param, PinError, PinInfo, Pins};

use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{MILLI, Plan};
use super::super::stage::Stage;

/// Tolerance in counts for the filter, the index pulse and rounding.
const ROUGH: f64 = 3.0;

/// Velocity is not judged below this speed (counts per second).
const SLOW: f64 = 8_000.0;

/// Velocity is not judged after a read that took longer than this.
const LONG: u64 = 30 * MILLI;

/// Counts in a time in which an encoder can have moved by 32768, one way or the other.
const AMBIGUOUS: f64 = 32_768.0;

/// After a time without a read in which a motor makes this part of them, an encoder may have
/// doubts: it may have begun to turn shortly before.
const LIKELY: f64 = 0.02;

/// Reads after a set-up in which a packet of it may come again.
const SETTLED: u32 = 110;

/// Looks after which a setting has been written, whatever was lost.
const WRITTEN: u32 = 12;

/// An encoder, and the knowledge about it.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub(super) struct Encoder {
    axis: usize,
    /// It shares its pins with another one.
    is_muxed: bool,
    rawcounts: Input<i32>,
    count: Input<i32>,
    pub(super) index_enable: InOut<bool>,
    velocity: Input<f64>,
    unsure: Input<bool>,
    max_count_rate: Param<f64>,
    pub(super) filter: Param<bool>,
    pub(super) scale: Param<f64>,
    /// Position of the motor while `rawcounts` is 0: the least and the greatest position that all
    /// reads so far permit.
    zero: Option<[f64; 2]>,
    /// Start times of the last good reads, the newest first.
    reads: [u64; 4],
    /// End of the last of them.
    ended: u64,
    /// Time since which an index is requested.
    pub(super) asked: Option<u64>,
    /// An index was requested and has not occurred, even if the request was dropped.
    pub(super) is_pending: bool,
    /// Start of the last read whose counts were used.
    read_from: Option<u64>,
    /// Counts of this set-up have been used.
    is_begun: bool,
    /// The long filter was selected at the last look.
    is_long: Option<bool>,
    /// Looks since it was selected.
    long_for: u32,
    /// It is multiplexed, its select line was released since, and no index has occurred.
    must_doubt: bool,
    /// It may have doubts, and has had them ever since.
    may_doubt: bool,
    /// Good reads since the last set-up.
    reads_since: u32,
}

impl Encoder {
    /// The encoder of an axis; `None` if the firmware does not have it.
    pub(super) fn new(
        pins: &Pins,
        (name, is_muxed): (&str, bool),
        axis: usize,
    ) -> Result<Option<Self>, PinError> {
        let stem = format!("{name}.encoder.{axis:02}");
        // The driver compares an unknown name with all others, which takes long.
        let has = |info: &PinInfo| info.name.starts_with(&stem);
        if !pins.infos().iter().any(has) {
            return Ok(None);
        }
        Ok(Some(Self {
            axis,
            is_muxed,
            rawcounts: pins.input(&format!("{stem}.rawcounts"))?,
            count: pins.input(&format!("{stem}.count"))?,
            index_enable: pins.inout(&format!("{stem}.index-enable"))?,
            velocity: pins.input(&format!("{stem}.velocity"))?,
            unsure: pins.input(&format!("{stem}.count-unsure"))?,
            max_count_rate: pins.parameter(&format!("{stem}.max-count-rate"))?,
            filter: pins.parameter(&format!("{stem}.filter"))?,
            scale: pins.parameter(&format!("{stem}.scale"))?,
            zero: None,
            reads: [0; 4],
            ended: 0,
            asked: None,
            is_pending: false,
            read_from: None,
            is_begun: false,
            is_long: None,
            long_for: 0,
            must_doubt: false,
            may_doubt: false,
            reads_since: 0,
        }))
    }

    /// True if its counts are known, so that an index can be judged.
    pub(super) fn is_known(&self) -> bool {
        self.zero.is_some()
    }

    /// The driver has read it by itself, or can no longer report the time of the read: the shortest
    /// time between two reads, which limits the error of a velocity, is not known.
    pub(super) fn was_read(&mut self) {
        self.reads = [0; 4];
    }

    /// The board is not set up, or was set up again. With all pins released, the select line is one
    /// of them.
    pub(super) fn is_set_up_anew(&mut self, is_released: bool) {
        self.must_doubt |= is_released && self.is_begun && self.is_muxed;
        self.reads_since = 0;
    }

    /// True if an encoder may have doubts that begin with a read after `gap`.
    fn may_begin_to_doubt(&mut self, (pins, plan): (&Pins, &Plan), gap: u64) -> bool {
        let is_recent = self.reads_since < SETTLED;
        self.reads_since += 1;
        // Without the long filter, the mode of a plain encoder is 0, and a reset does not show in
        // it. It may still be on its way to the board.
        let has_mode = pins.param(self.filter) && self.long_for > WRITTEN;
        // A request for an index is written with the mode, which proves nothing then.
        let may_be_reset = plan.may_be_reset() || !has_mode || self.is_pending;
        let is_lost = is_recent && (self.is_muxed || may_be_reset);
        let likely = plan.speed(self.axis).abs() * gap as f64 * 1e-9;
        let is_long = likely > LIKELY * AMBIGUOUS;
        is_lost || is_long || plan.extras.is_fast
    }

    /// Checks that `count-unsure` is on when it must be, and off without a reason.
    fn check_doubt(&mut self, (pins, plan): (&Pins, &Plan), (from, now): (u64, u64)) -> Checked {
        let (axis, is_unsure) = (self.axis, pins.read(self.unsure).value);
        let is_off = !pins.read(self.index_enable).value;
        // An index ends all doubts, whatever requested it.
        let has_come = self.is_pending && is_off;
        self.must_doubt &= !has_come;
        self.is_begun = true;
        ensure(is_unsure || !self.must_doubt, Promise::Inputs, now, || {
            format!("encoder {axis} has no doubts, but its select line was released")
        })?;
        // The registers were read at any time between the request and the reply.
        let gap = self
            .read_from
            .map_or(0, |before| now.saturating_sub(before));
        self.read_from = Some(from);
        // Whether it should have some, its counts show.
        self.may_doubt &= is_unsure;
        self.may_doubt |= self.may_begin_to_doubt((pins, plan), gap);
        ensure(!is_unsure || self.may_doubt, Promise::Inputs, now, || {
            format!("encoder {axis} has doubts without a reason, {gap} ns after the request before")
        })?;
        let is_long = pins.param(self.filter);
        let is_new = self.is_long.replace(is_long) != Some(is_long);
        self.long_for = if is_new || !is_long {
            0
        } else {
            self.long_for.saturating_add(1)
        };
        if is_new || !plan.spares_the_board() {
            // The setting may not be written yet.
            return Ok(());
        }
        let rate = pins.param(self.max_count_rate) * if is_long { 5.0 } else { 1.0 };
        let fastest = plan.fastest();
        let is_right = (rate - fastest).abs() < 0.001 * fastest;
        ensure(is_right, Promise::Inputs, now, || {
            format!("encoder {axis} follows {rate} counts in a second, not {fastest}")
        })
    }

    /// Compares values that were read at some time in `from` to `to` with the motion.
    pub(super) fn check(
        &mut self,
        (pins, stage, plan): (&Pins, &Stage, &Plan),
        (from, now): (u64, u64),
        is_latched_late: bool,
    ) -> Checked {
        let raw = f64::from(pins.read(self.rawcounts).value);
        self.check_doubt((pins, plan), (from, now))?;
        if pins.read(self.unsure).value {
            (self.zero, self.asked, self.reads) = (None, None, [0; 4]);
            return Ok(());
        }
        let (least, most) = stage.with_truth(|truth| truth.turned(self.axis, from, now));
        let [low, high] = self.zero.unwrap_or([f64::MIN, f64::MAX]);
        let is_off = !pins.read(self.index_enable).value;
        let has_come = self.is_pending && is_off;
        self.is_pending &= !is_off;
        let seen = [least - raw - ROUGH, most - raw + ROUGH];
        let mut zero = [low.max(seen[0]), high.min(seen[1])];
        if has_come && zero[0] > zero[1] {
            // The index ended a doubt of a call that read by itself, which was never visible.
            (zero, self.reads) = (seen, [0; 4]);
        }
        ensure(zero[0] <= zero[1], Promise::Inputs, now, || {
            let axis = self.axis;
            format!(
                "encoder {axis}: rawcounts {raw} from {low} to {high} on, without doubt, but the motor \
                 was at {least} to {most}"
            )
        })?;
        self.zero = Some(zero);
        if is_latched_late {
            // Two samples can be one, or as far apart as two periods.
            self.reads = [0; 4];
        } else {
            self.check_velocity(pins, stage, (from, now))?;
        }
        let Some(asked) = self.asked else {
            return Ok(());
        };
        if !is_off {
            return Ok(());
        }
        self.asked = None;
        let count = f64::from(pins.read(self.count).value);
        let (low, high) = stage.with_truth(|truth| truth.turned(self.axis, asked, now));
        let turn = f64::from(plan.extras.turn);
        // The index pulse is as wide as a count, and either end of it may be the mark.
        let first = ((low - 2.0) / turn).ceil() as i64;
        let last = ((high + 2.0) / turn).floor() as i64;
        let fits = |index: i64| {
            let mark = index as f64 * turn;
            (zero[0] - ROUGH..=zero[1] + ROUGH).contains(&(count - raw + mark))
        };
        ensure((first..=last).any(fits), Promise::Index, now, || {
            let axis = self.axis;
            format!(
                "encoder {axis}: index-enable ended with count {count}, but the motor went from {low} \
                 to {high} since it was asked for, and is at {least} to {most}"
            )
        })
    }

    /// Velocity must be one that the motor had since the fourth good read before. At low speed,
    /// counts that are further apart determine it.
    fn check_velocity(&mut self, pins: &Pins, stage: &Stage, (from, now): (u64, u64)) -> Checked {
        let [a, b, c, oldest] = self.reads;
        if from <= a {
            return Ok(());
        }
        self.reads = [from, a, b, c];
        let ended = core::mem::replace(&mut self.ended, now);
        let (least, most) = stage.with_truth(|truth| truth.speeds(self.axis, oldest, now));
        // The time stamps of the board have 16 bits: the number of their overflows is taken from
        // the host's clock, which cannot provide it if it stops while the board is read.
        let is_long = now.saturating_sub(from) > LONG;
        if is_long || oldest == 0 || least.abs().min(most.abs()) < SLOW {
            return Ok(());
        }
        let velocity = pins.read(self.velocity).value * pins.param(self.scale);
        // A count more or less in the shortest time between two reads, and the delay of the filter.
        let shortest = from.saturating_sub(ended).max(1);
        let slack = 0.05 * least.abs().max(most.abs()) + (1e9 / shortest as f64).max(2_000.0);
        ensure(
            (least - slack..=most + slack).contains(&velocity),
            Promise::Inputs,
            now,
            || {
                let axis = self.axis;
                format!(
                    "encoder {axis}: {velocity} counts in a second, but it were {least} to {most} \
                     since {oldest}"
                )
            },
        )
    }

    /// Drops the request.
    pub(super) fn forget_index(&mut self) {
        self.asked = None;
    }
}
