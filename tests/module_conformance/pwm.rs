//! The PWM generators; the driver's duties and rates.

use mesa_hal::modules::pwm::{PwmRate, PwmShape};
use mesa_hal_sim::wire::Nanos;

use crate::Replay;
use crate::bench::{Bench, FpgaBench};
use crate::common::recording::Outcome;
use crate::pins::pwm_firmware;
use crate::runner::{self, Rules, Watch};
use crate::transcript::{Duty, Entry, Event, Level, Transcript};

/// Edges exact, to the clock of 200 MHz; duties are counted from every clock of their windows.
pub const REPLAY: Replay = replay;

/// The clock of the generators, and its period.
const CLOCK_HZ: u32 = 200_000_000;
const CLOCK: Nanos = 5;

/// Full scale of an analog output in volts.
const FULL_SCALE: f64 = 10.0;

fn replay(transcript: &Transcript) -> Outcome {
    let mut bench = FpgaBench::new(pwm_firmware());
    let has = |text: &str| transcript.comments.iter().any(|line| line.contains(text));
    let rules = Rules {
        step: Some(CLOCK),
        watch: if has("edges of this file are left out") {
            Watch::AtLines
        } else {
            Watch::ToLastLine
        },
        ..Rules::default()
    };
    let mut outcome = runner::replay(transcript, &mut bench, rules);
    compare_duties(transcript, &mut outcome);
    if let Some(hz) = asked_hz(transcript) {
        compare_rate(transcript, hz, &mut outcome);
    }
    if has("offset mode as LinuxCNC") {
        compare_volts(transcript, &mut outcome);
    }
    outcome
}

/// Counts the time in which each pin is high in its window, and its rising edges.
fn compare_duties(transcript: &Transcript, outcome: &mut Outcome) {
    let windows = transcript
        .duties
        .chunk_by(|a, b| (a.end, a.of) == (b.end, b.of));
    for window in windows {
        let mut bench = FpgaBench::new(pwm_firmware());
        let mut writes = transcript
            .entries
            .iter()
            .filter(|entry| is_write(entry))
            .peekable();
        let mut counts = vec![Count::default(); window.len()];
        let (end, of) = (window[0].end, window[0].of);
        for time in (0..end).step_by(CLOCK as usize) {
            if let Some(entry) = writes.next_if(|entry| entry.time <= time) {
                bench.advance(time);
                write(&mut bench, entry, outcome);
            }
            if time >= end - of {
                bench.advance(time);
                for (duty, count) in window.iter().zip(&mut counts) {
                    count.take(bench.pin(&duty.pin) == Ok(Level::High));
                }
            }
        }
        for (duty, count) in window.iter().zip(counts) {
            compare_duty(duty, &count, outcome);
        }
    }
}

/// Counts of a pin.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    high: Nanos,
    rising: u64,
    level: Option<bool>,
}

impl Count {
    fn take(&mut self, level: bool) {
        self.high += if level { CLOCK } else { 0 };
        self.rising += u64::from(level && self.level == Some(false));
        self.level = Some(level);
    }
}

fn compare_duty(duty: &Duty, count: &Count, outcome: &mut Outcome) {
    outcome.compare(
        (count.high, count.rising) == (duty.high, duty.rising),
        duty.line,
        || {
            (
                format!("{} high {} rising {}", duty.pin, duty.high, duty.rising),
                format!("high {} rising {}", count.high, count.rising),
            )
        },
    );
}

fn is_write(entry: &Entry) -> bool {
    matches!(entry.event, Event::Write { .. })
}

fn write(bench: &mut FpgaBench, entry: &Entry, outcome: &mut Outcome) {
    if let Event::Write { register, value } = &entry.event
        && let Err(reason) = bench.write(*register, *value)
    {
        outcome.fail(entry.line, format!("{register:?}"), reason);
    }
}

/// The frequency that the file names for its rate: `RATE 64425 (48 kHz of a 200 MHz clock)`, or
/// LinuxCNC's for the 7I97.
fn asked_hz(transcript: &Transcript) -> Option<f64> {
    let comment = transcript.comments.first()?;
    if comment.contains("offset mode as LinuxCNC") {
        return Some(48_000.0);
    }
    let (_, rest) = comment.split_once(", RATE ")?;
    let (_, rest) = rest.split_once(" (")?;
    let (kilohertz, _) = rest.split_once(" kHz of a 200 MHz clock)")?;
    kilohertz.parse::<f64>().ok().map(|value| value * 1e3)
}

/// Checks that the driver's rate and width for a frequency are those of the file, and that its
/// frequency is that of the recorded edges.
fn compare_rate(transcript: &Transcript, hz: f64, outcome: &mut Outcome) {
    let rate = PwmRate::new(CLOCK_HZ, hz);
    if !has_width(transcript, rate.bits.into()) {
        // The width was not chosen as by the driver, which takes the widest.
        return;
    }
    for entry in &transcript.entries {
        let Event::Write { register, value } = &entry.event else {
            continue;
        };
        let (driver, mask) = match register.kind.name {
            "PWM_RATE" => (u32::from(rate.rate), u32::MAX),
            "PWM_MODE" => (u32::from(rate.bits - 9), 3),
            _ => continue,
        };
        outcome.compare(driver == value & mask, entry.line, || {
            (
                format!("the driver's {} {value:#010X}", register.kind.name),
                format!("{driver:#010X}"),
            )
        });
    }
    let pins = ["PWM0", "PWM1", "PWM2", "PWM3"].map(|pin| rising_edges(transcript, pin));
    let edges = pins.iter().max_by_key(|edges| edges.len());
    let edges = edges.map_or(&[][..], Vec::as_slice);
    let (Some((_, first)), Some((line, last))) = (edges.get(1), edges.last()) else {
        return outcome.fail(1, "rising edges".to_owned(), format!("{edges:?}"));
    };
    let periods = (edges.len() - 2) as f64;
    let recorded = (last - first) as f64 / periods;
    let pwm_clock = f64::from(CLOCK_HZ) * f64::from(rate.rate) / 65_536.0;
    let driver = 1e9 / (pwm_clock / f64::from(1 << rate.bits));
    outcome.compare(
        periods >= 3.0 && (recorded - driver).abs() <= CLOCK as f64 / periods,
        *line,
        || {
            (
                format!("a period of {recorded} ns"),
                format!("{driver} ns by the driver"),
            )
        },
    );
}

/// True if all modes that a file writes have this width.
fn has_width(transcript: &Transcript, bits: u32) -> bool {
    transcript.entries.iter().all(|entry| match &entry.event {
        Event::Write { register, value } if register.kind.name == "PWM_MODE" => {
            (value & 3) + 9 == bits
        }
        _ => true,
    })
}

/// Lines and times of a pin's rising edges.
fn rising_edges(transcript: &Transcript, name: &str) -> Vec<(usize, Nanos)> {
    let edges = transcript.entries.iter().filter_map(|entry| {
        let rises = matches!(&entry.event, Event::Pin { pin, level: Level::High } if pin == name);
        rises.then_some((entry.line, entry.time))
    });
    edges.collect()
}

/// Checks that the driver's words for the voltages of the recorded duties are the words written.
fn compare_volts(transcript: &Transcript, outcome: &mut Outcome) {
    let shape = PwmShape {
        bits: PwmRate::new(CLOCK_HZ, 48_000.0).bits,
        output_type: 1,
        offset: true,
        dither: false,
    };
    let mode = shape.mode();
    for entry in &transcript.entries {
        if let Event::Write { register, value } = &entry.event
            && register.kind.name == "PWM_MODE"
        {
            let (expected, actual) = (format!("mode {value:#04X}"), format!("{mode:#04X}"));
            outcome.compare(mode == *value, entry.line, || (expected, actual));
        }
    }
    for duty in &transcript.duties {
        let generator = duty
            .pin
            .strip_prefix("PWM")
            .and_then(|n| n.parse::<usize>().ok());
        let Some(&value) = generator.and_then(|n| duty.values.get(n)) else {
            continue;
        };
        let volts = (duty.high as f64 / duty.of as f64 * 2.0 - 1.0) * FULL_SCALE;
        let word = shape.encode(volts / FULL_SCALE);
        outcome.compare(word == value, duty.line, || {
            (
                format!("the driver's word for {volts} V {value:#010X}"),
                format!("{word:#010X}"),
            )
        });
    }
    let ends = [
        (-FULL_SCALE, 0),
        (0.0, 0x0800_0000),
        (FULL_SCALE, 0x0FFF_0000),
    ];
    for (volts, value) in ends {
        let word = shape.encode(volts / FULL_SCALE);
        let (expected, actual) = (format!("{volts} V {value:#010X}"), format!("{word:#010X}"));
        outcome.compare(word == value, 1, || (expected, actual));
    }
}
