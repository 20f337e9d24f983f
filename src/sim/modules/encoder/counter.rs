//! One counter with its three lines: samples, filters, quadrature, index and latch.
//!
//! All steps are those of the gateware, sample by sample (recordings of the enc and qc families).
//! While nothing moves, no sample is looked at.

use super::clocks::{Clocks, Divider, Stamps};

const QUADRATURE_ERROR: u32 = 1 << 15;
const AB_POLARITY: u32 = 1 << 14;
pub(super) const LATCH_ON_PROBE: u32 = 1 << 13;
pub(super) const PROBE_POLARITY: u32 = 1 << 12;
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
/// From a load of the divider to the moment at which the sample counts: multiplexed, and plain.
const TO_COUNT: [Clocks; 2] = [6, 4];
/// How long before a sample a line has to be at its level: multiplexed, and plain.
const AHEAD: [Clocks; 2] = [3, 1];
/// From the write of COUNT to the moment at which the count is cleared.
const TO_CLEAR: Clocks = 2;

/// Levels of A, B and index.
pub(super) type Abz = [bool; 3];

/// Changes of the lines that no sample has seen yet. More than these within two samples are
/// glitches that none will see.
const WAITING: usize = 8;

/// One counter.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "they are lines")]
pub(super) struct Counter {
    /// Samples of even encoders are taken while the select line is low, of odd ones while it is
    /// high; plain encoders have all of them.
    place: Place,
    divider: Divider,
    count: u16,
    stamp: u16,
    control: u32,
    latch: u16,
    has_probe: bool,
    mask: bool,
    probe: bool,
    /// What the last sample saw, and what the lines do since.
    line: Abz,
    waiting: [(Clocks, Abz); WAITING],
    pending: usize,
    filters: [Filter; 3],
    /// A and B as they were counted last.
    counted: [bool; 2],
    /// The index as the control bits condition it: an event comes when it rises.
    index: bool,
    /// The first sample after configuration is not counted.
    is_started: bool,
    clears_at: Option<Clocks>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Even,
    Odd,
    Plain,
}

/// Counts up while its line is high and down while it is low; follows at the ends.
#[derive(Clone, Copy, Debug, Default)]
struct Filter {
    samples: u8,
    level: bool,
}

impl Filter {
    fn take(&mut self, line: bool, length: u8) {
        if line {
            self.samples = self.samples.max((self.samples + 1).min(length));
            self.level |= self.samples >= length;
        } else {
            self.samples = self.samples.saturating_sub(1);
            self.level &= self.samples > 0;
        }
    }

    fn is_settled(self, line: bool, length: u8) -> bool {
        self.level == line
            && if line {
                self.samples >= length
            } else {
                self.samples == 0
            }
    }
}

impl Counter {
    pub fn new(place: Place, divider: Divider, has_probe: bool, mask: bool, line: Abz) -> Self {
        Self {
            place,
            divider,
            count: 0,
            stamp: 0,
            control: 0,
            latch: 0,
            has_probe,
            mask,
            probe: false,
            line,
            waiting: [(0, line); WAITING],
            pending: 0,
            filters: [Filter::default(); 3],
            counted: [false; 2],
            index: false,
            is_started: false,
            clears_at: None,
        }
    }

    /// The lines have been like this for long, and nothing was counted.
    pub fn settle(&mut self, line: Abz) {
        let [a, b, _] = line;
        self.line = line;
        self.pending = 0;
        let length = self.filter_length();
        self.filters = line.map(|level| Filter {
            samples: if level { length } else { 0 },
            level,
        });
        self.counted = [a, b];
        self.index = self.conditioned_index();
    }

    /// What COUNT reads at the clock edge `now`. An access that takes no time after the write of
    /// COUNT, which a real bus has not, finds it done.
    pub fn count_word(&self, now: Clocks) -> u32 {
        let is_cleared = self.clears_at == Some(now + TO_CLEAR);
        let count = if is_cleared { 0 } else { self.count };
        u32::from(count) | u32::from(self.stamp) << 16
    }

    /// What CONTROL reads. Without a probe pin the bits of the probe read 0.
    pub fn control_word(&self) -> u32 {
        let absent = if self.has_probe {
            0
        } else {
            LATCH_ON_PROBE | PROBE_POLARITY
        };
        let [a, b, _] = self.filters.map(|filter| u32::from(filter.level));
        let live = a | b << 1 | u32::from(self.index) << 2;
        u32::from(self.latch) << 16 | self.control & !absent | live
    }

    pub fn set_rate(&mut self, now: Clocks, register: u32) {
        self.divider.write(now, register);
    }

    pub fn set_mask(&mut self, level: bool) {
        self.mask = level;
    }

    /// COUNT was written.
    pub fn clear(&mut self, now: Clocks) {
        self.clears_at = Some(now + TO_CLEAR);
    }

    /// CONTROL was written.
    pub fn set_control(&mut self, value: u32) {
        // Writing a 1 takes back the quadrature error.
        let error = self.control & QUADRATURE_ERROR & !value;
        self.control = value & 0xFFFF & !(LIVE | QUADRATURE_ERROR) | error;
    }

    pub fn disturb(&mut self) {
        self.control |= QUADRATURE_ERROR;
    }

    pub fn set_probe(&mut self, level: bool) {
        let is_edge = level != core::mem::replace(&mut self.probe, level);
        let is_active = level == (self.control & PROBE_POLARITY != 0);
        let is_wanted = self.has_probe && self.control & LATCH_ON_PROBE != 0;
        if is_edge && is_active && is_wanted {
            self.latch = self.count;
            if self.control & JUST_ONCE != 0 {
                self.control &= !LATCH_ON_PROBE;
            }
        }
    }

    /// The lines change, so that samples from the clock edge `next` on can see it: the first edge
    /// that is not before the change.
    pub fn set_lines(&mut self, next: Clocks, abz: Abz) {
        let [muxed, plain] = AHEAD;
        let seen = next
            + if self.place == Place::Plain {
                plain
            } else {
                muxed
            };
        let last = self.pending.min(WAITING - 1);
        if let Some(place) = self.waiting.get_mut(last) {
            *place = (seen, abz);
        }
        self.pending = last + 1;
    }

    /// Takes all samples that count up to the clock edge `to`.
    pub fn advance(&mut self, to: Clocks, stamps: &Stamps) {
        if let Some(at) = self.clears_at.filter(|&at| at <= to) {
            self.sample_to(at.saturating_sub(1), stamps);
            self.clears_at = None;
            self.count = 0;
            if self.control & JUST_ONCE != 0 {
                self.control &= !CLEAR_ON_INDEX;
            }
        }
        self.sample_to(to, stamps);
    }

    fn sample_to(&mut self, to: Clocks, stamps: &Stamps) {
        let [muxed, plain] = TO_COUNT;
        let delay = if self.place == Place::Plain {
            plain
        } else {
            muxed
        };
        loop {
            if self.pending == 0 && self.is_settled() {
                self.divider.skip(to.saturating_sub(delay), 2);
            }
            let mut divider = self.divider;
            divider.step();
            // Multiplexed encoders count once in two loads, all of them at the same time.
            if self.place != Place::Plain && divider.count().is_multiple_of(2) {
                divider.step();
            }
            let [load, before, second] = divider.loaded();
            if load + delay > to {
                return;
            }
            self.divider = divider;
            let sampled = match self.place {
                Place::Plain => load,
                Place::Even => before + TO_SELECT,
                Place::Odd => second + TO_SELECT,
            };
            self.look(sampled);
            let stamp = stamps.after((load + delay).saturating_sub(1));
            self.count(stamp as u16);
        }
    }

    /// Whether samples of the present lines change nothing.
    fn is_settled(&self) -> bool {
        let length = self.filter_length();
        let filters = self.filters.iter().zip(self.line);
        let [a, b, _] = self.line;
        self.is_started
            && filters
                .into_iter()
                .all(|(f, line)| f.is_settled(line, length))
            && self.counted == [a, b]
            && self.index == self.conditioned_index()
    }

    /// The lines at the clock edge of a sample.
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

    /// What the filters have let through is counted; then the filters take the sample.
    fn count(&mut self, stamp: u16) {
        if !core::mem::replace(&mut self.is_started, true) {
            return;
        }
        let [a, b, _] = self.filters.map(|filter| filter.level);
        let before = core::mem::replace(&mut self.counted, [a, b]);
        let held = self.count;
        let step = self.step(before, [a, b]);
        if step != 0 {
            self.count = self.count.wrapping_add_signed(step);
            self.stamp = stamp;
        }
        self.look_at_index(held);
        let length = self.filter_length();
        for (filter, line) in self.filters.iter_mut().zip(self.line) {
            filter.take(line, length);
        }
    }

    fn step(&mut self, before: [bool; 2], after: [bool; 2]) -> i16 {
        if self.control & UP_DOWN != 0 {
            // A counts on its rising edge; up when B is high.
            return match (before, after) {
                ([false, _], [true, true]) => 1,
                ([false, _], [true, false]) => -1,
                _ => 0,
            };
        }
        match (quarter(after) + 4 - quarter(before)) % 4 {
            1 => 1,
            3 => -1,
            // Both lines at once: no telling which way.
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

    /// Polarity, and the gate with A and B.
    fn conditioned_index(&self) -> bool {
        let [a, b, index] = self.filters.map(|filter| filter.level);
        let polarity = self.control & AB_POLARITY != 0;
        let gated = self.control & GATE_WITH_AB != 0;
        let is_active = index == (self.control & INDEX_POLARITY != 0);
        is_active && (!gated || (a == polarity && b == polarity))
    }

    /// An index that comes together with a count latches the count before it, and swallows it when
    /// it clears (FACTS 12.5).
    fn look_at_index(&mut self, held: u16) {
        let index = self.conditioned_index();
        let rises = index && !self.index;
        self.index = index;
        let mask = self.control & MASK_POLARITY != 0;
        if !rises || (self.control & USE_MASK != 0 && self.mask != mask) {
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
}

/// Where in a period of A and B: A leads when it counts up.
fn quarter(ab: [bool; 2]) -> u8 {
    match ab {
        [false, false] => 0,
        [true, false] => 1,
        [true, true] => 2,
        [false, true] => 3,
    }
}
