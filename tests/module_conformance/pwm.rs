//! The PWM generators.

use mesa_hal::sim::wire::Nanos;

use crate::Replay;
use crate::bench::{Bench, FpgaBench};
use crate::outcome::Outcome;
use crate::pins::pwm_firmware;
use crate::runner::{self, Rules, Watch};
use crate::transcript::{Duty, Event, Level, Transcript};

/// Edges exact, to the clock of 200 MHz; duties are counted from every clock of their windows.
pub const REPLAY: Option<Replay> = Some(replay);

/// The clock of the generators.
const CLOCK: Nanos = 5;

fn replay(transcript: &Transcript) -> Outcome {
    let mut bench = FpgaBench::new(pwm_firmware());
    let edges_left_out = transcript
        .comments
        .iter()
        .any(|text| text.contains("left out"));
    let rules = Rules {
        step: Some(CLOCK),
        watch: if edges_left_out {
            Watch::AtLines
        } else {
            Watch::ToLastLine
        },
        ..Rules::default()
    };
    let mut outcome = runner::replay(transcript, &mut bench, rules);
    for duty in &transcript.duties {
        compare_duty(transcript, duty, &mut outcome);
    }
    outcome
}

/// Counts the time in which a pin is high in a window, and its rising edges.
fn compare_duty(transcript: &Transcript, duty: &Duty, outcome: &mut Outcome) {
    let mut bench = FpgaBench::new(pwm_firmware());
    let entries = transcript.entries.iter();
    for entry in entries.take_while(|entry| entry.time <= duty.end - duty.of) {
        if let Event::Write { register, value } = &entry.event {
            bench.advance(entry.time);
            if let Err(reason) = bench.write(*register, *value) {
                return outcome.fail(entry.line, format!("{register:?}"), reason);
            }
        }
    }
    let (mut high, mut rising, mut before) = (0, 0, None);
    for time in (duty.end - duty.of..duty.end).step_by(CLOCK as usize) {
        bench.advance(time);
        let level = bench.pin(&duty.pin) == Ok(Level::High);
        high += if level { CLOCK } else { 0 };
        rising += u64::from(level && before == Some(false));
        before = Some(level);
    }
    outcome.compare(
        duty.line,
        (high, rising) == (duty.high, duty.rising),
        format!("{} high {} rising {}", duty.pin, duty.high, duty.rising),
        format!("high {high} rising {rising}"),
    );
}
