//! What a cycle costs LinuxCNC and this crate on the same kind of board, at the same time.

use std::{
    fmt, fs,
    net::{Ipv4Addr, SocketAddrV4},
    process::{Child, Command, Stdio},
    sync::Arc,
    sync::atomic::{AtomicU8, Ordering},
    thread::{JoinHandle, spawn},
    time::Duration,
};

use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{BuildError, Driver, Pace};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

use crate::interop::{console::Console, sim_board};

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

/// Both of ours in their cycle at 1 kHz, each on a board of its own, while LinuxCNC is in its.
pub struct Beside {
    phase: Arc<AtomicU8>,
    runs: Vec<(Pace, Option<JoinHandle<Cost>>)>,
}

const MEASURING: u8 = 1;
const OVER: u8 = 2;

impl Beside {
    /// Starts them; from now on they are measured.
    pub fn start(board: &str) -> Self {
        let phase = Arc::new(AtomicU8::new(0));
        let started = [(Pace::Board, 2), (Pace::Host, 3)].map(|(pace, host)| {
            let address = SocketAddrV4::new(Ipv4Addr::new(127, 97, 0, host), 27181);
            let run = Run::build(board, address, pace, Arc::clone(&phase));
            (pace, run.map(|run| spawn(move || run.measure())))
        });
        phase.store(MEASURING, Ordering::Relaxed);
        Self {
            phase,
            runs: started.into(),
        }
    }

    /// Ends them, and prints what their cycles have cost beside LinuxCNC's.
    pub fn print(self, linuxcnc_per_cycle: Duration) {
        self.phase.store(OVER, Ordering::Relaxed);
        let linuxcnc = linuxcnc_per_cycle.as_secs_f64() * 1e6;
        println!("a cycle of LinuxCNC's: {linuxcnc:.1} us CPU; of ours, at the same time:");
        for (pace, run) in self.runs {
            let Some(run) = run else {
                println!("this board can not pace it");
                continue;
            };
            let ours = run.join().expect("it does not panic");
            let ratio = ours.cpu_us / linuxcnc;
            println!("paced by the {pace:?}: {ours}, {ratio:.2} of LinuxCNC's");
        }
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

/// A driver on a simulated board of its own.
struct Run {
    driver: Driver<UdpBus>,
    board: Child,
    pace: Pace,
    phase: Arc<AtomicU8>,
    next: mesa_hal::bus::Instant,
}

impl Run {
    /// `None` if such a board can not pace.
    fn build(board: &str, address: SocketAddrV4, pace: Pace, phase: Arc<AtomicU8>) -> Option<Self> {
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
        match driver {
            Ok(mut driver) => Some(Self {
                next: driver.bus_mut().now(),
                driver,
                board: child,
                pace,
                phase,
            }),
            Err(BuildError::NoPace) => {
                let _ = child.kill();
                let _ = child.wait();
                None
            }
            Err(error) => panic!("the machine is complete: {error}"),
        }
    }

    fn measure(mut self) -> Cost {
        while self.phase.load(Ordering::Relaxed) < MEASURING {
            self.cycle();
        }
        let before = self.driver.bus().statistics();
        let start = cpu("/proc/thread-self/schedstat");
        let (mut cycles, mut good) = (0_u64, 0);
        while self.phase.load(Ordering::Relaxed) < OVER {
            good += u64::from(self.cycle());
            cycles += 1;
        }
        let ours = cpu("/proc/thread-self/schedstat").saturating_sub(start);
        let after = self.driver.bus().statistics();
        let per_cycle = |total: u64| total as f64 / cycles.max(1) as f64;
        Cost {
            cpu_us: per_cycle(ours.as_nanos() as u64) / 1000.0,
            packets_out: per_cycle(after.exchanges - before.exchanges),
            bytes_out: per_cycle(after.bytes_sent - before.bytes_sent),
            bytes_back: per_cycle(after.bytes_received - before.bytes_received),
            good: per_cycle(good),
        }
    }

    fn cycle(&mut self) -> bool {
        let report = self.driver.read();
        let _ = self.driver.write();
        if self.pace == Pace::Host {
            self.next = self.next.after(Duration::from_millis(1));
            let left = self.next.since(self.driver.bus_mut().now());
            std::thread::sleep(left);
        }
        report.is_ok_and(|report| report.is_good())
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.driver.shutdown();
        let _ = self.board.kill();
        let _ = self.board.wait();
    }
}

/// The time a thread has run, from its `schedstat`.
fn cpu(path: &str) -> Duration {
    let text = fs::read_to_string(path).unwrap_or_default();
    let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}
