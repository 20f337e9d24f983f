//! Applies the stimuli of a recording to a bench, and compares the bench's values.

use std::collections::{BTreeMap, BTreeSet};

use mesa_hal_sim::UNDRIVEN;
use mesa_hal_sim::wire::Nanos;

use crate::bench::Bench;
use crate::common::recording::Outcome;
use crate::register::Register;
use crate::transcript::{BusWord, Entry, Event, Level, Transcript};

/// Time up to which a watched pin keeps the level of its last line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Watch {
    /// To the end of the file.
    Always,
    /// To its last line: the file shows its edges in one stretch.
    ToLastLine,
    /// Only at its lines: the file shows its edges in windows.
    AtLines,
}

/// Rules of comparison of a family.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// Steps in which pins are checked between two lines; `None`: at lines only.
    pub step: Option<Nanos>,
    /// Time for which pins are watched.
    pub watch: Watch,
    /// Lines that are not compared here, but by the family itself.
    pub skip: fn(&Entry) -> bool,
}

impl Default for Rules {
    fn default() -> Self {
        Self {
            step: Some(10),
            watch: Watch::Always,
            skip: |_| false,
        }
    }
}

/// A value of the bench at a recorded value.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Shown {
    Word(u32),
    Level(Level),
    /// The bench has no such register, pin or input.
    Failed(String),
    /// The line is only a stimulus, which was applied.
    Done,
}

/// Compares every read and every pin at its nanosecond, and checks that watched pins do not move
/// between their lines.
pub fn replay(transcript: &Transcript, bench: &mut impl Bench, rules: Rules) -> Outcome {
    let mut outcome = Outcome::default();
    let mut pins = Pins::new(transcript, rules);
    for group in groups(transcript) {
        let time = group[0].time;
        pins.hold(bench, time, group[0].line, &mut outcome);
        let shown = step(bench, group, 0);
        for (entry, shown) in group.iter().zip(shown) {
            compare(entry, &[shown], rules, &mut outcome);
            pins.take(entry);
        }
        pins.check(bench, group[0].line, &mut outcome);
    }
    outcome
}

/// Replays once for each of `delays`, by which all stimuli are delayed, and takes a value as right
/// if one of the replays shows it: the effect of a free-running divider depends on its phase.
pub fn replay_within<B: Bench>(
    transcript: &Transcript,
    bench: impl Fn() -> B,
    delays: &[Nanos],
    rules: Rules,
) -> Outcome {
    let replays: Vec<Vec<Shown>> = delays
        .iter()
        .map(|&delay| {
            let mut bench = bench();
            let groups = groups(transcript);
            groups
                .flat_map(|group| step(&mut bench, group, delay))
                .collect()
        })
        .collect();
    let mut outcome = Outcome::default();
    for (index, entry) in transcript.entries.iter().enumerate() {
        let shown: Vec<_> = replays.iter().map(|shown| shown[index].clone()).collect();
        compare(entry, &shown, rules, &mut outcome);
    }
    outcome
}

/// The lines of each time.
fn groups(transcript: &Transcript) -> impl Iterator<Item = &[Entry]> {
    transcript.entries.chunk_by(|a, b| a.time == b.time)
}

/// Applies the lines of one time: reads return the values before it, pins the levels after it.
fn step(bench: &mut impl Bench, group: &[Entry], delay: Nanos) -> Vec<Shown> {
    let time = group[0].time + delay;
    let mut shown = vec![Shown::Done; group.len()];
    bench.advance(time.saturating_sub(1));
    for (entry, shown) in group.iter().zip(&mut shown) {
        if let Event::Read { register, .. } = &entry.event {
            *shown = bench
                .read(*register)
                .map_or_else(Shown::Failed, Shown::Word);
        }
    }
    bench.advance(time);
    for (entry, shown) in group.iter().zip(&mut shown) {
        let applied = match &entry.event {
            Event::Write { register, value } => bench.write(*register, *value),
            Event::Drive { pin, level } => bench.drive(pin, *level),
            Event::Encoder { encoder, abz } => bench.encoder(*encoder, *abz),
            Event::Input { input, level } => bench.input(*input, *level),
            Event::Read { .. } | Event::Pin { .. } | Event::Note(_) => Ok(()),
        };
        if let Err(reason) = applied {
            *shown = Shown::Failed(reason);
        }
    }
    for (entry, shown) in group.iter().zip(&mut shown) {
        if let Event::Pin { pin, .. } = &entry.event {
            *shown = bench.pin(pin).map_or_else(Shown::Failed, Shown::Level);
        }
    }
    shown
}

/// Compares one line with the values shown; one right value is enough.
fn compare(entry: &Entry, shown: &[Shown], rules: Rules, outcome: &mut Outcome) {
    if let Some(Shown::Failed(reason)) = shown.first() {
        return outcome.fail(entry.line, format!("{:?}", entry.event), reason.clone());
    }
    if (rules.skip)(entry) {
        return;
    }
    let (same, expected): (fn(&Event, &Shown) -> bool, _) = match &entry.event {
        Event::Read { register, word } => (read_is_right, name(*register, *word)),
        Event::Pin { pin, level } => (pin_is_right, format!("{pin} {level:?}")),
        _ => return,
    };
    let right = shown.iter().any(|shown| same(&entry.event, shown));
    let actual = match shown {
        [Shown::Word(word)] => format!("{word:#010X}"),
        _ => format!("{shown:X?}"),
    };
    outcome.compare(right, entry.line, || (expected, actual));
}

fn read_is_right(event: &Event, shown: &Shown) -> bool {
    let (Event::Read { register, word }, Shown::Word(actual)) = (event, shown) else {
        return false;
    };
    let is_driven = word.driven != 0;
    if register.kind.readable.unwrap_or(is_driven) != is_driven {
        return false;
    }
    if is_driven {
        (actual ^ word.value) & word.driven == 0
    } else {
        *actual == UNDRIVEN
    }
}

fn pin_is_right(event: &Event, shown: &Shown) -> bool {
    let (Event::Pin { level, .. }, Shown::Level(actual)) = (event, shown) else {
        return false;
    };
    *level == Level::Conflict || level == actual
}

fn name(register: Register, word: BusWord) -> String {
    format!(
        "{}[{}] {:#010X} of {:#010X}",
        register.kind.name, register.index, word.value, word.driven
    )
}

/// The pins that a file watches.
struct Pins {
    rules: Rules,
    levels: BTreeMap<String, Level>,
    /// Line of the last level of each pin.
    last: BTreeMap<String, usize>,
    /// Pins that were found to have moved, until their next line.
    moved: BTreeSet<String>,
    now: Nanos,
}

impl Pins {
    fn new(transcript: &Transcript, rules: Rules) -> Self {
        let mut last = BTreeMap::new();
        for entry in &transcript.entries {
            if let Event::Pin { pin, .. } = &entry.event {
                last.insert(pin.clone(), entry.line);
            }
        }
        Self {
            rules,
            levels: BTreeMap::new(),
            last,
            moved: BTreeSet::new(),
            now: 0,
        }
    }

    /// Takes the level that a line gives to a pin.
    fn take(&mut self, entry: &Entry) {
        self.now = entry.time;
        let Event::Pin { pin, level } = &entry.event else {
            return;
        };
        self.moved.remove(pin);
        let ends = match self.rules.watch {
            Watch::Always => false,
            Watch::ToLastLine => self.last.get(pin) == Some(&entry.line),
            Watch::AtLines => true,
        };
        if ends {
            self.levels.remove(pin);
        } else {
            self.levels.insert(pin.clone(), *level);
        }
    }

    /// Lets time pass up to just before the next line; watched pins must not move.
    fn hold(&mut self, bench: &mut impl Bench, until: Nanos, line: usize, outcome: &mut Outcome) {
        let Some(step) = self.rules.step else {
            return;
        };
        while self.now + step < until {
            self.now += step;
            bench.advance(self.now);
            self.check(bench, line, outcome);
        }
        if self.now + 1 < until {
            bench.advance(until - 1);
            self.check(bench, line, outcome);
        }
    }

    /// Checks all watched pins; one that has moved is reported once, until its next line.
    fn check(&mut self, bench: &mut impl Bench, line: usize, outcome: &mut Outcome) {
        for (pin, level) in &self.levels {
            let actual = bench.pin(pin);
            let same = *level == Level::Conflict || actual.as_ref() == Ok(level);
            if !same && self.moved.insert(pin.clone()) {
                let expected = format!("{pin} {level:?} since its last line");
                outcome.fail(line, expected, format!("{actual:?} at about {}", self.now));
            }
        }
    }
}
