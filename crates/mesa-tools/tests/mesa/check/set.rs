//! `mesa set`: the state of an output comes from the simulated board's console.

pub mod safety;
mod terminals;

use std::fs;
use std::net::Ipv4Addr;
use std::process::Output;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

use serde_json::Value;

use crate::interop::board::Board;
use crate::interop::{self, Process, Scratch};
use crate::run::{Run, command, done, hold_against_schema, json, run};

pub const OUTPUT: &str = "7i77.0.0.output-03";

const CARD: [&str; 4] = ["--board", "7i92-7i77", "--port", "0"];

/// A board with a watchdog time of 1 s in both halves of the 7I77, which a busy machine keeps.
pub fn board() -> Board {
    static STATE: OnceLock<Vec<u8>> = OnceLock::new();
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let state = STATE.get_or_init(|| {
        let file = Scratch::new("patient.state");
        let kept = [&CARD[..], &["--state", file.path()]].concat();
        let board = Board::start(Ipv4Addr::LOCALHOST, &kept);
        let address = board.address.to_string();
        for name in ["0.0.NVWatchDogTimeout", "0.1.NVWatchDogTimeout"] {
            done(&["param", "set", name, "1000", "--addr", &address, "--yes"]);
        }
        board.stop("TERM");
        fs::read(&file.0).expect("its state")
    });
    let n = NEXT.fetch_add(1, Ordering::Relaxed);
    let file = Scratch::new(&format!("patient-{n}.state"));
    fs::write(&file.0, state).expect("a scratch file");
    Board::start_from(file, Ipv4Addr::LOCALHOST, &CARD)
}

/// A board with the factory setting of the watchdogs, 50 ms.
pub fn impatient_board() -> Board {
    Board::start(Ipv4Addr::LOCALHOST, &CARD)
}

/// Starts a jog without waiting for its end.
pub fn begin(board: &Board, arguments: &[&str]) -> Process {
    let address = board.address.to_string();
    let all = [&["set"], arguments, &["--addr", &address, "--yes"]].concat();
    Process::new(command(&all).spawn().expect("mesa starts"))
}

/// Waits until a value on the console is as given.
pub fn wait_until(board: &mut Board, part: &str, name: &str, value: &str) {
    interop::wait_until(format_args!("{name} is {value}"), || {
        board.console.show(part)[name] == value
    });
}

/// Waits until a value of a channel on the console is as given.
pub fn wait_for(board: &mut Board, channel: usize, name: &str, value: &str) {
    let name = format!("remote.{channel}.{name}");
    wait_until(board, &channel.to_string(), &name, value);
}

/// The outputs of both halves of the card that are on.
pub fn lit(board: &mut Board) -> Vec<String> {
    let mut lit = Vec::new();
    for channel in ["0", "1"] {
        let values = board.console.show(channel);
        let outputs = values.into_iter().filter(|(name, value)| {
            let name = name.rsplit('.').next().unwrap_or_default();
            let is_output = ["output", "analogout", "analogena", "spinena"];
            is_output.iter().any(|start| name.starts_with(start)) && !is_zero(value)
        });
        lit.extend(outputs.map(|(name, _)| name));
    }
    lit
}

fn is_zero(value: &str) -> bool {
    value.parse::<f64>().is_ok_and(|value| value.abs() < 0.01)
}

pub fn ended(process: Process) -> Run {
    let output: Output = process.output();
    output.into()
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn output_is_on_alone_for_its_time_and_then_off() {
    let mut board = board();
    assert_eq!(lit(&mut board), [""; 0]);
    let jog = begin(&board, &[OUTPUT, "on", "--for", "3s", "--json"]);
    wait_for(&mut board, 0, "output-03", "1");
    assert_eq!(lit(&mut board), ["remote.0.output-03"]);
    // An input that switches meanwhile is reported.
    board.console.run("input 0 7 on");
    let run = ended(jog);
    assert_eq!(run.code, Some(0), "{run:?}");
    assert_eq!(lit(&mut board), [""; 0]);
    assert!(run.err.contains("TB8 pin 20"), "{run:?}");
    let told: Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("set", &told);
    assert_eq!(told["outcome"], "done");
    let changes = told["changes"].as_array().expect("a list");
    let input = changes.iter().find(|change| {
        let pin = change["pin"].as_str().expect("a name");
        pin.ends_with("7i77.0.0.input-07")
    });
    let input = input.unwrap_or_else(|| panic!("{told:#}"));
    assert_eq!(
        (&input["before"], &input["during"]),
        (&false.into(), &true.into())
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn drive_moves_only_if_enable_and_voltage_are_named_explicitly() {
    let mut board = board();
    let analog = ["7i77.0.1.analogout0", "0.5", "--for", "500ms"];
    let address = board.address.to_string();
    let all = [&["set"], &analog[..], &["--addr", &address, "--yes"]].concat();
    let refused = run(&all);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("--analog"), "{refused:?}");
    let enable = ["set", "7i77.0.1.analogena", "on", "--for", "1s"];
    let refused = run(&[&enable[..], &["--addr", &address, "--yes", "--analog"]].concat());
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.err.contains("--drive-enable"), "{refused:?}");

    let is = |board: &mut Board| board.console.show("motors")["motor.0.position"].clone();
    let at = is(&mut board);
    let disabled = run(&[&all[..], &["--analog"]].concat());
    assert_eq!(disabled.code, Some(2), "{disabled:?}");
    assert_eq!(is(&mut board), at, "it was not enabled");
    let told = json(&[&all[..], &["--analog", "--drive-enable"]].concat());
    assert_ne!(is(&mut board), at, "it has moved");
    assert!(
        told["changes"].to_string().contains("encoder.00.position"),
        "{told:#}"
    );
    assert_eq!(lit(&mut board), [""; 0]);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn signal_ends_it_with_the_output_off() {
    for (signal, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let mut board = board();
        let mut jog = begin(&board, &[OUTPUT, "1", "--for", "60s"]);
        wait_for(&mut board, 0, "output-03", "1");
        jog.signal(signal);
        let run = ended(jog);
        assert_eq!(run.code, Some(code), "{run:?}");
        assert_eq!(lit(&mut board), [""; 0]);
        assert!(
            run.err.contains(&format!("ended by SIG{signal}")),
            "{run:?}"
        );
        assert!(run.err.contains("all outputs are off"), "{run:?}");
        // The signal may come before the reply that confirms the output.
        let is_told = run.out.contains("safe again") || run.out.contains("may have been 1");
        assert!(is_told, "{run:?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn fault_ends_it_with_the_reason() {
    let mut board = impatient_board();
    let jog = begin(&board, &[OUTPUT, "on", "--for", "60s"]);
    wait_for(&mut board, 0, "output-03", "1");
    board.console.run("shorted 0 3 on");
    let run = ended(jog);
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.err.contains("output overloaded"), "{run:?}");
    // The remote's watchdog may have bitten before everything else is stopped.
    let is_off = run.err.contains("all outputs are off");
    let is_named = run.err.contains("own watchdog, ");
    assert!(is_off != is_named, "{run:?}");
    assert_eq!(lit(&mut board), [""; 0]);
    // The connection to the board is lost.
    let mut board = self::board();
    let jog = begin(&board, &[OUTPUT, "on", "--for", "60s"]);
    wait_for(&mut board, 0, "output-03", "1");
    board.kill();
    let run = ended(jog);
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(
        run.out.is_empty() || run.out.contains("failed") || run.out.contains("may have been"),
        "{run:?}"
    );
    assert!(!run.err.contains("all outputs are off"), "{run:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn jog_ends_normally_if_its_output_is_not_read() {
    let mut board = board();
    let mut jog = begin(&board, &[OUTPUT, "on", "--for", "300ms"]);
    jog.stop_reading();
    let run = ended(jog);
    assert_eq!(run.code, Some(0), "{run:?}");
    assert_eq!(lit(&mut board), [""; 0]);
}

#[test]
fn invalid_arguments_are_refused_with_the_allowed_values() {
    let sim = ["--for", "1s", "--sim", "7i92-7i77", "--yes"];
    for (arguments, said) in [
        (["7i77.0.0.output-3", "on"], "output-03`"),
        (["spindle", "on"], "mesa pins"),
        (["enable", "on"], "mesa pins"),
        (["rawcounts", "1"], "give the name of one"),
        ([OUTPUT, "2"], "0 or 1"),
        (["7i77.0.1.analogout0", "10.5"], "from -10 to 10"),
        (["7i77.0.1.analogout0", "nan"], "from -10 to 10"),
        (["7i77.0.0.input-03", "on"], "input-03` is an input"),
        (["watchdog.timeout_ns", "0"], "not set by hand"),
    ] {
        let run = run(&[&["set"], &arguments[..], &sim].concat());
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
    for time in ["0.05", "61s", "-1", "soon"] {
        let time = format!("--for={time}");
        let run = run(&["set", OUTPUT, "on", &time, "--sim", "7i97"]);
        assert_eq!(run.code, Some(2), "{time}: {run:?}");
        assert!(run.err.contains("0.1 s to 60 s"), "{time}: {run:?}");
    }
    let run = run(&["set", OUTPUT, "on", "--for", "1s", "--sim", "7i92-7i77"]);
    assert_eq!(run.code, Some(2), "not a terminal: {run:?}");
    assert!(run.err.contains("--yes"), "{run:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn lost_packets_are_named() {
    let mut board = board();
    let jog = begin(&board, &[OUTPUT, "on", "--for", "2s"]);
    wait_until(&mut board, "0", "remote.0.output-03", "1");
    board.console.run("loss 0.02");
    interop::wait_until("a packet is lost", || losses(&mut board) > 0);
    board.console.run("loss 0");
    let ended = Run::from(jog.output());
    let lost = losses(&mut board);
    let said = ended.err.lines().find(|line| line.contains("packets lost"));
    let said = said.unwrap_or_else(|| panic!("{ended:?}"));
    assert!(
        said.starts_with(&format!("mesa: {lost} of ")),
        "{said}, of {lost}"
    );
}

/// Packets that the network has lost, on both ways.
fn losses(board: &mut Board) -> u64 {
    let network = board.console.show("network");
    let lost = ["received", "sent"].map(|way| {
        let lost = network[&format!("network.{way}.lost")].parse::<u64>();
        lost.expect("a count")
    });
    lost.into_iter().sum()
}
