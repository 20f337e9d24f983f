//! What a cycle costs LinuxCNC and this crate on the same board, measured one after the other.

use std::{
    fmt, fs,
    net::{Ipv4Addr, SocketAddrV4},
    process::{Command, Stdio},
    time::Duration,
};

use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{BuildError, Driver, Pace};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

use crate::interop::{console::Console, sim_board};

/// Cycles of ours, at 1 kHz.
const CYCLES: u32 = 5000;

/// What LinuxCNC's realtime process has had of the CPUs so far.
pub fn linuxcnc_cpu() -> Duration {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let is_realtime = |directory: &fs::DirEntry| {
        let name = fs::read_to_string(directory.path().join("comm"));
        name.is_ok_and(|name| name.starts_with("rtapi_app"))
    };
    processes
        .filter(is_realtime)
        .flat_map(|process| fs::read_dir(process.path().join("task")))
        .flatten()
        .flatten()
        .map(|thread| cpu(&thread.path().join("schedstat").to_string_lossy()))
        .sum()
}

/// Prints our cost of a cycle on the same board beside LinuxCNC's, and the ratio.
pub fn print_beside(board: &str, linuxcnc_per_cycle: Duration) {
    let linuxcnc = linuxcnc_per_cycle.as_secs_f64() * 1e6;
    println!("a cycle of LinuxCNC's: {linuxcnc:.1} us CPU");
    for (pace, host) in [(Pace::Board, 2), (Pace::Host, 3)] {
        let address = SocketAddrV4::new(Ipv4Addr::new(127, 97, 0, host), 27181);
        let Some(ours) = cost(board, address, pace) else {
            println!("the same of ours: this board can not pace it");
            continue;
        };
        println!(
            "the same of ours, paced by the {pace:?}: {ours}, {:.2} of LinuxCNC's",
            ours.cpu_us / linuxcnc
        );
    }
}

/// What a cycle costs, on average.
struct Cost {
    cpu_us: f64,
    packets_out: f64,
    bytes_out: f64,
    bytes_back: f64,
    /// Of all cycles those whose read brought everything.
    good: f64,
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.1} us CPU, {:.3} packets and {:.0} bytes out, {:.0} bytes back, {:.1} % good",
            self.cpu_us,
            self.packets_out,
            self.bytes_out,
            self.bytes_back,
            self.good * 100.0
        )
    }
}

/// Measures ours on a board of its own; `None` if such a board can not pace.
fn cost(board: &str, address: SocketAddrV4, pace: Pace) -> Option<Cost> {
    let mut child = Command::new(sim_board())
        .args(board.split(' '))
        .args(["--listen", &address.ip().to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("sim_board starts");
    let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    Console::new(input, output).wait_for("help");
    let config = UdpConfig {
        cycle_deadline: Duration::from_millis(5),
        ..UdpConfig::default()
    };
    let bus = UdpBus::connect(address, config).expect("the board answers");
    let driver = Driver::builder(bus)
        .pace(pace)
        .watchdog(Duration::from_millis(100))
        .build();
    let cost = match driver {
        Ok(mut driver) => Some(run(&mut driver, pace)),
        Err(BuildError::NoPace) => None,
        Err(error) => panic!("the machine is complete: {error}"),
    };
    let _ = child.kill();
    let _ = child.wait();
    cost
}

fn run(driver: &mut Driver<UdpBus>, pace: Pace) -> Cost {
    let before = driver.bus().statistics();
    let start = cpu("/proc/thread-self/schedstat");
    let mut next = driver.bus_mut().now();
    let mut good = 0;
    for _ in 0..CYCLES {
        good += u32::from(driver.read().is_ok_and(|report| report.is_good()));
        let _ = driver.write();
        if pace == Pace::Host {
            next = next.after(Duration::from_millis(1));
            let left = next.since(driver.bus_mut().now());
            std::thread::sleep(left);
        }
    }
    let ours = cpu("/proc/thread-self/schedstat").saturating_sub(start);
    let after = driver.bus().statistics();
    let per_cycle = |total: u64| total as f64 / f64::from(CYCLES);
    Cost {
        cpu_us: ours.as_secs_f64() * 1e6 / f64::from(CYCLES),
        packets_out: per_cycle(after.exchanges - before.exchanges),
        bytes_out: per_cycle(after.bytes_sent - before.bytes_sent),
        bytes_back: per_cycle(after.bytes_received - before.bytes_received),
        good: per_cycle(good.into()),
    }
}

/// The time a thread has run, from its `schedstat`.
fn cpu(path: &str) -> Duration {
    let text = fs::read_to_string(path).unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
