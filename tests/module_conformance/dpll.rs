//! The DPLL: its registers, the edges of its outputs, and the words that the driver computes for
//! it.

use std::collections::BTreeSet;

use mesa_hal::modules::dpll::DpllConfig;
use mesa_hal_sim::machines;
use mesa_hal_sim::wire::Nanos;

use crate::Replay;
use crate::bench::{Bench, FpgaBench};
use crate::common::recording::Outcome;
use crate::runner::{self, Rules, Watch};
use crate::transcript::{Event, Level, Transcript};

/// Everything exact, to the clock.
pub const REPLAY: Replay = replay;

/// Reference and timers.
const OUTPUTS: [&str; 5] = ["REF", "TIMER1", "TIMER2", "TIMER3", "TIMER4"];

const CLOCK: u32 = 100_000_000;

/// One clock.
const CLOCK_NANOS: Nanos = 10;

const DDS_BITS: u8 = 42;

/// An edge: its time, its output, and true if it rises.
type Edge = (Nanos, usize, bool);

fn replay(transcript: &Transcript) -> Outcome {
    let mut bench = DpllBench::new();
    let rules = Rules {
        step: None,
        watch: Watch::AtLines,
        ..Rules::default()
    };
    let mut outcome = runner::replay(transcript, &mut bench, rules);
    compare_edges(transcript, &bench.edges, &mut outcome);
    compare_set_up(transcript, &mut outcome);
    outcome
}

/// A 7I97, and all edges of its DPLL's outputs.
struct DpllBench {
    inner: FpgaBench,
    now: Nanos,
    levels: [bool; 5],
    edges: BTreeSet<Edge>,
}

impl DpllBench {
    fn new() -> Self {
        Self {
            inner: FpgaBench::new(machines::firmware_7i97(1)),
            now: 0,
            levels: [true; 5],
            edges: BTreeSet::new(),
        }
    }

    fn level(&self, output: usize) -> Result<bool, String> {
        let dpll = self.inner.fpga.dpll();
        let level = dpll.and_then(|dpll| dpll.level(self.now, output as u8));
        level.ok_or_else(|| "the firmware has no DPLL".to_owned())
    }

    fn note(&mut self, output: usize, at: Nanos, level: bool) {
        if std::mem::replace(&mut self.levels[output], level) != level {
            self.edges.insert((at, output, level));
        }
    }
}

impl Bench for DpllBench {
    fn inner(&mut self) -> &mut FpgaBench {
        &mut self.inner
    }

    fn advance(&mut self, to: Nanos) {
        for output in 0..OUTPUTS.len() {
            // The effect of a write shows at the clock edge that takes it over.
            if let Ok(level) = self.level(output) {
                self.note(output, self.now.next_multiple_of(CLOCK_NANOS), level);
            }
            let mut from = self.now;
            let dpll = self.inner.fpga.dpll().copied();
            while let Some((at, level)) = dpll.and_then(|dpll| dpll.next_change(from, output as u8))
                && at <= to
            {
                self.note(output, at, level);
                from = at;
            }
        }
        self.inner.advance(to);
        self.now = to;
    }

    fn pin(&mut self, pin: &str) -> Result<Level, String> {
        let output = OUTPUTS.iter().position(|&name| name == pin);
        let output = output.ok_or_else(|| format!("{pin} is no output of a DPLL"))?;
        Ok(if self.level(output)? {
            Level::High
        } else {
            Level::Low
        })
    }
}

/// Compares the edges in each window in which a file shows them, each at its clock.
fn compare_edges(transcript: &Transcript, edges: &BTreeSet<Edge>, outcome: &mut Outcome) {
    for (begin, end) in windows(transcript) {
        let mut missing: BTreeSet<Edge> = edges
            .iter()
            .filter(|(at, ..)| (begin + 1..end).contains(at))
            .copied()
            .collect();
        for entry in &transcript.entries {
            let Event::Pin { pin, level } = &entry.event else {
                continue;
            };
            let output = OUTPUTS.iter().position(|name| name == pin);
            let (true, Some(output)) = (begin < entry.time && entry.time <= end, output) else {
                continue;
            };
            let edge = (entry.time, output, *level == Level::High);
            missing.remove(&edge);
            let expected = format!("{pin} {level:?} at {}", entry.time);
            let actual = format!("no such edge in the window from {begin}");
            outcome.compare(edges.contains(&edge), entry.line, || (expected, actual));
        }
        for (at, output, level) in missing {
            let actual = format!("{} {level} at {at}", OUTPUTS[output]);
            outcome.fail(0, "no edge".to_owned(), actual);
        }
    }
}

/// Time spans in which all edges are shown: those of the notes, or else from the first edge on.
fn windows(transcript: &Transcript) -> Vec<(Nanos, Nanos)> {
    let last = transcript.entries.last().map_or(0, |entry| entry.time);
    let mut windows = Vec::new();
    for entry in &transcript.entries {
        match &entry.event {
            Event::Note(text) if text.starts_with("window: ") => windows.push((entry.time, last)),
            Event::Note(text) if text.starts_with("window ends") => {
                if let Some(window) = windows.last_mut() {
                    window.1 = entry.time;
                }
            }
            _ => {}
        }
    }
    if windows.is_empty() {
        let mut pins = transcript.entries.iter();
        let first = pins.find(|entry| matches!(entry.event, Event::Pin { .. }));
        windows.extend(first.map(|first| (first.time, last)));
    }
    windows
}

/// "registers as LinuxCNC computes them for N Hz": the driver computes the same words.
fn compare_set_up(transcript: &Transcript, outcome: &mut Outcome) {
    let said = transcript.comments.iter().find_map(|comment| {
        comment
            .trim()
            .strip_prefix("registers as LinuxCNC computes them for ")
    });
    let Some(hz) = said.and_then(|text| text.split_whitespace().next()) else {
        return;
    };
    let Ok(hz) = hz.parse::<f64>() else {
        return outcome.fail(0, "a rate in Hz".to_owned(), hz.to_owned());
    };
    let written = |name: &str| {
        transcript
            .entries
            .iter()
            .find_map(|entry| match entry.event {
                Event::Write { register, value } if register.kind.name == name => {
                    Some((entry.line, value))
                }
                _ => None,
            })
    };
    let word = |name: &str| written(name).map_or(0, |(_, word)| word);
    let (timers_12, timers_34) = (word("DPLL_T12"), word("DPLL_T34"));
    let timers = [timers_12, timers_12 >> 16, timers_34, timers_34 >> 16];
    let config = DpllConfig {
        hz,
        phase_limit: word("DPLL_CTL0") & 0x00FF_FFFF,
        time_constant: (word("DPLL_CTL1") >> 16) as u16,
        timers_us: timers.map(|timer| offset_us(timer as u16, hz)),
    };
    let Ok(words) = config.words(CLOCK, DDS_BITS) else {
        return outcome.fail(0, format!("{hz} Hz"), "out of reach".into());
    };
    let names = [
        "DPLL_BASE",
        "DPLL_CTL0",
        "DPLL_CTL1",
        "DPLL_T12",
        "DPLL_T34",
    ];
    for (name, word) in names.into_iter().zip(words) {
        if let Some((line, expected)) = written(name) {
            let (expected, actual) = (
                format!("{name} {expected:#010X}"),
                format!("{name} {word:#010X}"),
            );
            outcome.compare(expected == actual, line, || (expected, actual));
        }
    }
}

/// The offset that a timer's word stands for, which is before the read: a number of thousandths of
/// a period if possible, or else the middle of all offsets with this word.
fn offset_us(timer: u16, hz: f64) -> f64 {
    let word = f64::from(timer as i16);
    let thousandths = (word * 1e3 / 65_536.0).round();
    // The driver truncates toward zero. 100 us after the read were recorded as E666, which the
    // driver computes from a slightly larger offset.
    let is_round = (thousandths * 65.536).trunc() == word;
    let middle = word + 0.5_f64.copysign(word);
    let periods = if is_round {
        thousandths / 1e3
    } else {
        middle / 65_536.0
    };
    -periods * 1e6 / hz
}
