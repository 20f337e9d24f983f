//! Another program that begins to drive the board after a command has opened it.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::check::set::lit;
use crate::check::wiring::Guided;
use crate::interop::board::Board;
use crate::interop::mesaflash::free_address;
use crate::interop::tools::{has_program, skip};
use crate::interop::{Process, Scratch, wait_until};
use crate::run::{Run, command, done, hold_against_schema, run};
use crate::terminal::Terminal;
use serde_json::{Value, json};

const SAID: &str = "another program or host drives this board";

fn board() -> Board {
    let card = ["--board", "7i92-7i77", "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &card)
}

/// Sends some 1000 packets a second, as a cycle of 500 Hz does, until dropped.
struct Master {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Master {
    fn start(address: SocketAddrV4) -> Self {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
        socket.connect(address).expect("the board");
        let stop = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let (begun, mut sent) = (Instant::now(), 0);
            while !is_over.load(Ordering::Relaxed) {
                // A busy machine wakes it late: everything due is sent.
                while sent < begun.elapsed().as_millis() {
                    // A read of the cookie, which is harmless.
                    let _ = socket.send(&[0x81, 0x42, 0x00, 0x01]);
                    sent += 1;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        Self {
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Master {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Starts a command, and waits until it has the board; for a jog, until its output is on.
fn begin(board: &mut Board, arguments: &[&str]) -> Process {
    let address = board.address.to_string();
    let all = [arguments, &["--addr", &address, "--yes"]].concat();
    let process = Process::new(command(&all).spawn().expect("mesa starts"));
    let runs = |board: &mut Board| {
        let values = board.console.show("all");
        let received = values["network.received.packets"].parse();
        let received: u64 = received.expect("it is a count");
        match arguments {
            ["set", ..] => values["remote.0.output-03"] == "1",
            _ => received > 1000,
        }
    };
    wait_until(format_args!("{arguments:?} runs"), || runs(board));
    process
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn second_master_ends_a_cycle_with_a_reason_and_outputs_off() {
    let file = Scratch::new("second-master.csv");
    let never = ["--trigger", "7i77.0.0.input-03", "--timeout", "3600"];
    let scope = [
        &["scope", "encoder.00.position"],
        &never[..],
        &["--csv", file.path()],
    ]
    .concat();
    for arguments in [
        &["set", "7i77.0.0.output-03", "on", "--for", "60s"][..],
        &["latency", "--seconds", "3600"],
        &["pins", "--seconds", "60"],
        &scope,
    ] {
        let mut board = board();
        let process = begin(&mut board, arguments);
        let master = Master::start(board.address);
        let ended = Run::from(process.output());
        drop(master);
        assert_eq!(ended.code, Some(1), "{arguments:?}: {ended:?}");
        assert!(ended.err.contains(SAID), "{arguments:?}: {ended:?}");
        assert_eq!(lit(&mut board), [""; 0]);
    }
    assert!(!file.0.exists());
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_ends_with_the_reason() {
    let board = board();
    let arguments = format!("watch --addr {}", board.address);
    let Some(terminal) = Terminal::start("second", &arguments) else {
        return;
    };
    terminal.wait_for_text("7i77.0.0  running");
    let master = Master::start(board.address);
    let text = terminal.wait_for_text("exit code 1");
    assert!(text.contains("another program or host drives"), "{text}");
    drop(master);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_does_not_set_up_a_board_driven_by_another_program() {
    let mut board = board();
    let arguments = format!("watch --addr {}", board.address);
    let Some(terminal) = Terminal::start("again", &arguments) else {
        return;
    };
    terminal.wait_for_text("7i77.0.0  running");
    let mut is_bitten = || board.console.show("all")["board.watchdog-bitten"] == "1";
    // It has bitten already on a busy computer, until the board is set up again.
    wait_until("the watchdog runs", || !is_bitten());
    terminal.signal("STOP");
    wait_until("the watchdog has bitten", &mut is_bitten);
    let master = Master::start(board.address);
    terminal.signal("CONT");
    let text = terminal.wait_for("the end", |text| {
        let has_ended = text.contains("exit code");
        assert!(has_ended || is_bitten(), "it was set up again: {text}");
        has_ended
    });
    assert!(text.contains("exit code 1"), "{text}");
    assert!(text.contains("another program or host drives"), "{text}");
    drop(master);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn second_master_ends_wiring_with_reason_report_and_outputs_off() {
    // Long enough for a busy computer: ten outputs, 10 s each.
    let driving = ["*.7i77.0.0.output-0?", "--outputs", "--yes", "--for", "10"];
    for (arguments, waits) in [
        (&["*7i77.0.0.input-0?"][..], "actuate it now"),
        (&driving, "driven; did it come on?"),
    ] {
        let mut board = board();
        let file = Scratch::new("second-master.json");
        let keep = ["--json", "--report", file.path()];
        let guided = Guided::begin(&board, &[arguments, &keep].concat());
        guided.says(waits);
        // On a busy computer a watchdog bites, which ends the turn of an output.
        wait_until("an output is on", || {
            arguments.len() == 1 || !lit(&mut board).is_empty()
        });
        let master = Master::start(board.address);
        let said = guided.says(SAID);
        let failure: Value = serde_json::from_str(&said).expect("a failure as JSON");
        hold_against_schema("failure", &failure);
        let ended = guided.ended();
        drop(master);
        assert_eq!(ended.code, Some(1), "{ended:?}");
        assert_eq!(lit(&mut board), [""; 0]);
        let report: Value = serde_json::from_str(&ended.out).expect("JSON");
        let kept = std::fs::read_to_string(&file.0).expect("a report");
        let kept: Value = serde_json::from_str(&kept).expect("JSON");
        for report in [report, kept] {
            hold_against_schema("wiring", &report);
            assert_eq!(
                [&report["outcome"], &report["ok"]],
                [&json!("failed"), &json!(false)]
            );
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn second_master_is_checked_again_after_a_slow_answer() {
    let board = board();
    let address = board.address;
    let poke = format!("poke 6:0x14 0 --addr {address}");
    let Some(terminal) = Terminal::start("asked", &poke) else {
        return;
    };
    terminal.wait_for_text("Go on? [y/N]");
    let master = Master::start(address);
    terminal.type_keys(&["y", "Enter"]);
    let text = terminal.wait_for_text("exit code");
    assert!(text.contains("exit code 1"), "{text}");
    assert!(text.contains("another program or host drives"), "{text}");
    drop(master);
    let peek = ["peek", "6:0x14", "--addr", &address.to_string()];
    assert!(done(&peek).contains("0x0001  1"), "nothing was written");
    // Without a second master the write is done.
    let Some(terminal) = Terminal::start("alone", &poke) else {
        return;
    };
    terminal.wait_for_text("Go on? [y/N]");
    terminal.type_keys(&["y", "Enter"]);
    terminal.wait_for_text("exit code 0");
    assert!(done(&peek).contains("0x0000  0"));
}

/// All boards have the same factory address.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn consent_is_not_applied_to_another_board_at_the_same_address() {
    let at = free_address();
    let mut first = Board::start(at, &["--board", "7i97"]);
    let address = first.address.to_string();
    let poke = format!("poke 6:0x14 0 --addr {address}");
    let Some(terminal) = Terminal::start("swapped", &poke) else {
        return;
    };
    terminal.wait_for_text("Go on? [y/N]");
    first.kill();
    let second = Board::start(at, &["--board", "7i92-7i77"]);
    terminal.type_keys(&["y", "Enter"]);
    let text = terminal.wait_for_text("exit code");
    assert!(text.contains("exit code 1"), "{text}");
    let text = text.replace('\n', " ");
    assert!(text.contains("another board answers here by now"), "{text}");
    let peek = ["peek", "6:0x14", "--addr", &address];
    assert!(done(&peek).contains("0x0001  1"), "nothing was written");
    drop(second);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn read_only_access_does_not_stop_a_running_command() {
    // mesaflash knows one port only.
    let address = free_address();
    let mut board = Board::start(address, &["--board", "7i92-7i77"]);
    let mut latency = begin(&mut board, &["latency", "--seconds", "3600"]);
    let address = board.address.to_string();
    for _ in 0..8 {
        let info = run(&["info", "--addr", &address]);
        assert_eq!(info.code, Some(1), "{info:?}");
        assert!(info.err.contains(SAID), "{info:?}");
    }
    if has_program("mesaflash") {
        let only = board.address.ip().to_string();
        let mut mesaflash = Command::new("mesaflash");
        mesaflash.args(["--device", "7i92", "--addr", &only, "--readhmid"]);
        let asked = mesaflash.output().expect("mesaflash starts");
        let text = String::from_utf8_lossy(&asked.stdout);
        assert!(text.contains("IO Connections for P2"), "{text}");
        std::thread::sleep(Duration::from_secs(1));
    } else {
        skip("mesaflash");
    }
    assert!(
        latency.child().try_wait().expect("a child").is_none(),
        "it runs"
    );
    latency.signal("INT");
    let ended = Run::from(latency.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
}
