//! Nothing in the cycle over a socket allocates: in real time, with a board on another thread
//! behind a network that loses, delays and duplicates packets. What the bus above the socket does
//! is in `udp.rs`.

use crate::common::machine::start;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, spawn};
use std::time::Duration;

use allocation_counter::measure;
use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::Pace;
use mesa_hal::runner::Realtime;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal_sim::{BoardConfig, Mishaps, Motor, SimBoard, SimFpga, UdpFace, machines};

const CYCLES: u32 = 1000;

/// A simulated board, served by a thread until it is dropped.
struct Board {
    address: SocketAddrV4,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Board {
    fn start(card: &'static str, machine: fn() -> SimFpga, mishaps: Mishaps) -> Self {
        let any = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0);
        let mut face = UdpFace::bind(any, mishaps).expect("loopback is there");
        let Ok(SocketAddr::V4(address)) = face.local_addr() else {
            panic!("an IPv4 socket");
        };
        let stop = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&stop);
        let thread = spawn(move || {
            // On a busy computer it has to answer in time; without permission it stays as it is.
            let priority = Some(1);
            let _ = Realtime {
                priority,
                ..Realtime::default()
            }
            .apply();
            let mut board = SimBoard::new(BoardConfig::new(card), machine());
            while !is_over.load(Ordering::Relaxed) {
                face.step(&mut board, Duration::from_millis(1))
                    .expect("loopback is there");
            }
        });
        Self {
            address,
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn thousand_cycles_over_a_socket_allocate_nothing() {
    for pace in [Pace::Host, Pace::Board] {
        let mishaps = Mishaps {
            loss: 0.01,
            late: 0.01,
            dup: 0.01,
            seed: 5,
        };
        let machine = || machines::six_axes_7i97(Motor::default());
        let board = Board::start("7I97", machine, mishaps);
        let config = UdpConfig {
            cycle_deadline: Duration::from_millis(2),
            ..UdpConfig::default()
        };
        let bus = UdpBus::connect(board.address, config).expect("the board answers");
        let mut driver = start(bus, |s| {
            s.pace = pace;
            s.bus_error_limit = 100;
        })
        .expect("the board is complete");
        let mut good = 0;
        let allocated = measure(|| {
            for n in 0..CYCLES {
                good += u32::from(driver.read().is_ok());
                if n % 50 == 0 {
                    let _ = driver.rearm();
                }
                let _ = driver.write();
                if pace == Pace::Host {
                    std::thread::sleep(Duration::from_micros(300));
                    driver.request_read();
                }
            }
        });
        let counted = driver.bus().statistics();
        println!("{pace:?}: {good} good of {CYCLES}, {counted:?}");
        assert_eq!(allocated.count_total, 0, "{pace:?}");
        assert!(good > CYCLES / 10, "{pace:?}: {good} good");
        assert!(counted.lost + counted.late > 0 && counted.duplicate > 0);
    }
}
