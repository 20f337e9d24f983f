//! `mesa reset` and `mesa reload`.

use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::{Area, EthernetBoard};
use mesa_hal::transport::udp::UdpBus;

use crate::interop::mesaflash::free_address;
use crate::interop::{PATIENCE, Process, board::Board, realtime_thread};
use crate::run::{Run, command, done, json, patient, run};

fn board() -> (Board, String) {
    let board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    (board, address)
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn reset_needs_consent_and_is_waited_for() {
    let (board, address) = board();
    let reset = ["reset", "--addr", &address];
    let refused = run(&reset);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("--yes"), "{refused:?}");
    let text = done(&[&reset[..], &["--dry-run"]].concat());
    assert!(text.contains("would restart the network side"), "{text}");
    let planned = json(&[&reset[..], &["--dry-run"]].concat());
    assert_eq!(
        (&planned["dry_run"], &planned["address"]),
        (&true.into(), &address.as_str().into())
    );
    let value = json(&[&reset[..], &["--yes"]].concat());
    assert_eq!(value["board"], "7I97");
    done(&["led", "--addr", &address]);
    assert_eq!(board.stop("TERM")["board.resets"], "1");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn reload_needs_a_configuration_and_releases_the_outputs() {
    let (mut board, address) = board();
    let mut bus = UdpBus::connect(board.address, patient()).expect("a board");
    let flash = EthernetBoard::new(&mut bus).into_flash(FlashLayout::I7I97);
    let mut flash = flash.expect("a 7I97");
    for area in [Area::User, Area::Fallback] {
        let start = flash.layout().addresses(area).start;
        let erased = flash.write(area, start, &[0xFF; 256], |_, _| {});
        erased.expect("it is erased");
    }
    drop(bus);
    let reload = ["reload", "--addr", &address, "--yes"];
    let refused = run(&reload);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(
        refused.err.contains("no configuration in the flash memory"),
        "{refused:?}"
    );

    let mut bus = UdpBus::connect(board.address, patient()).expect("a board");
    let flash = EthernetBoard::new(&mut bus).into_flash(FlashLayout::I7I97);
    let mut flash = flash.expect("a 7I97");
    let data = [
        [0xFF; 16],
        [0xAA, 0x99, 0x55, 0x66, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    ]
    .concat();
    let mut put = |area| {
        let start = flash.layout().addresses(area).start;
        let written = flash.write(area, start, &data, |_, _| {});
        written.expect("it is written when it is named");
    };
    let planned = || json(&["reload", "--addr", &address, "--dry-run"])["would"].to_string();
    put(Area::Fallback);
    // The state after an interrupted write of the user area.
    assert!(planned().contains("it loads the fallback"), "{}", planned());
    put(Area::User);
    assert!(!planned().contains("fallback"), "{}", planned());
    drop(bus);
    // An output pin, as in `mesa poke`.
    done(&["poke", "0:0x1108", "0x10000", "--addr", &address, "--yes"]);
    done(&["poke", "0:0x1008", "0", "--addr", &address, "--yes"]);
    assert_eq!(board.console.show("board")["board.pin-050"], "0");
    let text = done(&reload);
    assert!(
        text.contains("reload done, it answers again after"),
        "{text}"
    );
    assert_eq!(board.console.show("board")["board.pin-050"], "1");
    assert_eq!(board.stop("TERM")["board.reloads"], "1");
}

/// A proxy between a client and a simulated board, which loses packets.
pub struct Between {
    pub address: String,
    /// A message for each lost packet.
    pub losses: Receiver<()>,
}

/// Forwards packets to a simulated board, except those that begin with `lost`. After a lost packet,
/// forwards nothing more if `is_last`.
pub fn between(board: &Board, lost: &'static [u8], is_last: bool) -> Between {
    let face = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
    let address = face.local_addr().expect("an address").to_string();
    let back = face.try_clone().expect("a socket");
    let behind = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
    behind.connect(board.address).expect("the board");
    let replies = behind.try_clone().expect("a socket");
    let client = Arc::new(Mutex::new(None));
    let last = Arc::clone(&client);
    let (told, losses) = channel();
    std::thread::spawn(move || {
        realtime_thread();
        let (mut buffer, mut is_over) = ([0; 2048], false);
        while let Ok((len, from)) = face.recv_from(&mut buffer) {
            let is_lost = buffer[..len].starts_with(lost);
            is_over |= is_lost && is_last;
            if is_lost || is_over {
                let _ = told.send(());
                continue;
            }
            *client.lock().expect("no thread panics") = Some(from);
            let _ = behind.send(&buffer[..len]);
        }
    });
    std::thread::spawn(move || {
        realtime_thread();
        let mut buffer = [0; 2048];
        loop {
            // After the end of a board, the error is that of an earlier packet.
            let Ok(len) = replies.recv(&mut buffer) else {
                continue;
            };
            let to = *last.lock().expect("no thread panics");
            let _ = to.map(|to| back.send_to(&buffer[..len], to));
        }
    });
    Between { address, losses }
}

/// A write of one word to LBPReset. Manual: 7I97, "MEMORY SPACE 6 LAYOUT".
const RESET: &[u8] = &[0x01, 0xD9, 0x1C, 0x00];

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn reset_that_was_lost_on_its_way_is_noticed() {
    let (board, _) = board();
    let Between { address, .. } = between(&board, RESET, false);
    let lost = run(&["reset", "--addr", &address, "--yes"]);
    assert_eq!(lost.code, Some(1), "{lost:?}");
    assert!(lost.err.contains("has not restarted"), "{lost:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_stays_away_is_given_up_and_ctrl_c_ends_the_wait() {
    let (board, _) = board();
    let Between { address, .. } = between(&board, RESET, true);
    let gone = run(&["reset", "--addr", &address, "--yes", "--wait", "1"]);
    assert_eq!(gone.code, Some(1), "{gone:?}");
    for said in [
        "does not answer again",
        "127.0.0.1 (from the EEPROM)",
        "192.168.1.121",
    ] {
        assert!(gone.err.contains(said), "{said}: {gone:?}");
    }
    let Between { address, losses } = between(&board, RESET, true);
    let waiting = command(&["reset", "--addr", &address, "--yes", "--wait", "60"]).spawn();
    let mut waiting = Process::new(waiting.expect("mesa starts"));
    losses.recv_timeout(PATIENCE).expect("it has reset it");
    waiting.signal("INT");
    let ended = Run::from(waiting.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert!(ended.err.contains("cannot be taken back"), "{ended:?}");
    assert!(ended.err.contains("outputs stay as they are"), "{ended:?}");
    let run = run(&["reset", "--addr", &address, "--wait", "61"]);
    assert!(run.code == Some(2) && run.err.contains("1..=60"), "{run:?}");
}

/// A board that has its old address until it is reset, and another one from then on.
fn moving(board: &Board, next: Ipv4Addr) -> String {
    let old = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
    let address = old.local_addr().expect("an address");
    let new = UdpSocket::bind((next, address.port())).expect("the same port");
    let behind = board.address;
    let is_moved = Arc::new(AtomicBool::new(false));
    for (face, is_new) in [(old, false), (new, true)] {
        let is_moved = Arc::clone(&is_moved);
        std::thread::spawn(move || {
            realtime_thread();
            let mut buffer = [0; 2048];
            let board = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
            board.connect(behind).expect("the board");
            let patience = Some(Duration::from_millis(200));
            board.set_read_timeout(patience).expect("a timeout");
            while let Ok((len, from)) = face.recv_from(&mut buffer) {
                if is_moved.load(Ordering::SeqCst) != is_new {
                    continue;
                }
                let packet = &buffer[..len];
                let is_reset = packet.starts_with(RESET);
                let _ = board.send(packet);
                if is_reset {
                    is_moved.store(true, Ordering::SeqCst);
                } else if let Ok(len) = board.recv(&mut buffer) {
                    let _ = face.send_to(&buffer[..len], from);
                }
            }
        });
    }
    address.to_string()
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn reset_after_an_address_change_waits_at_the_new_address() {
    let (board, _) = board();
    let next = free_address();
    let mut bus = UdpBus::connect(board.address, patient()).expect("a board");
    let mut ethernet = EthernetBoard::new(&mut bus);
    ethernet.set_eeprom_ip(next).expect("it is written");
    drop(bus);
    let address = moving(&board, next);
    let said = format!("By its jumpers it will be at {next}: from EEPROM (W16 down, W17 up)");
    let asked = run(&["reset", "--addr", &address]);
    assert!(asked.err.contains(&said), "{asked:?}");
    let reset = run(&["--json", "reset", "--addr", &address, "--yes"]);
    assert_eq!(reset.code, Some(0), "{reset:?}");
    assert!(reset.err.contains(&said), "{reset:?}");
    let port = address.rsplit_once(':').expect("a port").1;
    assert!(
        reset.out.contains(&format!("\"{next}:{port}\"")),
        "{reset:?}"
    );
    assert_eq!(board.stop("TERM")["board.resets"], "1");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_is_at_neither_address_is_missed_at_both() {
    let (board, _) = board();
    let next = free_address();
    let mut bus = UdpBus::connect(board.address, patient()).expect("a board");
    let mut ethernet = EthernetBoard::new(&mut bus);
    ethernet.set_eeprom_ip(next).expect("it is written");
    drop(bus);
    let Between { address, .. } = between(&board, RESET, true);
    let gone = run(&["reset", "--addr", &address, "--yes", "--wait", "1"]);
    assert_eq!(gone.code, Some(1), "{gone:?}");
    for said in ["does not answer again", &format!("nor at {next}")] {
        assert!(gone.err.contains(said), "{said}: {gone:?}");
    }
}
