//! Which times a command takes for a board that answers at a loopback address.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use mesa_hal::runner::Stop;
use mesa_hal_sim::{BoardConfig, Mishaps, Motor, SimBoard, UdpFace, machines};

use super::*;
use crate::commands::set;

/// The watchdog of a driver that has opened such a board, before and after.
fn watchdogs(is_marked: bool) -> [Option<Duration>; 2] {
    let any = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0);
    let mut face = UdpFace::bind(any, Mishaps::default()).expect("loopback is there");
    let Ok(SocketAddr::V4(address)) = face.local_addr() else {
        panic!("an IPv4 socket");
    };
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut config = BoardConfig::new("7I97");
            config.is_marked = is_marked;
            let fpga = machines::six_axes_7i97(Motor::default());
            let mut board = SimBoard::new(config, fpga);
            while !is_over.load(Ordering::Relaxed) {
                let step = face.step(&mut board, Duration::from_millis(1));
                step.expect("loopback is there");
            }
        });
        let stop = Stop::on_signals().expect("signals are caught");
        let found = Found::new(address.into(), Hurry::new(stop), None, None);
        let before = found.with_patience(set::settings());
        let opened = found.open();
        is_over.store(true, Ordering::Relaxed);
        opened.expect("a board");
        [before, found.with_patience(set::settings())].map(|settings| settings.watchdog)
    })
}

#[test]
fn only_a_board_that_says_it_is_simulated_gets_the_long_watchdog() {
    let short = set::settings().watchdog;
    assert!(short < Some(WATCHDOG));
    assert_eq!(watchdogs(true), [short, Some(WATCHDOG)]);
    // A real board behind a relay on this computer.
    assert_eq!(watchdogs(false), [short, short]);
}
