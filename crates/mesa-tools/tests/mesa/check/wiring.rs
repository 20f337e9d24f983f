//! `mesa wiring`: the simulated board's console takes the operator's actions.

mod ends;
mod outputs;

use std::fs;
use std::net::Ipv4Addr;
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use crate::check::set::board;
use crate::interop::board::Board;
use crate::interop::console::Console;
use crate::interop::{Process, Scratch};
use crate::run::{Run, command, hold_against_schema, json, run};

/// A running check: its output, and the operator's input.
pub struct Guided {
    pub process: Process,
    pub dialog: Console,
}

/// Ten inputs.
pub const INPUTS: &str = "*7i77.0.0.input-0?";

impl Guided {
    pub fn begin(board: &Board, arguments: &[&str]) -> Self {
        let address = board.address.to_string();
        let target = ["--addr", &address, "--timeout", "600"];
        let all = [&["wiring"], arguments, &target].concat();
        let mut child = command(&all)
            .stdin(Stdio::piped())
            .spawn()
            .expect("mesa starts");
        let (input, said) = (child.stdin.take().unwrap(), child.stderr.take().unwrap());
        Self {
            process: Process::new(child),
            dialog: Console::new(input, said),
        }
    }

    /// Waits for a line with a text, and returns the line.
    pub fn says(&self, text: &str) -> String {
        self.dialog.wait_for(text)
    }

    pub fn types(&mut self, line: &str) {
        self.dialog.raw(line.as_bytes());
        self.dialog.raw(b"\n");
    }

    pub fn ended(self) -> Run {
        self.process.output().into()
    }

    /// Actuates an input of the 7I77 when requested, and releases it.
    pub fn actuates(&self, board: &mut Board, input: usize) {
        self.says("actuate it now; it is off");
        board.console.run(&format!("input 0 {input} on"));
        self.says("  on; let it go");
        board.console.run(&format!("input 0 {input} off"));
        self.says("  ok: off to on");
    }
}

/// Returns the report's entry for the pin whose name ends with `pin`.
pub fn entry<'a>(report: &'a Value, pin: &str) -> &'a Value {
    let terminals = report["terminals"].as_array().expect("a list");
    let mut found = terminals.iter().filter(|terminal| {
        let name = terminal["pin"].as_str().expect("a name");
        name.ends_with(pin)
    });
    found.next().unwrap_or_else(|| panic!("{pin}: {report:#}"))
}

/// Verdicts on the terminals, in their order.
fn verdicts(report: &Value) -> Vec<&str> {
    let terminals = report["terminals"].as_array().expect("a list");
    let verdicts = terminals.iter().map(|terminal| &terminal["verdict"]);
    verdicts
        .map(|verdict| verdict.as_str().expect("a word"))
        .collect()
}

/// The operator ends the check; returns the report, validated against the schema.
fn ends(mut guided: Guided) -> Value {
    guided.types("q");
    guided.says("outputs were never on; the ports are stopped");
    let run = guided.ended();
    assert_eq!(run.code, Some(1), "{run:?}");
    let report: Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("wiring", &report);
    assert_eq!(
        (&report["outcome"], &report["ok"]),
        (&"ended".into(), &false.into())
    );
    report
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn terminal_is_named_and_its_changes_are_reported_and_saved() {
    let mut board = board();
    let file = Scratch::new("wiring.json");
    let keep = ["--json", "--report", file.path()];
    let mut guided = Guided::begin(&board, &[&[INPUTS], &keep[..]].concat());
    let first = guided.says("[1/10] ");
    let named = "TB8 pin 1 INPUT0 (7i77.0.0.input-00): actuate it now; it is off";
    assert!(first.ends_with(named), "{first}");
    board.console.run("input 0 0 on");
    guided.says("  on; let it go");
    board.console.run("input 0 0 off");
    guided.says("  ok: off to on");
    guided.says("[2/10] ");
    let so_far = fs::read_to_string(&file.0).expect("a report");
    let so_far: Value = serde_json::from_str(&so_far).expect("JSON");
    hold_against_schema("wiring", &so_far);
    assert_eq!(so_far["outcome"], "unfinished");
    assert_eq!(verdicts(&so_far)[..2], ["ok", "not_checked"]);
    // Exchanged wires.
    for (asked, wired) in [(1, 2), (2, 1)] {
        board.console.run(&format!("input 0 {wired} on"));
        let told = guided.says("changed instead: exchanged?");
        let other = format!("TB8 pin {} INPUT{wired} ", wired + 1);
        assert!(told.contains(&other), "{told}");
        board.console.run(&format!("input 0 {wired} off"));
        // No hand is at both inputs at once.
        std::thread::sleep(Duration::from_millis(500));
        guided.types("");
        guided.says("  INSTEAD CHANGED: TB8 pin ");
        guided.says(&format!("[{}/10] ", asked + 2));
    }
    // Back to the first input, with keys typed by mistake.
    for n in [3, 2, 1] {
        guided.types("b");
        guided.says(&format!("[{n}/10] "));
    }
    guided.types("what?");
    guided.says("Enter skips, b goes back, q ends");
    let report = ends(guided);
    let kept = fs::read_to_string(&file.0).expect("a report");
    let kept: Value = serde_json::from_str(&kept).expect("JSON");
    assert_eq!(kept, report);
    let expected = ["ok", "other_changed", "other_changed", "not_checked"];
    assert_eq!(verdicts(&report)[..4], expected, "{report:#}");
    let name = |n: usize| format!("hm2_7i92.0.7i77.0.0.input-0{n}");
    assert_eq!(report["exchanged"], serde_json::json!([[name(1), name(2)]]));
    let third = entry(&report, "input-02");
    assert_eq!(third["others"], serde_json::json!([name(1)]));
    assert_eq!(third["terminal"], "TB8 pin 3");
    assert_eq!(
        report["missing"],
        serde_json::json!([]),
        "no card is expected at channel 2"
    );
    // It names when and on what it was made.
    check_date(report["date"].as_str().expect("a date"));
    assert_eq!(
        (&report["board"], &report["firmware"]),
        (&"7I92".into(), &"MESA7I92".into())
    );
    assert_eq!(report["ethernet_firmware"], 16);
    let units = units(&board).into_iter().map(
        |(place, unit)| serde_json::json!({ "place": place, "card": "7I77", "unit_number": unit }),
    );
    assert_eq!(report["units"], units.collect::<Value>());
    // Nothing was driven.
    assert_eq!(crate::check::set::lit(&mut board), [""; 0]);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn loose_wires_and_connected_ones_are_not_in_order() {
    let mut board = board();
    let mut guided = Guided::begin(&board, &[INPUTS, "--json"]);
    guided.says("[1/10] ");
    for n in 0..300 {
        let (ms, level) = (200 + n * 20, if n % 2 == 0 { "on" } else { "off" });
        board.console.run(&format!("at +{ms}ms input 0 0 {level}"));
    }
    guided.says("CHANGES BY ITSELF; waited for until it is quiet");
    guided.types("");
    guided.says("  UNSTABLE: it changes by itself");
    guided.says("[2/10] ");
    let now: f64 = board.console.show("time")["time"].parse().expect("seconds");
    for (later, level) in [(1.0, "on"), (2.0, "off")] {
        let time = now + later;
        for input in [1, 8] {
            let change = format!("at {time:.6}s input 0 {input} {level}");
            board.console.run(&change);
        }
    }
    guided.says("  CHANGED TOGETHER with TB8 pin 9 INPUT8 (7i77.0.0.input-08): connected?");
    guided.says("[3/10] ");
    board.console.run("input 0 2 on");
    guided.says("  on; let it go");
    guided.types("");
    guided.says("  DID NOT COME BACK: off to on");
    let report = ends(guided);
    let expected = ["unstable", "together", "not_back", "not_checked"];
    assert_eq!(verdicts(&report)[..4], expected, "{report:#}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn invalid_input_is_no_change_nor_is_its_next_value() {
    let mut board = board();
    let mut guided = Guided::begin(&board, &[INPUTS, "--json"]);
    guided.says("[1/10] ");
    board.console.run("unplug 0");
    guided.says("NOT VALID, and waited for: 7i77.0.0 ");
    board.console.run("input 0 0 on");
    board.console.run("plug 0");
    guided.says("INPUT0 (7i77.0.0.input-00): let it go first: it is on, and was not before");
    board.console.run("input 0 0 off");
    guided.actuates(&mut board, 0);
    guided.says("[2/10] ");
    board.console.run("field 0 0");
    let told = guided.says("NOT VALID, and waited for: ");
    assert!(told.contains("field"), "{told}");
    guided.types("");
    guided.says("  NOT VALID: 7i77.0.0");
    guided.says("[3/10] ");
    board.console.run("field 0 24");
    guided.actuates(&mut board, 2);
    let report = ends(guided);
    let expected = ["ok", "not_valid", "ok"];
    assert_eq!(verdicts(&report)[..3], expected, "{report:#}");
    let reason = entry(&report, "input-01")["reason"].as_str();
    assert!(
        reason.is_some_and(|why| why.contains("field")),
        "{report:#}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn encoder_turned_by_hand_shows_its_counting_direction() {
    let mut board = board();
    let file = Scratch::new("wiring.txt");
    let mut guided = Guided::begin(&board, &["*.rawcounts", "--report", file.path()]);
    let first = guided.says("[1/6] ");
    assert!(
        first.contains("TB3 pin 1, 2, 4, 5 QA0, /QA0, QB0, /QB0"),
        "{first}"
    );
    assert!(first.ends_with("turn it now by hand, in its positive direction"));
    let in_order = "ok: counts up, 0 to ";
    let wrong_way = "COUNTS DOWN, 0 to -";
    for (axis, speed, verdict) in [(0, "5", in_order), (1, "-5", wrong_way)] {
        board.console.run(&format!("turn {axis} {speed}"));
        guided.says("  it moves; let it rest");
        board.console.run(&format!("turn {axis} 0"));
        guided.says(&format!("  {verdict}"));
        guided.says(&format!("[{}/6] ", axis + 2));
    }
    board.console.run("turn 4 5");
    let told = guided.says("changed instead: exchanged?");
    assert!(told.contains("encoder.04"), "{told}");
    guided.types("");
    guided.says("[4/6] ");
    guided.types("q");
    let run = guided.ended();
    assert_eq!(run.code, Some(1), "{run:?}");
    assert_eq!(fs::read_to_string(&file.0).expect("a report"), run.out);
    check_head(&run.out, &board);
    let summary = "\n1 of 6 terminals in order; ended before all were checked\n";
    assert!(run.out.contains(summary), "{run:?}");
    let lines: Vec<&str> = run
        .out
        .lines()
        .filter(|line| line.contains("(enc"))
        .collect();
    assert!(lines[1].contains("  COUNTS DOWN, 0 to -"), "{run:?}");
    assert!(lines[1].contains("exchange A and B"), "{run:?}");
    assert!(lines[2].contains("  INSTEAD CHANGED: TB4 pin 9"), "{run:?}");
    assert!(lines[3].ends_with("  not checked"), "{run:?}");
}

/// The head of a report about this board, which was made a moment ago. The truth is `date`, and the
/// unit numbers of the inventory.
fn check_head(text: &str, board: &Board) {
    let lines: Vec<&str> = text.lines().collect();
    let begin = format!("Wiring of {}, checked from ", board.address);
    let date = lines[0].strip_prefix(&begin).expect("the first line");
    let date = date.strip_suffix(" on").expect("a date");
    check_date(date);
    assert!(
        lines[1].starts_with("Board     7I92, MAC 00:60:1b:"),
        "{text}"
    );
    assert_eq!(lines[2], "Firmware  MESA7I92, Ethernet firmware 16");
    for (line, (place, unit)) in lines[3..].iter().zip(units(board)) {
        assert_eq!(
            *line,
            format!("Remote    {place} 7I77, unit number 0x{unit:08X}")
        );
    }
}

/// A date in UTC, within the last two minutes.
fn check_date(date: &str) {
    let pattern = "0000-00-00T00:00:00Z";
    let digits_to_0 = |letter: char| if letter.is_ascii_digit() { '0' } else { letter };
    assert_eq!(date.chars().map(digits_to_0).collect::<String>(), pattern);
    let since = Command::new("date").args(["--date", date, "+%s"]).output();
    let since = String::from_utf8(since.expect("date runs").stdout).expect("digits");
    let begun = UNIX_EPOCH + Duration::from_secs(since.trim().parse().expect(date));
    let passed = SystemTime::now().duration_since(begun).expect("it is over");
    assert!(passed < Duration::from_secs(120), "{date}");
}

/// Place and unit number of each remote, from the inventory.
fn units(board: &Board) -> Vec<(String, u64)> {
    let info = json(&["info", "--addr", &board.address.to_string()]);
    let channels = info["serial_ports"][0]["channels"]
        .as_array()
        .expect("channels");
    let remotes = channels.iter().enumerate();
    let remotes = remotes.filter_map(|(channel, content)| {
        let number = find_number(content, "unit_number")?;
        Some((format!("0.{channel}"), number))
    });
    remotes.collect()
}

/// The number of this name, anywhere in a value.
fn find_number(value: &Value, name: &str) -> Option<u64> {
    match value {
        Value::Object(map) => {
            let own = map.get(name).and_then(Value::as_u64);
            own.or_else(|| map.values().find_map(|value| find_number(value, name)))
        }
        Value::Array(list) => list.iter().find_map(|value| find_number(value, name)),
        _ => None,
    }
}

/// The first axis has an index every 4000 counts; the index of the second one is not wired.
const INDEXES: &str = r#"
board = "7i92-7i77"

[[axis]]
name = "x"
output = 0
encoder = 0
counts_per_index = 4000
position = 1.0

[[axis]]
name = "y"
output = 1
encoder = 1
counts_per_index = 0
"#;

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn index_is_latched_when_passed_and_an_unwired_one_is_reported() {
    let file = Scratch::new("indexes.toml");
    fs::write(&file.0, INDEXES).expect("a scratch file");
    let machine = ["--machine", file.path(), "--port", "0"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &machine);
    let mut guided = Guided::begin(&board, &["*.encoder.0?.*", "--json"]);
    guided.says("[1/12] ");
    guided.types("");
    // The encoder is requested before its index.
    let asked = guided.says("turn the encoder past its index, by hand");
    assert!(
        asked.contains("[2/12] ") && asked.contains("IDX0"),
        "{asked}"
    );
    board.console.run("turn x 2");
    guided.says("  the encoder moves");
    guided.says("  ok: it came, the encoder counted 0 to ");
    board.console.run("turn x 0");
    guided.says("[3/12] ");
    guided.types("");
    guided.says("[4/12] ");
    board.console.run("turn y 10");
    guided.says("  the encoder moves");
    board.console.run("turn y 0");
    guided.says("and its index did not come; turn it on, by more than a turn");
    guided.types("");
    guided.says("  NO CHANGE: the encoder counted 0 to ");
    guided.says("[5/12] ");
    let report = ends(guided);
    assert_eq!(
        verdicts(&report)[..5],
        ["skipped", "ok", "skipped", "no_change", "not_checked"],
        "{report:#}"
    );
    let passed = entry(&report, "encoder.00.index-enable");
    assert_eq!(passed["kind"], "index");
    let counted = passed["after"].as_f64().expect("a count");
    assert!(
        counted >= 2_990.0,
        "the index is 3000 counts away: {report:#}"
    );
    let missing = entry(&report, "encoder.01.index-enable");
    let reason = missing["reason"].as_str().expect("a reason");
    assert!(
        reason.ends_with("its index did not come: is it wired?"),
        "{reason}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn everything_in_order_is_exit_code_0() {
    let mut board = board();
    // An input that is on at the start is not a change.
    board.console.run("input 0 30 on");
    let mut guided = Guided::begin(&board, &["*7i77.0.0.input-30"]);
    guided.says("TB7 pin 15 INPUT30 (7i77.0.0.input-30): actuate it now; it is on");
    guided.types("b");
    guided.says("[1/1] ");
    board.console.run("input 0 30 off");
    guided.says("  off; let it go");
    board.console.run("input 0 30 on");
    let run = guided.ended();
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(run.out.contains("\n1 of 1 terminal in order\n"), "{run:?}");
    // The analog value at a terminal, on a card that has one.
    let mode = ["--mode", "0.0=2"];
    let guided = Guided::begin(&board, &[&["analogin"], &mode[..]].concat());
    for (input, volts) in ["12", "3", "8", "20"].iter().enumerate() {
        let named = guided.says("change it now; it is 0.0000");
        assert!(named.contains(&format!("INPUT{input} ")), "{named}");
        board.console.run(&format!("volts 0 {input} {volts}"));
        guided.says("  it moves; let it rest");
    }
    let run = guided.ended();
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(
        run.out.contains("(7i77.0.0.analogin1)  ok: 0.0000 to "),
        "{run:?}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn script_waits_for_each_terminal_so_long_and_no_longer() {
    let all = ["wiring", "*input-0?", "--sim", "7i97", "--timeout", "0.5"];
    let run = run(&[&all[..], &["--json"]].concat());
    assert_eq!(run.code, Some(1), "{run:?}");
    let report: Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("wiring", &report);
    assert_eq!(report["outcome"], "done");
    let terminals = report["terminals"].as_array().expect("a list");
    assert_eq!(terminals.len(), 10);
    for terminal in terminals {
        assert_eq!(terminal["verdict"], "no_change", "{terminal:#}");
        assert_eq!(terminal["kind"], "digital");
        let name = terminal["pin"].as_str().expect("a name");
        assert!(name.contains(".inmux.00.input-"), "filtered: {name}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn help_example_has_terminals_and_a_stuck_one_is_reported() {
    let help = run(&["wiring", "--help"]).out;
    let example = help
        .lines()
        .filter_map(|line| line.trim().strip_prefix("mesa "))
        .find(|line| line.contains("--json"))
        .expect("an example")
        .replace("< /dev/null", "");
    let words = example
        .replace('\'', "")
        .replace("--timeout 2", "--timeout 0.5");
    let run_of_help = run(&words.split_whitespace().collect::<Vec<_>>());
    let report: Value = serde_json::from_str(&run_of_help.out)
        .unwrap_or_else(|error| panic!("{error}: {run_of_help:?}"));
    assert_eq!(verdicts(&report).len(), 10, "{report:#}");
    let reason = &entry(&report, "input-01")["reason"];
    assert_eq!(reason, "it was off all the time", "{report:#}");

    let mut board = board();
    board.console.run("input 0 2 on");
    let address = board.address.to_string();
    let stuck = run(&["wiring", "input-02", "--addr", &address, "--timeout", "2"]);
    let line = stuck.out.lines().find(|line| line.contains("input-02"));
    assert!(
        line.is_some_and(|line| line.ends_with("NO CHANGE: it was on all the time")),
        "{stuck:?}"
    );
    let none = run(&["wiring", "input-0?", "--addr", &address, "--timeout", "2"]);
    assert!(
        none.err
            .contains("a pattern with * or ? has to match a whole name"),
        "{none:?}"
    );
    assert!(
        !none.err.contains("channel 2"),
        "nothing is plugged in there: {none:?}"
    );
}
