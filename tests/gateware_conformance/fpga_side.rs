//! The FPGA side: plays the host's lines and the remotes' recorded replies against the simulated
//! port, and compares every value, every byte and every time.
//!
//! Times are compared from event to event, because absolute times drift: a poll ends when the
//! simulated COMMAND reads 0, and a reply follows the end of the simulated request at its recorded
//! latency.

use mesa_hal_sim::sslbp::{PortConfig, Register, SslbpPort};
use mesa_hal_sim::wire::Nanos;

use crate::common::recording::Outcome;
use crate::common::recording::sslbp::{Entry, Event, Transcript};
use crate::phase::PhaseRule;
use crate::wire_log::WireLog;
use crate::wire_log::{TOLERANCE, within_tolerance};

/// Distance of the samples of a poll: 40 ns, the first one 20 ns after the previous access.
const SAMPLE: Nanos = 40;
const FIRST_SAMPLE: Nanos = 20;
/// A poll gives up when COMMAND is not 0 this much later than recorded, plus a quarter.
const GIVE_UP: Nanos = 400_000;
/// A poll sees that COMMAND is 0 when it has been 0 for this time: the recorder's own next write
/// came immediately, and would have been swallowed (FACTS 3.4).
const SETTLED: Nanos = 20;

/// A reply that arrives when it is no longer awaited meets the frames that go on without it at some
/// place, and a fraction of a microsecond decides which characters meet (index.txt, "Ties"): a file
/// with such a reply agrees if it agrees with one of these offsets, in nanoseconds.
const TIES: [i64; 3] = [0, -200, 200];
/// Where an overrun depends on it, that fraction is a clock cycle: FACTS 11.8.
const CLOSE_TIES: core::ops::RangeInclusive<i64> = -300..=300;
const CYCLE: usize = 10;

/// Replays a whole transcript.
pub fn replay(transcript: &Transcript) -> Outcome {
    let rule = PhaseRule::of(&transcript.name);
    let ties = match WireLog::new(transcript, 0).has_late_replies() {
        true if rule.has_overrun() => CLOSE_TIES.step_by(CYCLE).collect(),
        true => TIES.to_vec(),
        false => vec![0],
    };
    let mut best: Option<Outcome> = None;
    for tie in ties {
        let outcome = replay_tied(transcript, rule, tie);
        let differing = outcome.differences.len();
        if best
            .as_ref()
            .is_none_or(|best| differing < best.differences.len())
        {
            best = Some(outcome);
        }
        if differing == 0 {
            break;
        }
    }
    best.expect("at least one replay")
}

/// Replays a whole transcript; `rule` defines the permitted differences.
pub fn replay_with(transcript: &Transcript, rule: PhaseRule) -> Outcome {
    replay_tied(transcript, rule, 0)
}

/// Replays a whole transcript with late replies moved by `tie` nanoseconds.
fn replay_tied(transcript: &Transcript, rule: PhaseRule, tie: i64) -> Outcome {
    let config = PortConfig::new(transcript.channels, transcript.clock_hz);
    let mut replay = Replay {
        port: SslbpPort::new(config),
        wire: WireLog::new(transcript, tie),
        rule,
        outcome: Outcome::default(),
        now: 0,
        recorded: 0,
    };
    let host: Vec<&Entry> = transcript
        .entries
        .iter()
        .filter(|entry| is_host(&entry.event))
        .collect();
    let mut rest = host.as_slice();
    while let [entry, ..] = rest {
        let length = sampling_length(rest);
        let (run, after) = rest.split_at(length);
        if length > 1 {
            let end = after
                .first()
                .map_or(run[length - 1].time, |next| begin(next));
            replay.sampled(run, end);
        } else {
            replay.host_line(entry);
        }
        rest = after;
    }
    let end = transcript.entries.last().map_or(0, |entry| entry.time);
    replay.finish(end)
}

fn is_host(event: &Event) -> bool {
    matches!(
        event,
        Event::Write { .. } | Event::Read { .. } | Event::Poll { .. }
    ) || is_line_low(event)
}

/// True if the line of a remote goes low: the port has to see it at that time (FACTS 11.6).
fn is_line_low(event: &Event) -> bool {
    matches!(event, Event::Remote { text, .. } if text == "idle=0")
}

/// Start of a host line: a poll's time is its end.
fn begin(entry: &Entry) -> Nanos {
    match entry.event {
        Event::Poll { waited, .. } => entry.time - waited - 10,
        _ => entry.time,
    }
}

/// Number of the next lines that are one sampling: reads of one register, each with another value.
fn sampling_length(lines: &[&Entry]) -> usize {
    let mut length = 1;
    for pair in lines.windows(2) {
        let [a, b] = pair else { break };
        match (&a.event, &b.event) {
            (
                Event::Read { register, value },
                Event::Read {
                    register: next,
                    value: other,
                },
            ) if register == next && value != other => length += 1,
            _ => break,
        }
    }
    length
}

/// True if two reads that look like a sampling are just two reads, each with its right value at its
/// own time.
fn is_plain(expected: &[(u32, Nanos)], actual: &[(u32, Nanos)]) -> bool {
    let held = |time: Nanos| {
        let before = actual.iter().rev().find(|&&(_, at)| at <= time);
        before.map(|&(value, _)| value)
    };
    expected.len() == 2
        && expected
            .iter()
            .all(|&(value, time)| held(time) == Some(value))
}

struct Replay<'t> {
    port: SslbpPort,
    wire: WireLog<'t>,
    rule: PhaseRule,
    outcome: Outcome,
    /// Simulated time of the last host action, and the recorded one.
    now: Nanos,
    recorded: Nanos,
}

impl Replay<'_> {
    /// Goes to the recorded time `to`, which must not be before the last host action.
    fn go_to(&mut self, to: Nanos) {
        self.now += to - self.recorded;
        self.recorded = to;
        self.port.advance(self.now, &mut self.wire);
        self.wire.host_acted(self.recorded, self.now);
    }

    fn host_line(&mut self, entry: &Entry) {
        match entry.event {
            Event::Write { register, value } => {
                self.go_to(entry.time);
                self.rule.saw_write(register, value, self.now);
                self.port.write(self.now, register, value);
            }
            Event::Read { register, value } => {
                self.go_to(entry.time);
                let actual = self.port.read(self.now, register);
                self.compare_value(entry.line, register, value, actual);
            }
            Event::Poll {
                value,
                waited,
                timed_out,
            } => self.poll(entry, value, waited, timed_out),
            _ => self.go_to(entry.time),
        }
    }

    fn compare_value(&mut self, line: usize, register: Register, expected: u32, actual: u32) {
        let equal = expected == actual || self.rule.allows(register, expected, actual, self.now);
        self.outcome.compare(equal, line, || {
            (
                format!("{register:?} reads {expected:08X}"),
                format!("{actual:08X}"),
            )
        });
    }

    fn poll(&mut self, entry: &Entry, value: u32, waited: Nanos, timed_out: bool) {
        if begin(entry) > self.recorded {
            self.go_to(begin(entry));
        }
        let from = self.now;
        let limit = if timed_out {
            waited
        } else {
            waited + waited / 4 + GIVE_UP
        };
        let mut sample = from + FIRST_SAMPLE;
        let mut actual = None;
        let uneven = self.wire.uneven_chatter();
        while sample <= from + limit + 10 {
            self.port.advance(sample - SETTLED, &mut self.wire);
            let zero_before = self.port.read(sample - SETTLED, Register::Command) == 0;
            self.port.advance(sample, &mut self.wire);
            if zero_before && self.port.read(sample, Register::Command) == 0 {
                actual = Some(sample - from - 10);
                break;
            }
            let clearing = self.port.read(sample, Register::Command) == 0;
            sample = if clearing {
                sample + SAMPLE
            } else {
                self.next_sample(sample, from + limit)
            };
        }
        self.now = sample.min(from + limit + 10);
        self.port.advance(self.now, &mut self.wire);
        self.recorded = entry.time;
        self.wire.host_acted(self.recorded, self.now);
        let reads = self.port.read(self.now, Register::Command);
        self.compare_value(entry.line, Register::Command, value, reads);
        let close = match actual {
            Some(actual) if !timed_out => {
                let more = self.wire.uneven_chatter().saturating_sub(uneven);
                within_tolerance(waited, actual)
                    || waited.abs_diff(actual) <= TOLERANCE + more && more != 0
            }
            _ => timed_out == actual.is_none(),
        };
        let allowed = close || self.rule.allows_wait(self.now);
        self.outcome.compare(allowed, entry.line, || {
            (
                format!("COMMAND is 0 after {waited} ns, timed out: {timed_out}"),
                format!("{actual:?}"),
            )
        });
    }

    /// The next sample at which COMMAND can have changed.
    fn next_sample(&self, sample: Nanos, end: Nanos) -> Nanos {
        let event = self.port.next_event().unwrap_or(end).min(end).max(sample);
        sample + (event - sample).div_ceil(SAMPLE).max(1) * SAMPLE
    }

    /// A register sampled all the time, of which only the changes were recorded.
    fn sampled(&mut self, run: &[&Entry], end: Nanos) {
        let [first, ..] = run else { return };
        let Event::Read { register, .. } = first.event else {
            return;
        };
        self.go_to(first.time);
        let start = self.now;
        let mut seen = vec![(self.port.read(start, register), start)];
        let stop = start + (end - first.time);
        let mut time = start;
        while time < stop {
            let event = self.port.next_event().unwrap_or(stop);
            time = event.max(time + 50).min(stop);
            self.port.advance(time, &mut self.wire);
            let value = self.port.read(time, register);
            if seen.last().is_none_or(|&(last, _)| last != value) {
                seen.push((value, time));
            }
        }
        let expected: Vec<(u32, Nanos)> = run
            .iter()
            .filter_map(|entry| match entry.event {
                Event::Read { value, .. } => Some((value, entry.time - first.time)),
                _ => None,
            })
            .collect();
        let actual: Vec<(u32, Nanos)> = seen.iter().map(|&(v, t)| (v, t - start)).collect();
        if is_plain(&expected, &actual) {
            for (entry, &(value, _)) in run.iter().zip(&expected) {
                self.compare_value(entry.line, register, value, value);
            }
        } else {
            self.compare_samples(first.line, register, &expected, &actual);
        }
    }

    fn compare_samples(
        &mut self,
        line: usize,
        register: Register,
        expected: &[(u32, Nanos)],
        actual: &[(u32, Nanos)],
    ) {
        let expected = self.rule.normalise(expected);
        let actual = self.rule.normalise(actual);
        let number = (expected.len(), actual.len());
        self.outcome.compare(number.0 == number.1, line, || {
            (
                format!("{register:?} takes {} values", number.0),
                format!("{}", number.1),
            )
        });
        for (n, (&(value, time), &(other, at))) in expected.iter().zip(&actual).enumerate() {
            self.outcome.compare(value == other, line, || {
                (
                    format!("{register:?} is {value:08X} as value {n} of the sampling"),
                    format!("{other:08X}"),
                )
            });
            self.outcome.compare(within_tolerance(time, at), line, || {
                (
                    format!("{register:?} becomes {value:08X} after {time} ns"),
                    format!("{at} ns"),
                )
            });
        }
    }

    fn finish(mut self, end: Nanos) -> Outcome {
        self.go_to(end.max(self.recorded));
        self.port.advance(self.now + 15_000, &mut self.wire);
        let mut outcome = self.wire.finish();
        outcome.add(self.outcome);
        outcome
    }
}
