//! The simulated remotes against the recorded requests: bytes, times and events must be those of
//! the recorded remotes.

use mesa_hal_sim::remote::{FixedData, RemoteEvent, SimRemote};
use mesa_hal_sim::wire::{Burst, Nanos, RemoteEnd};

use crate::common::recording::Outcome;
use crate::common::recording::sslbp::{Event, Transcript};

/// Here times are those of the remote model, not of firmware, so that the limit is much narrower
/// than the 15 us of the index: the recording has a resolution of 10 ns.
const RESOLUTION: Nanos = 50;

/// An action of a remote, recorded or simulated.
#[derive(Clone, Debug)]
struct Deed {
    line: usize,
    time: Nanos,
    what: What,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum What {
    Reply { is_break: bool, bytes: Vec<u8> },
    Event(String),
}

/// A stimulus for a remote.
enum Stimulus<'t> {
    SetUp(&'t str),
    Request(Burst),
}

/// All stimuli and actions of one remote.
#[derive(Default)]
struct Channel<'t> {
    stimuli: Vec<(Nanos, usize, Stimulus<'t>)>,
    recorded: Vec<Deed>,
}

/// Plays the recorded requests and set-up lines against simulated remotes.
pub fn replay(transcript: &Transcript) -> Outcome {
    let mut channels: [Channel<'_>; 8] = std::array::from_fn(|_| Channel::default());
    let end = read(transcript, &mut channels);
    let mut outcome = Outcome::default();
    for channel in &channels {
        outcome.add(compare(channel, end));
    }
    outcome
}

/// Sorts the lines by remote; returns the time at which the recording of the wire ends.
fn read<'t>(transcript: &'t Transcript, channels: &mut [Channel<'t>; 8]) -> Nanos {
    let mut end = 0;
    for entry in &transcript.entries {
        end = entry.time;
        match &entry.event {
            Event::WireLogOff => break,
            Event::Remote { remote, text } => {
                let channel = &mut channels[usize::from(*remote)];
                if is_event(text) {
                    channel.recorded.push(Deed {
                        line: entry.line,
                        time: entry.time,
                        what: What::Event(text.clone()),
                    });
                } else {
                    let set_up = Stimulus::SetUp(text);
                    channel.stimuli.push((entry.time, entry.line, set_up));
                }
            }
            Event::FromFpga {
                channel,
                start,
                bytes,
            } => {
                let bits = 10 * bytes.len() as Nanos;
                let bit = (entry.time - start + bits / 2) / bits;
                let burst = Burst::new(*start, bit, bytes);
                // A remote has a character in the middle of its stop bit.
                channels[usize::from(*channel)].stimuli.push((
                    entry.time - bit / 2,
                    entry.line,
                    Stimulus::Request(burst),
                ));
            }
            Event::ToFpga {
                channel,
                start,
                is_break,
                bytes,
            } => channels[usize::from(*channel)].recorded.push(Deed {
                line: entry.line,
                time: *start,
                what: What::Reply {
                    is_break: *is_break,
                    bytes: bytes.clone(),
                },
            }),
            _ => {}
        }
    }
    for channel in channels {
        channel.stimuli.sort_by_key(|&(time, line, _)| (time, line));
        channel.recorded.sort_by_key(|deed| deed.time);
    }
    end
}

/// True for reports of the model itself, in contrast to set-up.
fn is_event(text: &str) -> bool {
    text == "watchdog bites"
        || text == "drops this reply"
        || text.starts_with("next reply is ")
        || text.starts_with("parser timeout")
}

/// A third party's remote, whose answers are not known (index.txt).
fn is_foreign(stimulus: &Stimulus<'_>) -> bool {
    matches!(stimulus, Stimulus::SetUp(text)
        if text.split_whitespace().any(|pair| pair.starts_with("exec=")))
}

fn compare(channel: &Channel<'_>, end: Nanos) -> Outcome {
    let mut outcome = Outcome::default();
    if channel
        .stimuli
        .iter()
        .any(|(_, _, stimulus)| is_foreign(stimulus))
    {
        return outcome;
    }
    let mut remote = SimRemote::model();
    let mut done = Vec::new();
    for (time, line, stimulus) in &channel.stimuli {
        remote.advance(*time);
        match stimulus {
            Stimulus::SetUp(text) => {
                let result = remote.apply(text);
                outcome.compare(result.is_ok(), *line, || {
                    ((*text).to_owned(), format!("{result:?}"))
                });
            }
            Stimulus::Request(burst) => remote.receive(burst),
        }
        collect(&mut remote, *line, &mut done);
    }
    remote.advance(end);
    collect(&mut remote, 0, &mut done);
    done.sort_by_key(|deed| deed.time);
    match_up(&channel.recorded, &done, end, &mut outcome);
    outcome
}

fn collect(remote: &mut SimRemote<FixedData>, line: usize, done: &mut Vec<Deed>) {
    while let Some((time, event)) = remote.take_event() {
        let what = What::Event(match event {
            RemoteEvent::WatchdogBites => "watchdog bites".to_owned(),
            RemoteEvent::FrameTimeout(n) => format!("parser timeout, drops {n} bytes"),
            RemoteEvent::DropsReply => "drops this reply".to_owned(),
            RemoteEvent::BadCrc => "next reply is badcrc".to_owned(),
            RemoteEvent::Extra => "next reply is extra".to_owned(),
            RemoteEvent::Short => "next reply is short".to_owned(),
            RemoteEvent::Late => "next reply is late".to_owned(),
            RemoteEvent::Break => "next reply is break".to_owned(),
        });
        done.push(Deed { line, time, what });
    }
    while let Some(burst) = remote.transmit() {
        done.push(Deed {
            line,
            time: burst.start,
            what: What::Reply {
                is_break: burst.is_break,
                bytes: burst.bytes().to_vec(),
            },
        });
    }
}

/// Both lists are in the order of time; equal actions at the same time are a pair.
fn match_up(recorded: &[Deed], done: &[Deed], end: Nanos, outcome: &mut Outcome) {
    let mut left = recorded.iter().peekable();
    let mut right = done.iter().peekable();
    loop {
        match (left.peek(), right.peek()) {
            (None, None) => return,
            (Some(a), Some(b)) if a.time.abs_diff(b.time) <= RESOLUTION => {
                outcome.compare(a.what == b.what, a.line, || (show(a), show(b)));
                left.next();
                right.next();
            }
            (Some(a), b) if b.is_none_or(|b| a.time < b.time) => {
                let latest = done.iter().min_by_key(|deed| deed.time.abs_diff(a.time));
                outcome.compare(false, a.line, || {
                    let nearest = latest.map_or("nothing at all".to_owned(), show);
                    (show(a), format!("nothing then; nearest: {nearest}"))
                });
                left.next();
            }
            (_, Some(b)) => {
                // Actions that begin or end after the recording cannot be in it.
                if deed_end(b) < end {
                    outcome.compare(false, b.line, || ("nothing".to_owned(), show(b)));
                }
                right.next();
            }
            (Some(_), None) => unreachable!("covered by the arm before the last"),
        }
    }
}

fn deed_end(deed: &Deed) -> Nanos {
    // 87 us is a character at 115200 baud, the slowest rate that is recorded.
    deed.time
        + match &deed.what {
            What::Reply { bytes, .. } => 87_000 * bytes.len() as Nanos,
            What::Event(_) => 0,
        }
}

fn show(deed: &Deed) -> String {
    let time = deed.time as f64 / 1e3;
    match &deed.what {
        What::Reply { is_break, bytes } => {
            let kind = if *is_break { "BREAK " } else { "" };
            format!("{time:.2} {kind}{bytes:02X?}")
        }
        What::Event(text) => format!("{time:.2} {text}"),
    }
}
