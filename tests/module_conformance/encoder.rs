//! The encoders, plain and multiplexed, with the bench's circuits in front of their pins.

use std::collections::BTreeMap;

use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{SimFirmware, SimFpga, SimPinDescriptor, gtag, machines};

use crate::bench::{Bench, FpgaBench};
use crate::common::recording::{Outcome, Recording, files, own_directory};
use crate::register::Register;
use crate::runner::{self, Rules, Watch};
use crate::transcript::{Entry, Event, Level, Transcript};
use crate::{DIRECTORY, Replay, family};

/// Exact to the clock; differing reads are right if they are so within one period of the divider.
pub const REPLAY: Replay = replay;

/// The multiplexer's divider after configuration, in these sources.
const RATE: u32 = 11;
const RATE_REGISTER: u8 = 4;
/// Base address of the encoders in the recorded firmware, which have six registers.
const BASE: u16 = 0x3600;
/// The I/O pins of index masks and probe in the recording.
const FIRST_MASK: usize = 34;
const PROBE: usize = 40;
/// Latch on probe, and its polarity.
const PROBE_BITS: u32 = 0x3000;

const CLOCK_NANOS: Nanos = 10;
/// Lines of a pin that are no further apart show every edge between them.
const WINDOW: Nanos = 1_000;

/// The project's own recordings need no tolerance, whatever the phase of the dividers.
#[test]
fn reads_of_the_recordings_are_right_to_the_clock() {
    let mut reads = 0;
    for path in files(&own_directory(DIRECTORY)) {
        let transcript = Transcript::load(&path).expect("a recording");
        if matches!(family(&transcript.name), Some(("enc" | "qc", _))) {
            let mut exact = EncoderBench::new(&firmware(&transcript));
            let outcome = runner::replay(&transcript, &mut exact, rules(&transcript));
            assert_eq!(outcome.differences, [], "{}", transcript.name);
            reads += outcome.compared;
        }
    }
    assert!(reads > 900, "{reads} reads");
}

fn rules(transcript: &Transcript) -> Rules {
    Rules {
        step: None,
        watch: Watch::AtLines,
        skip: if counts_are_followed(transcript) {
            |_| false
        } else {
            |entry| matches!(&entry.event, Event::Read { register, .. } if is_count(*register))
        },
    }
}

fn replay(transcript: &Transcript) -> Outcome {
    let rules = rules(transcript);
    let firmware = firmware(transcript);
    let bench = || EncoderBench::new(&firmware);
    let mut exact = bench();
    let mut outcome = runner::replay(transcript, &mut exact, rules);
    if !outcome.differences.is_empty() {
        let period = longest_period(transcript);
        let delays: Vec<Nanos> = (0..period).step_by(10).collect();
        outcome = runner::replay_within(transcript, bench, &delays, rules);
    }
    compare_edges(transcript, &exact.edges, &mut outcome);
    if !counts_are_followed(transcript) {
        compare_rates(transcript, &mut bench(), &mut outcome);
    }
    outcome
}

/// The longest period of the divider that a file uses: of the multiplexer, which is two of them, or
/// of the plain encoders' filter.
fn longest_period(transcript: &Transcript) -> Nanos {
    let written = transcript
        .entries
        .iter()
        .filter_map(|entry| match entry.event {
            Event::Write { register, value }
                if register.kind.number == RATE_REGISTER
                    && register.kind.name.ends_with("ENC_RATE") =>
            {
                Some(value & 0x7FF)
            }
            _ => None,
        });
    let is_plain = is_plain(transcript);
    let rate = written.fold(if is_plain { 4 } else { RATE }, u32::max);
    let divider = Nanos::from(rate + 2) * CLOCK_NANOS;
    if is_plain { divider } else { 2 * divider }
}

fn is_plain(transcript: &Transcript) -> bool {
    transcript.name.starts_with("qc")
}

fn is_count(register: Register) -> bool {
    register.kind.number == 0
}

/// The firmware that a file was recorded on.
fn firmware(transcript: &Transcript) -> SimFirmware {
    let is_two_cards = transcript.name.starts_with("enc12");
    let mut firmware = if is_two_cards {
        machines::firmware_7i92_7i77x2()
    } else {
        machines::firmware_7i97(1)
    };
    firmware.mux_rate = RATE;
    let is_plain = is_plain(transcript);
    let tag = if is_plain {
        gtag::ENCODER
    } else {
        gtag::MUXED_ENCODER
    };
    if let Some(module) = firmware.module_mut(gtag::MUXED_ENCODER) {
        module.gtag = tag;
        (module.base, module.registers) = (BASE, 6);
        if is_plain {
            (module.version, module.instances) = (3, 4);
        }
    }
    if is_plain || has_mask_or_probe(transcript) {
        for unit in 0..6 {
            let pin = SimPinDescriptor::new(tag, unit, 0x04);
            firmware.pins[FIRST_MASK + usize::from(unit)] = pin;
        }
        firmware.pins[PROBE] = SimPinDescriptor::new(tag, 0, 0x05);
    }
    firmware
}

/// True if a file was recorded on firmware with these pins: it names them, or drives one, or reads
/// the bits of the probe as set, which are always 0 without it.
fn has_mask_or_probe(transcript: &Transcript) -> bool {
    let said = |text: &String| text.contains("with mask pins") || text.contains("with a probe pin");
    transcript.comments.iter().any(said) || transcript.entries.iter().any(shows_mask_or_probe)
}

fn shows_mask_or_probe(entry: &Entry) -> bool {
    match &entry.event {
        Event::Drive { pin, .. } | Event::Pin { pin, .. } => mask_or_probe(pin).is_some(),
        Event::Read { register, word } => {
            register.kind.name == "MENC_CONTROL" && word.value & PROBE_BITS != 0
        }
        _ => false,
    }
}

fn mask_or_probe(pin: &str) -> Option<usize> {
    match pin.strip_prefix("MASK") {
        Some(number) => number.parse().ok().map(|number: usize| FIRST_MASK + number),
        None => (pin == "PROBE").then_some(PROBE),
    }
}

/// An FPGA with encoders, and every edge of its select pins and of the outputs of its DPLL.
struct EncoderBench {
    inner: FpgaBench,
    levels: BTreeMap<&'static str, Level>,
    edges: BTreeMap<&'static str, Vec<(Nanos, Level)>>,
}

const PINS: [&str; 8] = [
    "MUXSEL", "MUXSEL_A", "MUXSEL_B", "REF", "TIMER1", "TIMER2", "TIMER3", "TIMER4",
];

impl EncoderBench {
    fn new(firmware: &SimFirmware) -> Self {
        Self {
            inner: FpgaBench::new(firmware.clone()),
            levels: BTreeMap::new(),
            edges: BTreeMap::new(),
        }
    }

    fn fpga(&mut self) -> &mut SimFpga {
        &mut self.inner.fpga
    }

    fn level(&self, pin: &str) -> Result<Level, String> {
        let output = PINS[3..].iter().position(|&name| name == pin);
        let Some(output) = output else {
            let fpga = &self.inner.fpga;
            let number = mask_or_probe(pin).map_or_else(|| self.inner.io_pin(pin), Ok)?;
            let level = fpga.driven_level(number);
            return Ok(level.map_or(Level::Released, to_level));
        };
        let fpga = &self.inner.fpga;
        let level = fpga
            .dpll()
            .and_then(|dpll| dpll.level(fpga.now(), output as u8));
        level
            .map(to_level)
            .ok_or_else(|| "there is no DPLL".to_owned())
    }

    fn note_edges(&mut self) {
        let now = self.inner.fpga.now();
        for pin in PINS {
            if let Ok(level) = self.level(pin)
                && self.levels.insert(pin, level) != Some(level)
            {
                self.edges.entry(pin).or_default().push((now, level));
            }
        }
    }
}

fn to_level(high: bool) -> Level {
    if high { Level::High } else { Level::Low }
}

impl Bench for EncoderBench {
    fn inner(&mut self) -> &mut FpgaBench {
        &mut self.inner
    }

    fn advance(&mut self, to: Nanos) {
        // A write may have moved a pin immediately.
        self.note_edges();
        loop {
            let next = (self.fpga().now() / CLOCK_NANOS + 1) * CLOCK_NANOS;
            if next > to {
                break;
            }
            self.inner.advance(next);
            self.note_edges();
        }
        self.inner.advance(to);
    }

    fn pin(&mut self, pin: &str) -> Result<Level, String> {
        self.level(pin)
    }

    fn drive(&mut self, pin: &str, level: Level) -> Result<(), String> {
        let Some(number) = mask_or_probe(pin) else {
            return self.inner.drive(pin, level);
        };
        let level = match level {
            Level::Low => Some(false),
            Level::High => Some(true),
            Level::Released | Level::Conflict => None,
        };
        self.fpga().drive_pin(number, level);
        Ok(())
    }

    fn encoder(&mut self, encoder: u8, abz: [bool; 3]) -> Result<(), String> {
        let now = self.fpga().now();
        let bank = self
            .fpga()
            .encoders()
            .ok_or("the firmware has no encoders")?;
        if usize::from(encoder) >= bank.encoders() {
            return Err(format!("the firmware has no encoder {encoder}"));
        }
        bank.set_lines(now, encoder.into(), abz);
        Ok(())
    }
}

/// Compares the edges of a pin where its lines follow each other closely: they are all edges there.
fn compare_edges(
    transcript: &Transcript,
    edges: &BTreeMap<&'static str, Vec<(Nanos, Level)>>,
    outcome: &mut Outcome,
) {
    let mut last: BTreeMap<&str, Nanos> = BTreeMap::new();
    for entry in &transcript.entries {
        let (pin, level) = match &entry.event {
            Event::Pin { pin, level } => (pin, level),
            // Another part of the file, where pins are shown anew.
            Event::Note(_) => {
                last.clear();
                continue;
            }
            _ => continue,
        };
        let Some(before) = last.insert(pin, entry.time) else {
            continue;
        };
        if before == entry.time || before + WINDOW < entry.time {
            continue;
        }
        let found = edges.get(pin.as_str()).into_iter().flatten();
        let found: Vec<_> = found
            .filter(|(at, _)| (before + 1..=entry.time).contains(at))
            .collect();
        let expected = format!("{pin} {level:?} at {}, and still before", entry.time);
        let same = found == [&(entry.time, *level)];
        outcome.compare(same, entry.line, || (expected, format!("{found:?}")));
    }
}

/// True if the counts of a file are those of its lines: all except those that exceed the rate that
/// the gateware follows.
fn counts_are_followed(transcript: &Transcript) -> bool {
    let name = &transcript.name;
    !name.starts_with("enc04") && !name.starts_with("qc02")
}

/// Compares the counts of a file with rates: exact where the recording has followed, and arbitrary
/// where it has not.
fn compare_rates(transcript: &Transcript, bench: &mut EncoderBench, outcome: &mut Outcome) {
    let mut wanted = None;
    for entry in &transcript.entries {
        bench.inner.advance(entry.time.saturating_sub(1));
        match &entry.event {
            Event::Note(note) => wanted = counts_of(note).or(wanted),
            Event::Read { register, word } if is_count(*register) => {
                let Ok(actual) = bench.read(*register) else {
                    continue;
                };
                let followed = |word: u32| Some(word & 0xFFFF) == wanted;
                let same = followed(word.value) == followed(actual);
                let expected = format!("{:#010X} of {wanted:?} counts", word.value);
                outcome.compare(same, entry.line, || (expected, format!("{actual:#010X}")));
            }
            Event::Write { register, value } => {
                bench.inner.advance(entry.time);
                let _ = bench.write(*register, *value);
            }
            Event::Encoder { encoder, abz } => {
                bench.inner.advance(entry.time);
                let _ = bench.encoder(*encoder, *abz);
            }
            _ => {}
        }
    }
}

/// `period 380 ns, 40 counts`.
fn counts_of(note: &str) -> Option<u32> {
    let words: Vec<&str> = note.split_whitespace().collect();
    match words.as_slice() {
        ["period", _, "ns,", counts, "counts"] => counts.parse().ok(),
        _ => None,
    }
}
