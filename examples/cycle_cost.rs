//! What a cycle on an Ethernet board costs this host: packets, bytes, time and CPU.
//!
//! ```sh
//! cargo run --release --example cycle_cost -- --addr 10.10.10.10 --seconds 10
//! ```

use std::error::Error;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::process::ExitCode;
use std::time::Duration;

use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{Driver, Pace};
use mesa_hal::lbp16;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

const USAGE: &str = "\
Runs the cycle of an Ethernet board with everything on it, and prints what a cycle costs.
All outputs stay off.

Usage: cycle_cost --addr IP[:PORT] [--seconds N] [--rate HZ] [--pace host|board]";

#[derive(Clone, Copy, Debug)]
struct Options {
    address: SocketAddrV4,
    seconds: u32,
    rate: u32,
    pace: Pace,
}

fn main() -> ExitCode {
    match options(lexopt::Parser::from_env()) {
        Ok(Some(options)) => match measure(options) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("cycle_cost: {error}");
                ExitCode::FAILURE
            }
        },
        Ok(None) => {
            println!("{USAGE}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("cycle_cost: {error}\n\n{USAGE}");
            ExitCode::from(2)
        }
    }
}

fn options(mut arguments: lexopt::Parser) -> Result<Option<Options>, lexopt::Error> {
    use lexopt::prelude::*;
    let (mut address, mut seconds, mut rate) = (None, 5, 1000);
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
    if !(1..=3600).contains(&seconds) || !(10..=10_000).contains(&rate) {
        return Err("--seconds is 1 to 3600, --rate 10 to 10000".into());
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

fn measure(options: Options) -> Result<(), Box<dyn Error>> {
    let Options {
        address,
        seconds,
        rate,
        pace,
    } = options;
    let bus = UdpBus::connect(address, UdpConfig::default())?;
    let period = Duration::from_secs(1) / rate;
    let mut driver = Driver::builder(bus)
        .period(period)
        .pace(pace)
        .watchdog(Duration::from_millis(100))
        .build()?;
    let before = driver.bus().statistics();
    let cpu_before = cpu_time();
    let cycles = u64::from(seconds) * u64::from(rate);
    let (mut good, mut busy) = (0, Duration::ZERO);
    let mut least = Duration::MAX;
    let mut next = driver.bus_mut().now();
    for _ in 0..cycles {
        let start = driver.bus_mut().now();
        if let Ok(report) = driver.read() {
            good += 1;
            least = least.min(report.slack.unwrap_or(least));
        }
        let _ = driver.write();
        let now = driver.bus_mut().now();
        busy += now.since(start);
        if pace == Pace::Host {
            next = next.after(period);
            // Sleeping and not spinning, so that what is measured is the cycle.
            std::thread::sleep(next.since(now));
        }
    }
    let cpu = cpu_time().saturating_sub(cpu_before);
    let after = driver.bus().statistics();
    let per_cycle = |total: u64| total as f64 / cycles as f64;
    let microseconds = |total: Duration| per_cycle(total.as_nanos() as u64) / 1000.0;
    println!("board: {}", driver.name());
    println!("cycles: {cycles}, {good} with a good read");
    println!(
        "packets out per cycle: {:.3}",
        per_cycle(after.exchanges - before.exchanges)
    );
    println!(
        "bytes per cycle: {:.1} out, {:.1} back",
        per_cycle(after.bytes_sent - before.bytes_sent),
        per_cycle(after.bytes_received - before.bytes_received),
    );
    match pace {
        Pace::Host => println!(
            "time per cycle: {:.1} us, board included",
            microseconds(busy)
        ),
        Pace::Board => println!(
            "time per cycle: {:.1} us; {} periods missed, the least slack {least:?}",
            microseconds(busy),
            driver.statistics().missed_periods,
        ),
    }
    println!("CPU per cycle: {:.1} us", microseconds(cpu));
    println!("bus: {after:?}");
    for option in driver.bus().socket_options().refused() {
        println!("this host does not allow {option}");
    }
    driver.shutdown()?;
    Ok(())
}

/// What this process has had of the CPUs so far.
fn cpu_time() -> Duration {
    let statistics = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let nanos = statistics.split(' ').next().and_then(|n| n.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
