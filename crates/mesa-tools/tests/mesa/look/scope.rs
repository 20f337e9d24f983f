//! `mesa scope`: the recording matches the commands on the simulated board's console.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use crate::interop::board::Board;
use crate::interop::{PATIENCE, Process, Scratch};
use crate::run::{Run, command, hold_against_schema, run};

fn board() -> Board {
    let card = ["--board", "7i92-7i77", "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &card)
}

/// Switches an input on and off until the driver runs, the cycles before the trigger are recorded,
/// and the trigger is detected: a value that was not valid in the cycle before crosses nothing.
fn switch_until_it_ends(board: &mut Board, scope: &mut Process) {
    let begun = Instant::now();
    let mut state = "on";
    while !scope.has_ended() {
        assert!(begun.elapsed() < PATIENCE, "no trigger");
        board.console.run(&format!("input 0 2 {state}"));
        state = if state == "on" { "off" } else { "on" };
        std::thread::sleep(Duration::from_millis(700));
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn cycles_around_a_switch_and_a_turning_motor_are_recorded() {
    let mut board = board();
    let (csv, svg) = (Scratch::new("scope.csv"), Scratch::new("scope.svg"));
    let address = board.address.to_string();
    let arguments = [
        "scope",
        "7i77.0.0.input-02",
        "encoder.00.position",
        "--trigger",
        "7i77.0.0.input-02",
        "--cycles",
        "300",
        "--before",
        "100",
        "--period",
        "2000",
        "--csv",
        csv.path(),
        "--plot",
        svg.path(),
        "--addr",
        &address,
        "--json",
    ];
    board.console.run("turn 0 1");
    let mut scope = Process::new(command(&arguments).spawn().expect("mesa starts"));
    switch_until_it_ends(&mut board, &mut scope);
    let run: Run = scope.output().into();
    assert_eq!(run.code, Some(0), "{run:?}");
    let told = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("scope", &told);
    assert_eq!(told["cycles"], 300);

    let armed = "mesa: armed: waits up to 60 s until hm2_7i92.0.7i77.0.0.input-02 crosses 0.5 rising; it is ";
    assert!(run.err.contains(armed), "{run:?}");
    let text = fs::read_to_string(&csv.0).expect("a file");
    let (header, rows) = text.split_once('\n').expect("a header");
    check_header(header, &told);
    check_rows(rows);
    let svg = fs::read_to_string(&svg.0).expect("a picture");
    check_picture(&svg);
}

/// The columns, and the trigger in the name of the last one.
fn check_header(header: &str, told: &serde_json::Value) {
    let columns =
        "time_s,cycle,\"hm2_7i92.0.7i77.0.0.input-02\",\"hm2_7i92.0.encoder.00.position\",";
    let trigger = header.strip_prefix(columns).expect(header);
    let cycle = told["trigger_cycle"].as_u64().expect("a number");
    let pin = "\"trigger: hm2_7i92.0.7i77.0.0.input-02 crosses 0.5 rising, ";
    assert!(trigger.starts_with(pin), "{trigger}");
    assert!(
        trigger.ends_with(&format!("Z, cycle {cycle}\"")),
        "{trigger}"
    );
}

/// 300 cycles, the trigger in the one with the number 100, and the speed of the motor.
fn check_rows(rows: &str) {
    let rows: Vec<Vec<f64>> = rows
        .lines()
        .map(|row| {
            row.split(',')
                .map(|cell| cell.parse().unwrap_or(f64::NAN))
                .collect()
        })
        .collect();
    assert_eq!(rows.len(), 300);
    let offsets: Vec<f64> = rows.iter().map(|row| row[1]).collect();
    assert_eq!(offsets, (-100..200).map(f64::from).collect::<Vec<_>>());
    assert_eq!(
        (rows[100][0], rows[99][2], rows[100][2]),
        (0.0, 0.0, 1.0),
        "the trigger"
    );
    let marks: Vec<f64> = rows.iter().map(|row| row[4]).collect();
    let marked = marks.iter().position(|mark| *mark == 1.0);
    assert_eq!((marked, marks.iter().sum()), (Some(100), 1.0));
    assert!(
        rows.windows(2).all(|pair| pair[0][0] < pair[1][0]),
        "time goes on"
    );
    // The console turned the motor at one unit, 1000 counts, a second.
    let (first, last) = (&rows[0], &rows[299]);
    let speed = (last[3] - first[3]) / (last[0] - first[0]);
    assert!((500.0..2000.0).contains(&speed.abs()), "{speed}");
}

/// A line for each pin, the trigger, names and the axis.
fn check_picture(svg: &str) {
    assert!(svg.starts_with("<svg") && svg.contains("encoder.00.position"));
    assert!(svg.matches("<polyline").count() >= 4, "lines and triggers");
    for words in [
        "hm2_7i92.0: 300 cycles",
        "trigger: 7i77.0.0.input-02 crosses 0.5 rising, ",
        "7i77.0.0.input-02 (TB8 pin 3)",
        "time since the trigger, ",
    ] {
        assert!(svg.contains(words), "{words}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn lost_packets_are_named_with_the_number_that_the_board_has() {
    let mut board = board();
    let csv = Scratch::new("loss.csv");
    let address = board.address.to_string();
    let arguments = ["--cycles", "10", "--before", "5", "--period", "5000"];
    let scope = [
        "scope",
        "encoder.00.count",
        "--trigger",
        "7i77.0.0.input-02",
    ];
    let files = ["--csv", csv.path(), "--addr", &address, "--json"];
    let child = command(&[&scope[..], &arguments, &files].concat()).spawn();
    let mut scope = Process::new(child.expect("mesa starts"));
    let said = scope.child().stderr.take().expect("standard error");
    let mut lines = BufReader::new(said).lines().map_while(Result::ok);
    let armed = lines.find(|line| line.contains("armed: "));
    let armed = armed.expect("it is armed");
    // A busy host may have missed a transfer just then.
    let is_known = ["it is 0 now", "it is not valid now"];
    let is_known = is_known.iter().any(|known| armed.ends_with(known));
    assert!(is_known, "{armed}");
    board.console.run("loss 0.1");
    board.wait_for_packets(60);
    board.console.run("loss 0");
    switch_until_it_ends(&mut board, &mut scope);
    let run: Run = scope.output().into();
    assert_eq!(run.code, Some(0), "{run:?}");
    let told: serde_json::Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("scope", &told);
    let shown = board.console.show("network");
    let [to_board, back] = ["received", "sent"].map(|way| {
        let lost = shown[&format!("network.{way}.lost")].parse::<u64>();
        lost.expect("a count")
    });
    assert!(to_board + back > 0, "{shown:?}");
    assert_eq!(told["packets"]["lost"], to_board + back, "{told:#}");
    assert_eq!(told["packets"]["lost_to_board"], to_board, "{told:#}");
    // The pin of the trigger is recorded too.
    let pins = told["pins"].as_array().expect("pins");
    assert_eq!(pins.len(), 2);
    assert_eq!(pins[1], told["trigger"]);
}

#[test]
fn pin_that_a_software_mode_adds_is_recorded_in_that_mode() {
    let csv = Scratch::new("mode.csv");
    let scope = ["scope", "fieldvoltage", "--trigger", "input-02"];
    let rest = ["--sim", "7i92-7i77", "--timeout", "1", "--csv", csv.path()];
    let without = run(&[&scope[..], &rest].concat());
    assert_eq!(without.code, Some(2), "{without:?}");
    let said = "hm2_7i92.0.7i77.0.0.fieldvoltage is a parameter, read once at the start";
    assert!(without.err.contains(said), "{without:?}");
    let with = run(&[&scope[..], &rest, &["--mode", "0.0=2"]].concat());
    assert_eq!(with.code, Some(1), "{with:?}");
    assert!(
        with.err.contains("has not crossed 0.5 rising in 1 s"),
        "{with:?}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn no_file_is_written_without_the_trigger() {
    let csv = Scratch::new("never.csv");
    let sim = [
        "--trigger",
        "input-02",
        "--csv",
        csv.path(),
        "--sim",
        "7i92-7i77",
    ];
    let late = run(&[&["scope", "input-02", "--timeout", "1"], &sim[..]].concat());
    assert_eq!(late.code, Some(1), "{late:?}");
    assert!(late.err.contains("has not crossed 0.5 rising"), "{late:?}");
    assert!(!csv.0.exists());
    // An impossible trigger is refused at once.
    for (more, said) in [
        (
            ["--level", "5"],
            "is a bit, 0 or 1, and never crosses 5 rising",
        ),
        (["--level", "0"], "never crosses 0 rising"),
        (["--plot", csv.path()], "need a file each"),
    ] {
        let refused = run(&[&["scope", "input-02"], &more[..], &sim[..]].concat());
        assert_eq!(refused.code, Some(2), "{refused:?}");
        assert!(refused.err.contains(said), "{refused:?}");
    }

    let mut board = board();
    let address = board.address.to_string();
    let arguments = [
        "scope",
        "input-02",
        "--trigger",
        "input-02",
        "--csv",
        csv.path(),
        "--addr",
        &address,
    ];
    let mut scope = Process::new(command(&arguments).spawn().expect("mesa starts"));
    board.wait_for_packets(1500);
    scope.signal("INT");
    let run: Run = scope.output().into();
    assert_eq!(run.code, Some(130), "{run:?}");
    assert!(run.err.contains("nothing was written"), "{run:?}");
    assert!(!csv.0.exists());
}

#[test]
fn invalid_arguments_are_refused_with_the_allowed_values() {
    let csv = Scratch::new("refused.csv");
    let rest = ["--sim", "7i92-7i77", "--csv", csv.path()];
    for (arguments, code, said) in [
        (&["input-2", "--trigger", "input-02"][..], 2, "input-"),
        (&["input-02", "--trigger", "nonsense"], 2, "mesa pins"),
        (
            &["input-02", "--trigger", "input-02", "--cycles", "100001"],
            2,
            "100000",
        ),
        (
            &["input-02", "--trigger", "input-02", "--cycles", "50"],
            2,
            "before the trigger",
        ),
        (
            &["input-02", "--trigger", "input-02", "--edge", "up"],
            2,
            "rising, falling",
        ),
        (&["--trigger", "input-02"], 2, "<PIN>"),
    ] {
        let run = run(&[&["scope"], arguments, &rest].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
    }
}
