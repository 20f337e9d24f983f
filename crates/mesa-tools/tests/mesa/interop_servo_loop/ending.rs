//! End of programs that drive a board: by a signal, with a closed output, with missing hardware.
//! The state of the outputs comes from the simulated board, not from the program's orders.

use std::{
    net::Ipv4Addr,
    process::{Output, Stdio},
    time::{Duration, Instant},
};

use crate::interop::{PATIENCE, Process, board::Board, console::Values, example, mesa, realtime};

const I7I92: [&str; 4] = ["--board", "7i92-7i77", "--remote", "2=7i72"];
const I7I97: [&str; 6] = [
    "--board",
    "7i97",
    "--remote",
    "0=7i77-io",
    "--remote",
    "2=7i72",
];

/// A watchdog time of the board that is too long to make the outputs safe in these tests, and a
/// period that a busy computer keeps.
const LONG: [&str; 6] = ["--seconds", "600", "--rate", "200", "--watchdog", "1000"];

fn start(name: &str, address: Option<Ipv4Addr>, arguments: &[&str]) -> Process {
    let mut command = match name.strip_prefix("mesa ") {
        Some(_) => realtime(mesa()),
        None => realtime(example(name)),
    };
    command.args(name.strip_prefix("mesa "));
    if let Some(address) = address {
        command.args(["--addr", &address.to_string()]);
    }
    command
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    Process::new(command.spawn().expect("it starts"))
}

fn texts(output: &Output) -> (String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr))
}

/// Names of all outputs of the board and its remotes that are on.
fn outputs_on(values: &Values) -> Vec<String> {
    let is_output = |name: &str| {
        let what = name.rsplit('.').next().unwrap_or("");
        ["output-", "analogout", "analogena", "spinena", "enable"]
            .iter()
            .any(|kind| what.starts_with(kind))
    };
    let is_on = |value: &str| value.parse::<f64>().is_ok_and(|value| value.abs() > 0.01);
    let on = values
        .iter()
        .filter(|(name, value)| is_output(name) && is_on(value));
    on.map(|(name, value)| format!("{name} {value}")).collect()
}

/// Waits until all of these outputs are on.
fn wait_until_on(board: &mut Board, wanted: &[&str]) {
    let end = Instant::now() + PATIENCE;
    loop {
        let on = outputs_on(&board.console.show("all"));
        if wanted
            .iter()
            .all(|name| on.iter().any(|is| is.starts_with(name)))
        {
            return;
        }
        assert!(Instant::now() < end, "{wanted:?} of {on:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Counts of the requests sent to the remotes so far.
fn requests(values: &Values) -> Vec<&String> {
    let sent = values
        .iter()
        .filter(|(name, _)| name.ends_with("requests.sent"));
    sent.map(|(_, count)| count).collect()
}

fn assert_safe_and_stopped(board: &mut Board) {
    let after = board.console.show("all");
    assert_eq!(outputs_on(&after), [""; 0]);
    std::thread::sleep(Duration::from_millis(100));
    let later = board.console.show("all");
    assert_eq!(requests(&after), requests(&later), "a port still transfers");
    assert!(!requests(&later).is_empty());
}

/// Loops that do not hold on a busy machine end with 1.
#[test]
fn example_servo_loop_ends_on_both_boards_with_all_outputs_off() {
    for (n, arguments) in (1..).zip([&I7I97[..], &I7I92]) {
        let address = Ipv4Addr::new(127, 94, 9, n);
        let mut board = Board::start(address, arguments);
        let output = start("servo_loop", Some(address), &["--seconds", "1"]).output();
        let (out, err) = texts(&output);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{out}{err}");
        assert!(out.contains("axis 5: worst following error"), "{out}{err}");
        assert_eq!(err, "");
        assert_safe_and_stopped(&mut board);
    }
}

#[test]
fn signal_ends_the_servo_loop_with_outputs_off_and_a_summary() {
    let boards: [(&[&str], &[&str]); 2] = [
        (
            &I7I97,
            &[
                "board.analogout3",
                "board.enable0",
                "board.enable5",
                "remote.0.output",
                "remote.2.output",
            ],
        ),
        (
            &I7I92,
            &[
                "remote.1.analogout2",
                "remote.1.analogena",
                "remote.1.spinena",
                "remote.0.output",
                "remote.2.output",
            ],
        ),
    ];
    let ends = [("INT", 130), ("TERM", 143)];
    for (n, (arguments, wanted)) in (1..).zip(boards) {
        let address = Ipv4Addr::new(127, 94, 0, n);
        let mut board = Board::start(address, arguments);
        for (name, code) in ends {
            let mut child = start("servo_bench", Some(address), &LONG);
            wait_until_on(&mut board, wanted);
            child.signal(name);
            let output = child.output();
            assert_safe_and_stopped(&mut board);
            let (out, err) = texts(&output);
            assert_eq!(output.status.code(), Some(code), "{out}{err}");
            for said in [
                "Following error",
                "Cycles: ",
                &format!("Ended by SIG{name} after "),
            ] {
                assert!(out.contains(said), "{said}: {out}{err}");
            }
        }
    }
}

#[test]
fn signal_ends_the_loop_on_the_embedded_machine_with_a_summary() {
    let mut child = start("servo_bench", None, &["--seconds", "600", "--realtime"]);
    std::thread::sleep(Duration::from_millis(1500));
    child.signal("INT");
    let output = child.output();
    let (out, err) = texts(&output);
    assert_eq!(output.status.code(), Some(130), "{out}{err}");
    assert!(out.contains("Ended by SIGINT after "), "{out}{err}");
}

#[test]
fn signal_ends_other_tools_with_ports_stopped_and_results_shown() {
    let address = Ipv4Addr::new(127, 94, 0, 11);
    let mut board = Board::start(address, &I7I97);
    let received = |board: &mut Board| {
        let values = board.console.show("network");
        values["network.received.packets"].parse::<u64>().unwrap()
    };
    let tools: [(&str, &[&str], &str, u64); 2] = [
        (
            "mesa latency",
            &["--seconds", "600"],
            "CPU per cycle: ",
            3000,
        ),
        ("mesa info", &[], "HostMot2 firmware for MESA7I97", 1),
    ];
    for (name, arguments, said, packets) in tools {
        let before = received(&mut board);
        let mut child = start(name, Some(address), arguments);
        let end = Instant::now() + PATIENCE;
        while received(&mut board) < before + packets {
            assert!(Instant::now() < end, "{name} does nothing");
        }
        child.signal("INT");
        let output = child.output();
        let (out, err) = texts(&output);
        assert_eq!(output.status.code(), Some(130), "{name}: {out}{err}");
        assert!(out.contains(said), "{name}: {out}{err}");
        assert_safe_and_stopped(&mut board);
    }
}

#[test]
fn unread_output_causes_no_panic_and_no_early_end() {
    let address = Ipv4Addr::new(127, 94, 0, 12);
    let _board = Board::start(address, &I7I97);
    let on_board: [(&str, &[&str]); 2] = [
        (
            "servo_bench",
            &["--seconds", "0.5", "--rate", "200", "--watchdog", "1000"],
        ),
        ("mesa info", &[]),
    ];
    let alone: [(&str, &[&str]); 6] = [
        ("servo_bench", &["--seconds", "0.5", "--pins"]),
        ("servo_bench", &["--help"]),
        ("mesa latency", &["--help"]),
        ("mesa info", &["--sim", "7i92-7i77"]),
        ("mesa info", &["--help"]),
        ("mesa sim", &["--help"]),
    ];
    let on_board = on_board.map(|(name, arguments)| (name, Some(address), arguments));
    let alone = alone.map(|(name, arguments)| (name, None, arguments));
    for (name, address, arguments) in on_board.into_iter().chain(alone) {
        let mut child = start(name, address, arguments);
        child.stop_reading();
        let output = child.output();
        let (_, err) = texts(&output);
        // Loops that do not hold on a busy machine end with 1; a panic is 101.
        assert!(
            matches!(output.status.code(), Some(0 | 1)),
            "{name} {arguments:?}: {output:?}"
        );
        assert_eq!(err, "", "{name} {arguments:?}");
    }
}

/// Number of cycles, and of those with a failure.
fn cycles(printed: &str) -> (u64, u64) {
    let line = printed
        .lines()
        .find_map(|line| line.strip_prefix("Cycles: "));
    let (all, rest) = line.and_then(|line| line.split_once(" (")).expect("cycles");
    let bad = rest.split(' ').next().expect("failures");
    (all.parse().unwrap(), bad.parse().unwrap())
}

#[test]
fn missing_field_io_fails_a_7i77_run_however_its_axes_move() {
    let address = Ipv4Addr::new(127, 94, 0, 13);
    let mut board = Board::start(address, &I7I92);
    let run = ["--seconds", "2", "--rate", "200", "--watchdog", "1000"];
    // First with the remote missing at the start, then with the remote unplugged during the run.
    for is_away_at_start in [true, false] {
        board.console.run(if is_away_at_start {
            "unplug 0"
        } else {
            "plug 0"
        });
        let child = start("servo_bench", Some(address), &run);
        if !is_away_at_start {
            wait_until_on(&mut board, &["remote.0.output"]);
            board.console.run("unplug 0");
        }
        let output = child.output();
        let (out, err) = texts(&output);
        assert_eq!(output.status.code(), Some(1), "{out}{err}");
        assert!(!out.contains("All loops held"), "{out}");
        let said = if is_away_at_start {
            "Field I/O: MISSING"
        } else {
            "that is NOT enough"
        };
        assert!(out.contains(said), "{said}: {out}");
        let (all, bad) = cycles(&out);
        assert!(bad <= all && all <= 400, "{bad} bad of {all}: {out}");
    }
}

#[test]
fn summary_after_board_loss_has_no_more_failures_than_cycles() {
    let address = Ipv4Addr::new(127, 94, 0, 14);
    let mut board = Board::start(address, &I7I97);
    let child = start("servo_bench", Some(address), &LONG);
    wait_until_on(&mut board, &["board.enable0"]);
    drop(board);
    let output = child.output();
    let (out, err) = texts(&output);
    assert_eq!(output.status.code(), Some(1), "{out}{err}");
    let (all, bad) = cycles(&out);
    assert!(
        bad > 0 && bad <= all && all < 600_000,
        "{bad} bad of {all}: {out}"
    );
    assert!(err.contains("servo_bench: "), "{err}");
}

/// `tests/ethernet/bad_network.rs` verifies on virtual time that the driving program is not
/// disturbed.
#[test]
fn board_driven_by_another_program_is_left_alone() {
    let address = Ipv4Addr::new(127, 94, 0, 15);
    let mut board = Board::start(address, &I7I97);
    let mut first = start("servo_bench", Some(address), &LONG);
    wait_until_on(&mut board, &["board.enable0", "remote.0.output"]);
    let others = [
        ("servo_bench", &LONG[..]),
        ("mesa info", &[]),
        ("mesa latency", &[]),
    ];
    for (name, arguments) in others {
        let output = start(name, Some(address), arguments).output();
        let (out, err) = texts(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {out}{err}");
        let said = "another program or host drives this board";
        assert!(err.contains(said), "{name}: {err}");
    }
    first.signal("INT");
    let (out, err) = texts(&first.output());
    assert!(out.contains(" 0 resets"), "{out}{err}");
}
