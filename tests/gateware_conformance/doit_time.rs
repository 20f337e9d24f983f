//! The predicted duration of a DOIT, against every DOIT that was recorded from the gateware, and
//! against the simulated port, whenever the host writes.

use std::time::Duration;

use crate::DIRECTORY;
use crate::common::recording::sslbp::{Entry, Event, Transcript};
use crate::common::recording::{Recording, files, own_directory};
use mesa_hal::sslbp::{Channel, ChannelExchange, DEFAULT_BAUD_RATE, DoitTime, ProcessDataSizes};
use mesa_hal_sim::remote::SimRemote;
use mesa_hal_sim::sslbp::{PortConfig, Register, SslbpPort};
use mesa_hal_sim::wire::{Nanos, RemoteEnd};
use proptest::prelude::*;

const PROCESS_DATA_RPC: u8 = 0xBD;

/// The clock of the recorded gateware. FACTS 3.
const CLOCK_HZ: u32 = 100_000_000;

/// "A few microseconds": most of it is the pass of the firmware in which the command or a reply
/// arrives, which cannot be predicted.
const FEW: Nanos = 7_000;

/// A recorded DOIT, without an error and without additional channels.
struct Recorded {
    place: String,
    took: Nanos,
    /// Chatter was running when it came, as with the first one after START.
    met_chatter: bool,
    predicted: DoitTime,
}

fn recorded() -> Vec<Recorded> {
    let files = files(&own_directory(DIRECTORY));
    let load = |path| Transcript::load(path).expect("a readable recording");
    files.iter().flat_map(|path| doits(&load(path))).collect()
}

fn is_command(entry: &Entry) -> bool {
    let register = match entry.event {
        Event::Write { register, .. } => register,
        Event::Poll { .. } => return true,
        _ => return false,
    };
    register == Register::Command
}

/// The good DOITs of a transcript. Some are recorded without the wire; they repeat the previous
/// one.
fn doits(transcript: &Transcript) -> Vec<Recorded> {
    let mut found = Vec::new();
    let mut last: Vec<ChannelExchange> = Vec::new();
    let mut log_is_off = false;
    for (n, entry) in transcript.entries.iter().enumerate() {
        log_is_off |= matches!(entry.event, Event::WireLogOff);
        let Event::Write { value, register } = entry.event else {
            continue;
        };
        let after = &transcript.entries[n + 1..];
        let end = after.iter().position(is_command).unwrap_or(after.len());
        let (wire, rest) = after.split_at(end);
        let is_doit = register == Register::Command && value & 0xFF00 == 0x1000;
        let [poll, ..] = rest else { continue };
        let ended = matches!(
            poll.event,
            Event::Poll {
                timed_out: false,
                ..
            }
        );
        if !is_doit || !ended || !is_good(value, rest) {
            continue;
        }
        let exchanges = if log_is_off {
            Some((last.clone(), false))
        } else {
            exchanges(value as u8, entry.time, wire)
        };
        let Some((exchanges, met_chatter)) = exchanges else {
            continue;
        };
        last.clone_from(&exchanges);
        found.push(Recorded {
            place: format!("{} at {}", transcript.name, entry.time),
            took: poll.time - entry.time,
            met_chatter,
            predicted: DoitTime::expected(transcript.channels, CLOCK_HZ, exchanges),
        });
    }
    found
}

/// True if DATA, as far as it was read before the next command, has no bit of the mask.
fn is_good(command: u32, rest: &[Entry]) -> bool {
    let after = rest.iter().skip(1).take_while(|entry| !is_command(entry));
    let mut data = after.filter_map(|entry| match entry.event {
        Event::Read {
            register: Register::Data,
            value,
        } => Some(value),
        _ => None,
    });
    let asked = command & 0xFF;
    data.all(|data| data & asked == 0)
}

/// The last exchange of each channel of `mask`, and true if there were others; `None` if another
/// channel is on the wire, or a burst on it is not as expected.
fn exchanges(mask: u8, from: Nanos, wire: &[Entry]) -> Option<(Vec<ChannelExchange>, bool)> {
    let mut found = Vec::new();
    let mut met_chatter = false;
    for channel in Channel::ALL {
        let bursts: Vec<&Entry> = wire.iter().filter(|entry| on(channel, entry)).collect();
        if mask >> channel.index() & 1 == 0 {
            if !bursts.is_empty() {
                return None;
            }
            continue;
        }
        let (before, last) = bursts.split_at(bursts.len().checked_sub(2)?);
        let [request, reply] = last else { return None };
        let (exchange, start) = exchange(channel, request, reply)?;
        met_chatter |= !before.is_empty() || start < from;
        found.push(exchange);
    }
    Some((found, met_chatter))
}

fn on(channel: Channel, entry: &Entry) -> bool {
    match entry.event {
        Event::FromFpga { channel: on, .. } | Event::ToFpga { channel: on, .. } => {
            on == channel.index()
        }
        _ => false,
    }
}

/// Contents of a request and its reply, and the start of the request.
fn exchange(channel: Channel, request: &Entry, reply: &Entry) -> Option<(ChannelExchange, Nanos)> {
    let Event::FromFpga {
        bytes: sent,
        start: begin,
        ..
    } = &request.event
    else {
        return None;
    };
    let Event::ToFpga {
        bytes: received,
        start,
        is_break: false,
        ..
    } = &reply.event
    else {
        return None;
    };
    let rate = (reply.time - start) / received.len() as Nanos;
    let is_usual = sent.first() == Some(&PROCESS_DATA_RPC) && (3_900..4_100).contains(&rate);
    let exchange = ChannelExchange {
        channel,
        sizes: ProcessDataSizes {
            rx: received.len() as u8 - 1,
            tx: sent.len() as u8 - 2,
        },
        baud_rate: DEFAULT_BAUD_RATE,
        latency: Duration::from_nanos(start.checked_sub(request.time)?),
    };
    is_usual.then_some((exchange, *begin))
}

/// FACTS 5.1.
#[test]
fn no_recorded_doit_took_longer_than_predicted_or_much_less() {
    let mut compared = 0;
    for doit in recorded().iter().filter(|doit| !doit.met_chatter) {
        let usual = doit.predicted.usual.as_nanos() as Nanos;
        assert!(
            (doit.took..=doit.took + FEW).contains(&usual),
            "{} took {}: {:?}",
            doit.place,
            doit.took,
            doit.predicted
        );
        compared += 1;
    }
    assert!(compared > 250, "{compared} compared");
}

/// FACTS 5.1.
#[test]
fn recorded_doit_with_chatter_stays_within_predicted_first_time() {
    let mut compared = 0;
    for doit in recorded().iter().filter(|doit| doit.met_chatter) {
        let first = doit.predicted.first.as_nanos() as Nanos;
        let Recorded { place, took, .. } = doit;
        assert!(*took <= first, "{place} took {took}: {:?}", doit.predicted);
        compared += 1;
    }
    assert!(compared > 20, "{compared} compared");
}

type Sockets = [Option<Box<dyn RemoteEnd>>; 8];

/// Runs a command on the simulated port; returns the time at which COMMAND reads 0.
fn run(port: &mut SslbpPort, lines: &mut Sockets, command: u32, at: Nanos) -> Nanos {
    port.advance(at, lines);
    port.write(at, Register::Command, command);
    let mut now = at;
    loop {
        now = port.next_event().expect("a port at work").max(now + 1);
        assert!(now < at + 20_000_000, "{command:04X} does not end");
        port.advance(now, lines);
        if port.read(now, Register::Command) == 0 {
            return now;
        }
    }
}

fn remote(sizes: ProcessDataSizes) -> Box<dyn RemoteEnd> {
    let ProcessDataSizes { rx, tx } = sizes;
    let mut remote = SimRemote::model();
    remote
        .apply(&format!(
            "present=1 name=TEST unit=4660 mode0={rx},{tx},0x100,0x200 lat=10 wd=0"
        ))
        .expect("a remote");
    Box::new(remote)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn no_simulated_doit_takes_longer_whenever_it_comes(
        build in 1u8..=8,
        clock_hz in prop::sample::select(vec![33_333_333u32, 50_000_000, 100_000_000]),
        remotes in prop::collection::vec((1u8..=13, 0u8..=12), 1..=8),
        pauses in prop::collection::vec(10_000u64..20_000, 10),
    ) {
        let mut port = SslbpPort::new(PortConfig::new(build, clock_hz));
        let mut lines = Sockets::default();
        let mut exchanges = Vec::new();
        let remotes = remotes.into_iter().take(build.into());
        for (channel, (rx, tx)) in Channel::ALL.into_iter().zip(remotes) {
            let sizes = ProcessDataSizes { rx, tx };
            lines[usize::from(channel.index())] = Some(remote(sizes));
            exchanges.push(ChannelExchange::usual(channel, sizes));
        }
        let mask = (1 << exchanges.len()) - 1;
        let mut now = run(&mut port, &mut lines, 0x0800, 600_000) + 20_000;
        now = run(&mut port, &mut lines, 0x0900 | mask, now) + 300_000;
        now = run(&mut port, &mut lines, 0x1000 | mask, now);
        let predicted = DoitTime::expected(build, clock_hz, exchanges);
        // With several remotes there may be one more reply in the last pass.
        let several = u64::from(mask != 1);
        let reply = Duration::from_nanos(several * 2_000 * 100_000_000 / u64::from(clock_hz));
        for pause in pauses {
            let from = now + pause;
            now = run(&mut port, &mut lines, 0x1000 | mask, from);
            prop_assert_eq!(port.read(now, Register::Data) & mask, 0);
            let took = Duration::from_nanos(now - from);
            prop_assert!(took <= predicted.usual + reply, "{:?}, {:?}", took, predicted);
        }
    }
}
