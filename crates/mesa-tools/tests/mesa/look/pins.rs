//! `mesa pins`.

use std::io::{BufRead, BufReader, Read};
use std::net::Ipv4Addr;

use serde_json::Value;

use crate::interop::Process;
use crate::interop::board::Board;
use crate::run::{Run, command, json, run};

fn by_name<'a>(pins: &'a Value, name: &str) -> &'a Value {
    let pins = pins.as_array().expect("pins");
    let found = pins.iter().find(|pin| pin["name"] == name);
    found.unwrap_or_else(|| panic!("no {name}"))
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn inputs_are_as_they_are_on_the_board() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i97", "--port", "0", "--remote", "0=7i77-io:2"],
    );
    for command in ["input board 3 on", "input 0 7 on", "field 0 12.5"] {
        board.console.run(command);
    }
    let pins = json(&[
        "pins",
        "--addr",
        &board.address.to_string(),
        "--mode",
        "0.0=2",
    ]);
    for (name, value, place) in [
        ("hm2_7i97.0.inmux.00.input-03", true, ["TB4 pin 5", "IN3"]),
        ("hm2_7i97.0.inmux.00.input-04", false, ["TB4 pin 7", "IN4"]),
        (
            "hm2_7i97.0.7i77.0.0.input-07",
            true,
            ["TB8 pin 8", "INPUT7"],
        ),
        (
            "hm2_7i97.0.7i77.0.0.input-07-not",
            false,
            ["TB8 pin 8", "INPUT7"],
        ),
    ] {
        let pin = by_name(&pins, name);
        assert_eq!(pin["value"], value, "{pin}");
        assert_eq!(pin["valid"], true, "{pin}");
        assert_eq!([&pin["terminal"], &pin["signal"]], place, "{pin}");
        assert_eq!([&pin["type"], &pin["direction"]], ["bit", "OUT"], "{pin}");
        assert!(pin["age_us"].is_u64(), "{pin}");
    }
    let volts = by_name(&pins, "hm2_7i97.0.7i77.0.0.fieldvoltage");
    let error = volts["value"].as_f64().expect("a number") - 12.5;
    assert!(error.abs() < 0.2 && volts["unit"] == "volts", "{volts}");
    let scale = by_name(&pins, "hm2_7i97.0.pwmgen.00.scale");
    assert_eq!(scale["direction"], "RW");
    assert_eq!(scale["age_us"], Value::Null);
    let count = by_name(&pins, "hm2_7i97.0.encoder.00.count");
    assert_eq!(count["signal"], "QA0, /QA0, QB0, /QB0", "{count}");
    let index = by_name(&pins, "hm2_7i97.0.encoder.00.index-enable");
    assert_eq!(index["signal"], "IDX0, /IDX0", "{index}");
    let probe = by_name(&pins, "hm2_7i97.0.encoder.00.probe-enable");
    assert_eq!(probe["terminal"], "", "{probe}");

    // Nothing is left running, and nothing was driven.
    let truth = board.console.show("all");
    assert_eq!(truth["board.watchdog-bitten"], "1");
    for output in 0..6 {
        assert_eq!(truth[&format!("board.output-{output:02}")], "0");
        assert_eq!(truth[&format!("board.enable{output}")], "0");
    }
}

#[test]
fn pattern_chooses_by_name_terminal_or_signal() {
    let lines = |pattern: &str| {
        let run = run(&["pins", pattern, "--sim", "7i92-7i77"]);
        assert_eq!(run.code, Some(0), "{run:?}");
        run.out.lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let some = lines("*.7i77.0.0.input-0?");
    assert_eq!(some.len(), 10, "{some:?}");
    assert!(
        some[2].starts_with("hm2_7i92.0.7i77.0.0.input-02  bit   OUT  false"),
        "{some:?}"
    );
    assert!(some[2].ends_with("TB8 pin 3 INPUT2"), "{some:?}");
    let encoder = lines("/QA3");
    assert!(
        encoder.iter().all(|line| line.contains(".encoder.03.")),
        "{encoder:?}"
    );
    let connector = lines("P1 DB25 pin 13");
    let is_its = |line: &String| line.contains(".gpio.033.");
    assert!(
        !connector.is_empty() && connector.iter().all(is_its),
        "{connector:?}"
    );
    // A terminal as a person types it; 2 is not a part of it.
    for typed in ["TB8-2", "tb8.2", "TB8 pin 2 of 7i77.0.0"] {
        let inputs = lines(typed);
        let is_its = |line: &String| line.contains(".7i77.0.0.input-01");
        assert!(inputs.len() >= 2 && inputs.iter().all(is_its), "{inputs:?}");
    }
    // The pins of this signal, at its terminals.
    let index = lines("IDX0");
    let names: Vec<_> = index
        .iter()
        .map(|line| line.split_whitespace().next().unwrap_or_default())
        .collect();
    assert_eq!(
        names,
        [
            "hm2_7i92.0.encoder.00.index-enable",
            "hm2_7i92.0.encoder.00.input-index",
            "hm2_7i92.0.encoder.00.no_clear_on_index"
        ]
    );
    assert!(index[1].ends_with("TB3 pin 7, 8 IDX0, /IDX0"), "{index:?}");
    let one = lines("/QA0");
    let at = |name: &str| one.iter().find(|line| line.contains(name));
    let ends = |name: &str, place: &str| at(name).is_some_and(|line| line.ends_with(place));
    assert!(ends(".input-a ", " TB3 pin 1, 2 QA0, /QA0"), "{one:?}");
    let both = " TB3 pin 1, 2, 4, 5 QA0, /QA0, QB0, /QB0";
    assert!(ends(".count ", both) && at("index").is_none(), "{one:?}");
    assert_eq!(at("input-b"), None, "{one:?}");
    let block = lines("tb5 pin");
    assert!(
        block.iter().any(|line| line.contains("analogout0")),
        "{block:?}"
    );

    let none = run(&["pins", "nonsense", "--sim", "7i92-7i77"]);
    assert_eq!(none.code, Some(1), "{none:?}");
    assert!(none.err.contains("no pin fits"), "{none:?}");
    assert_eq!(none.out, "");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn signal_ends_it_with_the_board_stopped() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i92-7i77", "--port", "0"],
    );
    let address = board.address.to_string();
    let started = command(&["pins", "--addr", &address, "--seconds", "60"]).spawn();
    let mut started = started.expect("mesa starts");
    let mut said = BufReader::new(started.stderr.take().expect("piped"));
    let mut line = String::new();
    said.read_line(&mut line).expect("what was found");
    assert!(line.starts_with("hm2_7i92.0: 7i77.0.0"), "{line}");
    let mut process = Process::new(started);
    process.signal("TERM");
    let run = Run::from(process.output());
    said.read_to_string(&mut line).expect("the end");
    assert_eq!((run.code, &*run.out), (Some(143), ""), "{line}");
    assert!(
        line.contains("ended by SIGTERM; outputs were never on"),
        "{line}"
    );
    let truth = board.console.show("0");
    assert_eq!(truth["remote.0.output-00"], "0", "{truth:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_dies_is_reported_and_no_pins_are_printed() {
    let card = ["--board", "7i92-7i77", "--port", "0"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &card);
    let address = board.address.to_string();
    let started = command(&["pins", "--addr", &address, "--seconds", "60"]).spawn();
    let mut started = started.expect("mesa starts");
    let mut said = BufReader::new(started.stderr.take().expect("piped"));
    let mut line = String::new();
    said.read_line(&mut line).expect("what was found");
    let process = Process::new(started);
    board.kill();
    let run = Run::from(process.output());
    said.read_to_string(&mut line).expect("the end");
    assert_eq!((run.code, &*run.out), (Some(1), ""), "{line}");
    let reason = "the board does not answer any more";
    assert!(line.contains(reason), "{line}");
}
