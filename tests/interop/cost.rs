//! What a cycle costs LinuxCNC and this crate on the same board, measured one after the other.

use std::{
    fs,
    net::{Ipv4Addr, SocketAddrV4},
    process::{Command, Stdio},
    time::Duration,
};

use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::Driver;
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
    let address = SocketAddrV4::new(Ipv4Addr::new(127, 97, 0, 2), 27181);
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
    let mut driver = Driver::builder(bus)
        .watchdog(Duration::from_millis(100))
        .build()
        .expect("the machine is complete");
    let (before, start) = (
        driver.bus().statistics(),
        cpu("/proc/thread-self/schedstat"),
    );
    let mut next = driver.bus_mut().now();
    for _ in 0..CYCLES {
        let _ = driver.read();
        let _ = driver.write();
        next = next.after(Duration::from_millis(1));
        let left = next.since(driver.bus_mut().now());
        std::thread::sleep(left);
    }
    let ours = cpu("/proc/thread-self/schedstat").saturating_sub(start) / CYCLES;
    let after = driver.bus().statistics();
    drop(driver);
    let _ = child.kill();
    let _ = child.wait();
    let per_cycle = |total: u64| total as f64 / f64::from(CYCLES);
    println!(
        "a cycle of ours: {:.3} packets out, {:.0} bytes out, {:.0} bytes back; {:.1} us CPU \
         beside LinuxCNC's {:.1} us, {:.2} of it (this profile is not optimised for speed)",
        per_cycle(after.exchanges - before.exchanges),
        per_cycle(after.bytes_sent - before.bytes_sent),
        per_cycle(after.bytes_received - before.bytes_received),
        ours.as_secs_f64() * 1e6,
        linuxcnc_per_cycle.as_secs_f64() * 1e6,
        ours.as_secs_f64() / linuxcnc_per_cycle.as_secs_f64(),
    );
}

/// The time a thread has run, from its `schedstat`.
fn cpu(path: &str) -> Duration {
    let text = fs::read_to_string(path).unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
