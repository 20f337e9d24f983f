//! A counter with its three lines and its probe: samples, filters, quadrature, index and latch.
//!
//! All steps are those of the gateware, sample by sample (FACTS 12.12; recordings of the enc and qc
//! families). The index gets its gate and its polarity in front of its filter, and the probe has a
//! filter too. Samples are skipped while nothing moves.

use super::clocks::{Clocks, Divider, Stamps};

const QUADRATURE_ERROR: u32 = 1 << 15;
const AB_POLARITY: u32 = 1 << 14;
const LATCH_ON_PROBE: u32 = 1 << 13;
const PROBE_POLARITY: u32 = 1 << 12;
const LONG_FILTER: u32 = 1 << 11;
const UP_DOWN: u32 = 1 << 10;
const USE_MASK: u32 = 1 << 9;
const MASK_POLARITY: u32 = 1 << 8;
const GATE_WITH_AB: u32 = 1 << 7;
const JUST_ONCE: u32 = 1 << 6;
const CLEAR_ON_INDEX: u32 = 1 << 5;
const LATCH_ON_INDEX: u32 = 1 << 4;
const INDEX_POLARITY: u32 = 1 << 3;
const LIVE: u32 = 0b111;

/// From a load of the divider to the change of the select line, and to the sample before it.
pub(super) const TO_SELECT: Clocks = 2;
/// A time that differs between multiplexed and plain encoders.
#[derive(Clone, Copy, Debug)]
struct TimeByKind {
    muxed: Clocks,
    plain: Clocks,
}

/// From a load of the divider to the filters' tick.
const TO_TICK: TimeByKind = TimeByKind { muxed: 2, plain: 0 };
/// From a tick to the clock edge at which the levels of the filters appear as live bits, and to the
/// edge at which they are counted.
const TO_LIVE: Clocks = 1;
const TO_COUNT: Clocks = 2;
/// Time before a sample by which a line must have reached its level.
const AHEAD: TimeByKind = TimeByKind { muxed: 3, plain: 1 };

/// Levels of A, B and index.
pub(super) type Abz = [bool; 3];

/// Levels of A, B, the conditioned index and the probe.
type Levels = [bool; 4];

/// Capacity for changes of the lines that have not been sampled yet. More changes than this within
/// two samples are glitches that no sample sees.
const WAITING: usize = 8;

/// Capacity of the queue of changes: the most that a bus and the pins make within two clocks.
const QUEUED: usize = 4;

/// A counter, simulated up to a clock edge.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "they are lines")]
pub(super) struct Counter {
    /// Samples of even encoders are taken while the select line is low, of odd ones while the line
    /// is high; plain encoders have all of them.
    place: CountPlace,
    divider: Divider,
    count: u16,
    stamp: u16,
    control: u32,
    latch: u16,
    has_probe: bool,
    mask: bool,
    probe: bool,
    /// The lines at the last sample, and their changes since.
    line: Abz,
    waiting: [(Clocks, Abz); WAITING],
    pending: usize,
    filters: Filters,
    /// The levels that were counted last.
    counted: Lanes,
    /// The levels that are counted next, and the clock edge of that.
    due: Option<(Clocks, Lanes)>,
    /// False until the first sample after configuration, which is not counted.
    is_started: bool,
    /// Pending changes, each after a clock edge; the oldest first.
    changes: [(Clocks, CountChange); QUEUED],
    queued: usize,
}

/// A change of a counter's registers or pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CountChange {
    /// CONTROL is written.
    Control(u32),
    /// COUNT is written.
    Clear,
    /// The level of the probe's pin.
    Probe(bool),
    /// The level of the index mask's pin.
    Mask(bool),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CountPlace {
    Even,
    Odd,
    Plain,
}

/// Levels of A, B, the conditioned index and the probe: the top bit of each byte, A in the lowest.
type Lanes = u32;

const ONES: Lanes = 0x0101_0101;
const TOPS: Lanes = 0x8080_8080;

fn lanes(levels: Levels) -> Lanes {
    Lanes::from_le_bytes(levels.map(|level| if level { 0x80 } else { 0 }))
}

fn levels(lanes: Lanes) -> Levels {
    lanes.to_le_bytes().map(|lane| lane != 0)
}

/// The filters of the four lines, a byte each. A filter counts up while its line is high and down
/// while the line is low. The level follows at the ends, one tick later.
#[derive(Clone, Copy, Debug, Default)]
struct Filters {
    /// At most 15 each, so that the top bits are free for comparisons.
    samples: u32,
    levels: Lanes,
}

impl Filters {
    fn settled(lines: Lanes, length: u8) -> Self {
        Self {
            samples: (lines >> 7) * u32::from(length),
            levels: lines,
        }
    }

    /// The filters that are full, and those that are not empty.
    fn ends(self, length: u8) -> [Lanes; 2] {
        let full = (self.samples | TOPS) - ONES * u32::from(length);
        let filled = self.samples + (TOPS - ONES);
        [full & TOPS, filled & TOPS]
    }

    fn take(&mut self, lines: Lanes, length: u8) {
        let [full, filled] = self.ends(length);
        self.levels = (self.levels | full) & filled;
        self.samples += (lines & !full) >> 7;
        self.samples -= (!lines & filled) >> 7;
    }

    /// Number of samples of these lines that only move the filters toward their ends: none of them
    /// ends a filter, and no level changes. `None` for any number: all filters are settled.
    fn uniform(self, lines: Lanes, length: u8) -> Option<u32> {
        let [full, filled] = self.ends(length);
        let moving = (lines & !full) | (filled & !lines);
        // The levels of filters at their ends follow with the next sample.
        if (self.levels | full) & filled != self.levels {
            return Some(0);
        }
        if moving == 0 {
            return None;
        }
        let lanes = self.samples.to_le_bytes().into_iter();
        let lanes = lanes.zip(lines.to_le_bytes()).zip(moving.to_le_bytes());
        let left = lanes
            .filter(|(_, moves)| *moves != 0)
            .map(
                |((sample, line), _)| {
                    if line == 0 { sample } else { length - sample }
                },
            );
        left.map(u32::from).min()
    }

    /// Takes a number of samples at once, at most as many as are [uniform](Self::uniform).
    fn take_uniform(&mut self, lines: Lanes, length: u8, samples: u32) {
        let [full, filled] = self.ends(length);
        self.samples += samples * ((lines & !full) >> 7);
        self.samples -= samples * ((!lines & filled) >> 7);
    }
}

/// The pins that a counter has beside its lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct CounterPins {
    /// The firmware has a probe.
    pub has_probe: bool,
    /// The level of the index mask's pin.
    pub mask: bool,
    /// The level of the probe's pin.
    pub probe: bool,
}

impl Counter {
    pub fn new(place: CountPlace, divider: Divider, pins: CounterPins) -> Self {
        let CounterPins {
            has_probe,
            mask,
            probe,
        } = pins;
        Self {
            place,
            divider,
            count: 0,
            stamp: 0,
            control: 0,
            latch: 0,
            has_probe,
            mask,
            probe,
            line: [false; 3],
            waiting: [(0, [false; 3]); WAITING],
            pending: 0,
            filters: Filters::default(),
            counted: 0,
            due: None,
            is_started: false,
            changes: [(0, CountChange::Clear); QUEUED],
            queued: 0,
        }
    }

    /// Sets the lines, from before configuration on.
    pub fn with_lines(self, line: Abz) -> Self {
        Self { line, ..self }
    }

    /// Settles on these lines, as after a long rest, without counting.
    pub fn settle(&mut self, line: Abz) {
        self.line = line;
        self.pending = 0;
        let inputs = self.inputs();
        self.filters = Filters::settled(inputs, self.filter_length());
        self.counted = inputs;
        self.due = None;
    }

    /// The word that COUNT holds.
    pub fn count_word(&self) -> u32 {
        u32::from(self.count) | u32::from(self.stamp) << 16
    }

    /// The word that CONTROL holds at the clock edge `now`. Without a probe pin the bits of the
    /// probe read 0.
    pub fn control_word(&self, now: Clocks) -> u32 {
        let absent = if self.has_probe {
            0
        } else {
            LATCH_ON_PROBE | PROBE_POLARITY
        };
        let live = match self.due {
            Some((at, lanes)) if at <= now + TO_COUNT - TO_LIVE => lanes,
            _ => self.counted,
        };
        let [a, b, index, _] = levels(live).map(u32::from);
        let live = a | b << 1 | index << 2;
        u32::from(self.latch) << 16 | self.control & !absent | live
    }

    pub fn set_rate(&mut self, now: Clocks, register: u32) {
        self.divider.write(now, register);
    }

    pub fn disturb(&mut self) {
        self.control |= QUADRATURE_ERROR;
    }

    /// Queues a change after the clock edge `at`, which is not before that of an earlier change.
    pub fn change(&mut self, at: Clocks, change: CountChange, stamps: &Stamps) {
        if let [(oldest, _), ..] = self.changes
            && self.queued == QUEUED
        {
            self.run_to(oldest, stamps);
        }
        if let Some(place) = self.changes.get_mut(self.queued) {
            *place = (at, change);
            self.queued += 1;
        }
    }

    /// True if a change is queued for the clock edge `at` itself.
    pub fn changes_at(&self, at: Clocks) -> bool {
        let mut changes = self.changes.iter().take(self.queued);
        changes.any(|&(edge, _)| edge == at)
    }

    fn apply(&mut self, change: CountChange) {
        match change {
            CountChange::Control(value) => {
                // Writing a 1 clears the quadrature error.
                let error = self.control & QUADRATURE_ERROR & !value;
                self.control = value & 0xFFFF & !(LIVE | QUADRATURE_ERROR) | error;
            }
            CountChange::Clear => {
                self.count = 0;
                if self.control & JUST_ONCE != 0 {
                    self.control &= !CLEAR_ON_INDEX;
                }
            }
            CountChange::Probe(level) => self.probe = level,
            CountChange::Mask(level) => self.mask = level,
        }
    }

    /// Changes the lines, so that samples from the clock edge `next` on see the change: the first
    /// edge that is not before it.
    pub fn set_lines(&mut self, next: Clocks, abz: Abz) {
        let seen = next + self.of_place(AHEAD);
        let last = self.pending.min(WAITING - 1);
        if let Some(place) = self.waiting.get_mut(last) {
            *place = (seen, abz);
        }
        self.pending = last + 1;
    }

    /// Advances up to and including the clock edge `to`.
    pub fn run_to(&mut self, to: Clocks, stamps: &Stamps) {
        while let [(at, change), ..] = self.changes
            && self.queued > 0
            && at <= to
        {
            self.tick_to(at, stamps);
            self.apply(change);
            self.changes.rotate_left(1);
            self.queued -= 1;
        }
        self.tick_to(to, stamps);
    }

    fn tick_to(&mut self, to: Clocks, stamps: &Stamps) {
        let delay = self.of_place(TO_TICK);
        loop {
            self.skip(to.saturating_sub(delay));
            let mut divider = self.divider;
            divider.step();
            // Multiplexed encoders count once in two loads, all of them at the same time.
            if self.place != CountPlace::Plain && divider.count().is_multiple_of(2) {
                divider.step();
            }
            let [load, before, second] = divider.loaded();
            let tick = load + delay;
            let ends = |&mut (at, _): &mut (Clocks, Lanes)| at <= to || tick <= to;
            if let Some((at, lanes)) = self.due.take_if(ends) {
                self.count(lanes, stamps.after(at + 1) as u16);
            }
            if tick > to {
                return;
            }
            self.divider = divider;
            self.look(match self.place {
                CountPlace::Plain => load,
                CountPlace::Even => before + TO_SELECT,
                CountPlace::Odd => second + TO_SELECT,
            });
            self.tick(tick);
        }
    }

    fn of_place(&self, time: TimeByKind) -> Clocks {
        if self.place == CountPlace::Plain {
            time.plain
        } else {
            time.muxed
        }
    }

    /// Skips samples up to `to` of which only the filters' contents depend: the lines do not
    /// change, and nothing is counted.
    fn skip(&mut self, to: Clocks) {
        if self.pending > 0 || self.due.is_some() || !self.is_started {
            return;
        }
        let (lines, length) = (self.inputs(), self.filter_length());
        let loads = if self.place == CountPlace::Plain {
            1
        } else {
            2
        };
        match self.filters.uniform(lines, length) {
            None => {
                self.divider.skip(to, 2);
            }
            Some(samples) => {
                let most = u64::from(samples) * loads;
                let samples = self.divider.skip_at_most(to, loads, most) / loads;
                self.filters.take_uniform(lines, length, samples as u32);
            }
        }
    }

    /// Takes the lines at the clock edge of a sample.
    fn look(&mut self, sampled: Clocks) {
        let seen = self.waiting.iter().take(self.pending);
        let seen = seen.take_while(|(at, _)| *at <= sampled).count();
        if seen == 0 {
            return;
        }
        if let Some((_, abz)) = self.waiting.get(seen - 1) {
            self.line = *abz;
        }
        self.waiting.copy_within(seen..self.pending, 0);
        self.pending -= seen;
    }

    /// Lets the filters take a sample.
    fn tick(&mut self, tick: Clocks) {
        if !core::mem::replace(&mut self.is_started, true) {
            return;
        }
        self.filters.take(self.inputs(), self.filter_length());
        let lanes = self.filters.levels;
        self.due = (lanes != self.counted).then_some((tick + TO_COUNT, lanes));
    }

    /// Counts the filtered levels. A latch takes the count before this step.
    fn count(&mut self, lanes: Lanes, stamp: u16) {
        let before = core::mem::replace(&mut self.counted, lanes);
        let [a, b, index, probe] = levels(lanes);
        let [a_before, b_before, index_before, probe_before] = levels(before);
        let held = self.count;
        let step = self.step([a_before, b_before], [a, b]);
        if step != 0 {
            self.count = self.count.wrapping_add_signed(step);
            self.stamp = stamp;
        }
        if index && !index_before {
            self.index(held);
        }
        let is_edge = probe != probe_before;
        if is_edge && probe == (self.control & PROBE_POLARITY != 0) {
            self.probe(held);
        }
    }

    fn step(&mut self, before: [bool; 2], after: [bool; 2]) -> i16 {
        if self.control & UP_DOWN != 0 {
            // A counts on its rising edge: up if B was high before the edge.
            return match (before, after) {
                ([false, true], [true, _]) => 1,
                ([false, false], [true, _]) => -1,
                _ => 0,
            };
        }
        match (quarter(after) + 4 - quarter(before)) % 4 {
            1 => 1,
            3 => -1,
            // Both lines changed at once: the direction is unknown.
            2 => {
                self.control |= QUADRATURE_ERROR;
                0
            }
            _ => 0,
        }
    }

    fn filter_length(&self) -> u8 {
        if self.control & LONG_FILTER != 0 {
            15
        } else {
            3
        }
    }

    /// Inputs of the filters: A, B, the index with its polarity and its gate, and the probe.
    fn inputs(&self) -> Lanes {
        let [a, b, index] = self.line;
        let polarity = self.control & AB_POLARITY != 0;
        let is_gated = self.control & GATE_WITH_AB != 0;
        let is_active = index == (self.control & INDEX_POLARITY != 0);
        let index = is_active && (!is_gated || (a == polarity && b == polarity));
        lanes([a, b, index, self.probe])
    }

    /// Handles the rise of the conditioned index. A count at the same time is lost if the index
    /// clears (FACTS 12.5).
    fn index(&mut self, held: u16) {
        let mask = self.control & MASK_POLARITY != 0;
        if self.control & USE_MASK != 0 && self.mask != mask {
            return;
        }
        if self.control & LATCH_ON_INDEX != 0 {
            self.latch = held;
        }
        if self.control & CLEAR_ON_INDEX != 0 {
            self.count = 0;
        }
        if self.control & JUST_ONCE != 0 {
            self.control &= !(LATCH_ON_INDEX | CLEAR_ON_INDEX);
        }
    }

    /// Handles the change of the probe to its active level.
    fn probe(&mut self, held: u16) {
        if !self.has_probe || self.control & LATCH_ON_PROBE == 0 {
            return;
        }
        self.latch = held;
        if self.control & JUST_ONCE != 0 {
            self.control &= !LATCH_ON_PROBE;
        }
    }
}

/// Quarter of a period of A and B: A leads when counting up.
fn quarter(ab: [bool; 2]) -> u8 {
    match ab {
        [false, false] => 0,
        [true, false] => 1,
        [true, true] => 2,
        [false, true] => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_taken_at_once_equal_samples_taken_one_by_one() {
        for length in [3_u8, 15] {
            for case in 0..=u16::MAX {
                // A and B with any contents, all lines with any levels.
                let [contents, bits] = case.to_le_bytes();
                let (a, b) = (contents & 0xF, contents >> 4);
                let spread = |bits: u8| lanes([0, 1, 2, 3].map(|bit| bits >> bit & 1 != 0));
                let before = Filters {
                    samples: u32::from_le_bytes([a, b, 0, 15]),
                    levels: spread(bits),
                };
                let lines = spread(bits >> 4);
                let most = before.uniform(lines, length);
                let mut one_by_one = before;
                for samples in 1..=most.unwrap_or(20) {
                    one_by_one.take(lines, length);
                    let mut at_once = before;
                    at_once.take_uniform(lines, length, if most.is_some() { samples } else { 0 });
                    let what = format!("{before:?}, lines {lines:08X}, {samples} of {length}");
                    assert_eq!(at_once.levels, one_by_one.levels, "{what}");
                    assert_eq!(at_once.samples, one_by_one.samples, "{what}");
                }
            }
        }
    }
}
