//! Encoders: counts, indexes and velocity against the true motion of the motors.

use mesa_hal::hal::{InOut, Input, Param, PinError, PinInfo, Pins};

use super::super::oracle::{Checked, Promise, ensure};
use super::super::stage::Stage;

/// Counts that the filter, the index pulse and rounding make of a difference.
const ROUGH: f64 = 3.0;

/// One encoder, and what is known of it.
pub(super) struct Encoder {
    axis: usize,
    rawcounts: Input<i32>,
    count: Input<i32>,
    pub(super) index_enable: InOut<bool>,
    unsure: Input<bool>,
    pub(super) filter: Param<bool>,
    pub(super) scale: Param<f64>,
    /// Where the motor is while `rawcounts` is 0: the least and the greatest position that all reads
    /// so far allow.
    zero: Option<[f64; 2]>,
    /// Since when an index is asked for.
    pub(super) asked: Option<u64>,
}

impl Encoder {
    /// The encoder of an axis; `None` if the firmware does not have it.
    pub(super) fn new(pins: &Pins, name: &str, axis: usize) -> Result<Option<Self>, PinError> {
        let stem = format!("{name}.encoder.{axis:02}");
        // A name that is not there is compared with all that are, which takes its time.
        let has = |info: &PinInfo| info.name.starts_with(&stem);
        if !pins.infos().iter().any(has) {
            return Ok(None);
        }
        Ok(Some(Self {
            axis,
            rawcounts: pins.input(&format!("{stem}.rawcounts"))?,
            count: pins.input(&format!("{stem}.count"))?,
            index_enable: pins.inout(&format!("{stem}.index-enable"))?,
            unsure: pins.input(&format!("{stem}.count-unsure"))?,
            filter: pins.parameter(&format!("{stem}.filter"))?,
            scale: pins.parameter(&format!("{stem}.scale"))?,
            zero: None,
            asked: None,
        }))
    }

    /// Whether its counts are known, so that an index can be judged.
    pub(super) fn is_known(&self) -> bool {
        self.zero.is_some()
    }

    /// Compares what was read, some time `from` to `to`, with the motion. `turn`: counts from mark to
    /// mark.
    pub(super) fn check(
        &mut self,
        pins: &Pins,
        stage: &Stage,
        (from, now): (u64, u64),
        turn: u32,
    ) -> Checked {
        let raw = f64::from(pins.read(self.rawcounts).value);
        if pins.read(self.unsure).value {
            (self.zero, self.asked) = (None, None);
            return Ok(());
        }
        let (least, most) = stage.with_truth(|truth| truth.turned(self.axis, from, now));
        let [low, high] = self.zero.unwrap_or([f64::MIN, f64::MAX]);
        let zero = [low.max(least - raw - ROUGH), high.min(most - raw + ROUGH)];
        ensure(zero[0] <= zero[1], Promise::Inputs, now, || {
            let axis = self.axis;
            format!(
                "encoder {axis}: rawcounts {raw} from {low} to {high} on, without doubt, but the motor \
                 was at {least} to {most}"
            )
        })?;
        self.zero = Some(zero);
        let Some(asked) = self.asked else {
            return Ok(());
        };
        if pins.read(self.index_enable).value {
            return Ok(());
        }
        self.asked = None;
        let count = f64::from(pins.read(self.count).value);
        let (low, high) = stage.with_truth(|truth| truth.turned(self.axis, asked, now));
        let turn = f64::from(turn);
        // The index pulse is as wide as a count, and either end of it may be the one.
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

    /// The request does not count any more.
    pub(super) fn forget_index(&mut self) {
        self.asked = None;
    }
}
