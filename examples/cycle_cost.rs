//! What a cycle on an Ethernet board costs this host: packets, bytes, time and CPU.
//!
//! ```sh
//! cargo run --release --example cycle_cost -- --addr 10.10.10.10 --seconds 10
//! ```

#[path = "support/mod.rs"]
mod support;

use std::error::Error;
use std::fmt::Write;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::process::ExitCode;
use std::time::Duration;

use mesa_hal::Settings;
use mesa_hal::bus::{BusStatistics, Clock, RegisterBus};
use mesa_hal::driver::{Driver, Pace};
use mesa_hal::lbp16;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use support::{Signal, Stop, complain, say};

const USAGE: &str = "\
Runs the cycle of an Ethernet board with everything on it, and prints what a cycle costs.
All outputs stay off.

Usage: cycle_cost --addr IP[:PORT] [--seconds N] [--rate HZ] [--pace host|board]

SIGINT (Ctrl-C) and SIGTERM end it early: ports stopped, what was measured so far printed.
Exits with 0, 1 if it could not be measured, 2 for bad arguments, 130 after SIGINT, 143 after SIGTERM.";

#[derive(Clone, Copy, Debug)]
struct Options {
    address: SocketAddrV4,
    seconds: f64,
    rate: u32,
    pace: Pace,
}

fn main() -> ExitCode {
    let options = match options(lexopt::Parser::from_env()) {
        Ok(Some(options)) => options,
        Ok(None) => {
            say(format_args!("{USAGE}\n"));
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            complain(format_args!("cycle_cost: {error}\n\n{USAGE}"));
            return ExitCode::from(2);
        }
    };
    match measure(options) {
        Ok(signal) => signal.map_or(ExitCode::SUCCESS, Signal::exit_code),
        Err(error) => {
            complain(format_args!("cycle_cost: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn options(mut arguments: lexopt::Parser) -> Result<Option<Options>, lexopt::Error> {
    use lexopt::prelude::*;
    let (mut address, mut seconds, mut rate) = (None, 5.0, 1000);
    let mut pace = Pace::Host;
    while let Some(argument) = arguments.next()? {
        match argument {
            Long("addr") => address = Some(arguments.value()?.parse_with(parse_address)?),
            Long("seconds") => seconds = arguments.value()?.parse()?,
            Long("rate") => rate = arguments.value()?.parse()?,
            Long("pace") => pace = arguments.value()?.parse()?,
            Long("help") | Short('h') => return Ok(None),
            _ => return Err(argument.unexpected()),
        }
    }
    if !(0.1..=3600.0).contains(&seconds) || !(10..=10_000).contains(&rate) {
        return Err("--seconds is 0.1 to 3600, --rate 10 to 10000".into());
    }
    let address = address.ok_or("say which board: --addr IP")?;
    Ok(Some(Options {
        address,
        seconds,
        rate,
        pace,
    }))
}

fn parse_address(text: &str) -> Result<SocketAddrV4, std::net::AddrParseError> {
    text.parse::<Ipv4Addr>()
        .map(|ip| SocketAddrV4::new(ip, lbp16::PORT))
        .or_else(|_| text.parse())
}

/// What was counted while the cycle ran.
#[derive(Debug, Default)]
struct Measured {
    cycles: u64,
    good: u64,
    busy: Duration,
    cpu: Duration,
    least_slack: Option<Duration>,
}

/// Runs the cycle and prints what it cost; the signal that has ended it early, if one did.
fn measure(options: Options) -> Result<Option<Signal>, Box<dyn Error>> {
    let stop = Stop::on_signals()?;
    let bus = UdpBus::connect(options.address, UdpConfig::default())?;
    let mut driver = Driver::start(
        bus,
        Settings {
            period: Duration::from_secs(1) / options.rate,
            pace: options.pace,
            watchdog: Some((Duration::from_secs(5) / options.rate).max(Duration::from_millis(100))),
            ..Settings::default()
        },
    )?;
    let before = driver.bus().statistics();
    let measured = run(&mut driver, options, &stop);
    let text = report(&mut driver, options.pace, before, &measured)?;
    let (_, stopped) = driver.shutdown();
    say(text);
    match (stop.signal(), stopped) {
        (None, Err(error)) => Err(error.into()),
        (signal, stopped) => {
            if let Err(error) = stopped {
                complain(format_args!("cycle_cost: {error}"));
            }
            Ok(signal)
        }
    }
}

fn run(driver: &mut Driver<UdpBus>, options: Options, stop: &Stop) -> Measured {
    let mut measured = Measured::default();
    let cpu_before = cpu_time();
    let mut next = driver.bus_mut().now();
    for _ in 0..(options.seconds * f64::from(options.rate)) as u64 {
        if stop.signal().is_some() {
            break;
        }
        measured.cycles += 1;
        let start = driver.bus_mut().now();
        if let Ok(report) = driver.read() {
            measured.good += 1;
            let least = measured.least_slack.into_iter().chain(report.slack).min();
            measured.least_slack = least;
        }
        let _ = driver.write();
        let now = driver.bus_mut().now();
        measured.busy += now.since(start);
        if options.pace == Pace::Host {
            next = next.after(driver.period());
            // Sleeping and not spinning, so that what is measured is the cycle.
            std::thread::sleep(next.since(now));
        }
    }
    measured.cpu = cpu_time().saturating_sub(cpu_before);
    measured
}

fn report(
    driver: &mut Driver<UdpBus>,
    pace: Pace,
    before: BusStatistics,
    measured: &Measured,
) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    let after = driver.bus().statistics();
    let per_cycle = |total: u64| total as f64 / measured.cycles.max(1) as f64;
    let microseconds = |total: Duration| per_cycle(total.as_nanos() as u64) / 1000.0;
    writeln!(out, "board: {}", driver.name())?;
    writeln!(
        out,
        "cycles: {}, {} with a good read",
        measured.cycles, measured.good
    )?;
    writeln!(
        out,
        "packets out per cycle: {:.3}",
        per_cycle(after.exchanges - before.exchanges)
    )?;
    writeln!(
        out,
        "bytes per cycle: {:.1} out, {:.1} back",
        per_cycle(after.bytes_sent - before.bytes_sent),
        per_cycle(after.bytes_received - before.bytes_received),
    )?;
    let time = microseconds(measured.busy);
    match (pace, measured.least_slack) {
        (Pace::Host, _) => writeln!(out, "time per cycle: {time:.1} us, board included"),
        (Pace::Board, least) => writeln!(
            out,
            "time per cycle: {time:.1} us; {} periods missed, the least slack {least:?}",
            driver.statistics().missed_periods,
        ),
    }?;
    writeln!(out, "CPU per cycle: {:.1} us", microseconds(measured.cpu))?;
    writeln!(out, "bus: {after:?}")?;
    for option in &driver.bus_mut().link().refused {
        writeln!(out, "this host does not allow {option}")?;
    }
    Ok(out)
}

/// What this process has had of the CPUs so far.
fn cpu_time() -> Duration {
    let statistics = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let nanos = statistics.split(' ').next().and_then(|n| n.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
